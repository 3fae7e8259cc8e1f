//! Arguments of `trace`.

use super::Format;
use super::recordings::RecordingName;
use clap::Args;
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  morphquad trace recordings/7f3a.mcap
  morphquad trace recordings/7f3a.mcap --command 1234
  morphquad trace recordings/7f3a.mcap --command 1234 --seat 1 --format json

Every wrench command is followed back to the IMU sample that it descends from, by what the headers in the \
recording contain; host stamps show where the time in between went. Latencies begin at the instant at which the \
IMU sample was due. Ends with 0 if every command traces, 1 if one does not or the file is cut, 2 for a \
command that is not in the file, and for a file that cannot be read or is not a recording.";

/// Which commands to follow to their sensor.
#[derive(Debug, Clone, Args)]
pub struct TraceArguments {
    /// The recording; the latest if left out
    #[arg(value_parser = RecordingName)]
    pub file: Option<PathBuf>,
    /// Sequence of one wrench command, to see its whole chain
    #[arg(long, value_name = "N")]
    pub command: Option<u64>,
    /// Seat of the attitude loop that sent it, where several had one of that sequence
    #[arg(long, value_name = "SEAT", requires = "command")]
    pub seat: Option<u32>,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}
