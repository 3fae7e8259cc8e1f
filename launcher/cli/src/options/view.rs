//! Arguments of `view`.

use super::recordings::RecordingName;
use super::scenario_name::ScenarioOr;
use clap::Args;
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  morphquad view
  morphquad view figure8-morph
  morphquad view recordings/7f3a.mcap
  morphquad view recordings/7f3a.mcap --out flight.html
  morphquad view recordings/7f3a.mcap --port 8080 --no-open

The page needs nothing but a browser. With --out it is one file to keep or to send. Without, it is served on \
127.0.0.1 until Ctrl-C, and the browser is opened where there is one. Ends with 2 for a file that cannot be \
read or is not a recording, and for a port that cannot be used; 3 where the page cannot be written.";

/// What to show, and where.
#[derive(Debug, Clone, Args)]
pub struct ViewArguments {
    /// A recording, or a shipped scenario to fly first; the latest recording if left out
    #[arg(value_name = "FILE|SCENARIO")]
    #[arg(value_parser = ScenarioOr(RecordingName), hide_possible_values = true)]
    pub file: Option<PathBuf>,
    /// Write the page to a file and serve nothing
    #[arg(long, value_name = "FILE.html", conflicts_with = "port")]
    pub out: Option<PathBuf>,
    /// Port on 127.0.0.1; any free one if left out
    #[arg(
        long,
        value_name = "N",
        default_value = "0",
        hide_default_value = true,
        allow_negative_numbers = true
    )]
    pub port: u16,
    /// Only print the address
    #[arg(long)]
    pub no_open: bool,
}
