//! Arguments of `morphquad completions`, `man` and `layout`.

use super::recordings::RecordingName;
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

pub(super) const LAYOUT_EXAMPLES: &str = "\
Examples:
  morphquad layout > flight.json
  morphquad layout --plotjuggler recordings/7f3a.mcap > flight.xml && plotjuggler --layout flight.xml

To be imported into Foxglove or Lichtblick once, for all recordings: the vehicle in 3-D, positions and \
torques with what they are to be and their bounds, modes and events. Every recording has it too, as the \
attachment foxglove-layout.json. PlotJuggler's names its recording and opens it.";

/// For whom.
#[derive(Debug, Clone, Args)]
pub struct LayoutArguments {
    /// For `plotjuggler` instead, with the plots of this recording
    #[arg(long, value_name = "FILE", value_parser = RecordingName)]
    pub plotjuggler: Option<PathBuf>,
}

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
