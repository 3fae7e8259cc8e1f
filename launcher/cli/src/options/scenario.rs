//! Arguments of `morphquad scenario`.

use super::Format;
use super::scenario_name::ScenarioOr;
use clap::builder::StringValueParser;
use clap::{Args, Subcommand};
use std::path::PathBuf;

pub(super) const NEW_EXAMPLES: &str = "\
Examples:
  morphquad scenario new mine.toml
  morphquad scenario new windy.toml --from figure8-morph

The file is a shipped scenario to be changed. Ends with 2 if there is a file of this name.";

pub(super) const SHOW_EXAMPLES: &str = "\
Examples:
  morphquad scenario show hover
  morphquad scenario show figure8-morph | morphquad run - --seed 7

As it is written, without what it leaves to defaults; `morphquad check NAME --format toml` has what `--set` and other flags \
make of it.";

pub(super) const KEYS_EXAMPLES: &str = "\
Examples:
  morphquad scenario keys
  morphquad scenario keys plant.imu
  morphquad scenario keys mass
  morphquad scenario keys pilot --format json

Each with its default, the form and range of its value, and what it means; the end of a name is its unit. A key can be given \
in a scenario, under [SECTION], and by --set; one with [] belongs to each entry of a list, [[LIST]]. Ends with 2 if there is no such key.";

/// What to do with scenarios.
#[derive(Debug, Clone, Subcommand)]
pub enum ScenarioCommand {
    /// Write a scenario to begin one's own with
    #[command(after_help = NEW_EXAMPLES)]
    New(ScenarioNewArguments),
    /// Show the text of a shipped scenario
    #[command(after_help = SHOW_EXAMPLES)]
    Show(ScenarioShowArguments),
    /// Tell what can be set, and what it means
    #[command(after_help = KEYS_EXAMPLES)]
    Keys(ScenarioKeysArguments),
}

/// What to write.
#[derive(Debug, Clone, Args)]
pub struct ScenarioNewArguments {
    /// The file
    pub file: PathBuf,
    /// Shipped scenario to begin with
    #[arg(long, value_name = "NAME", default_value = "hover", value_parser = ScenarioOr(StringValueParser::new()))]
    pub from: String,
}

/// What to show.
#[derive(Debug, Clone, Args)]
pub struct ScenarioShowArguments {
    /// Name of a shipped scenario
    #[arg(value_parser = ScenarioOr(StringValueParser::new()))]
    pub name: String,
}

/// What to describe.
#[derive(Debug, Clone, Args)]
pub struct ScenarioKeysArguments {
    /// A section, a key, the beginning of one, or else any part of it; all if left out
    pub key: Option<String>,
    /// Form of the list
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}
