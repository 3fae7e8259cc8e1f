//! Arguments of `morphquad completions` and `morphquad man`.

use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

pub(super) const COMPLETIONS_EXAMPLES: &str = "\
Examples:
  morphquad completions bash > ~/.local/share/bash-completion/completions/morphquad
  morphquad completions zsh > \"${fpath[1]}/_morphquad\"
  morphquad completions fish > ~/.config/fish/completions/morphquad.fish";

pub(super) const MAN_EXAMPLES: &str = "\
Examples:
  morphquad man ~/.local/share/man/man1
  man morphquad-run

A page for each command, morphquad.1 and morphquad-COMMAND.1.";

/// For which shell.
#[derive(Debug, Clone, Args)]
pub struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Where to.
#[derive(Debug, Clone, Args)]
pub struct ManArguments {
    /// Folder for the pages; made if it is not there
    pub dir: PathBuf,
}
