//! Arguments of `report`.

use super::Format;
use super::recordings::RecordingName;
use super::scenario_name::ScenarioOr;
use clap::Args;
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  morphquad report
  morphquad report figure8-morph
  morphquad report recordings/7f3a.mcap --html report.html
  morphquad report recordings --png pictures
  morphquad report recordings/7f3a.mcap --format json

Opens with the verdict and its reason, as `run` does. Ends with 0 if the flight passed, 1 if it did not, 2 for a \
file that cannot be read or is not a recording, 3 where the page or the pictures cannot be written.";

/// What to report on, and where to.
#[derive(Debug, Clone, Args)]
pub struct ReportArguments {
    /// A recording, a folder of them, or a shipped scenario to fly first; the latest recording if left out
    #[arg(value_name = "FILE|DIR|SCENARIO")]
    #[arg(value_parser = ScenarioOr(RecordingName), hide_possible_values = true)]
    pub file: Option<PathBuf>,
    /// Taken in so that a shell's `*.mcap` gets an answer that names what to write instead.
    #[arg(hide = true)]
    pub more: Vec<PathBuf>,
    /// Write it as one page, pictures in it
    #[arg(long, value_name = "FILE.html")]
    pub html: Option<PathBuf>,
    /// Write its pictures into a folder
    #[arg(long, value_name = "DIR")]
    pub png: Option<PathBuf>,
    /// Form of the report on stdout
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}
