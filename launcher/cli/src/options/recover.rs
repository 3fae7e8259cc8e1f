//! Arguments of `morphquad recover`.

use super::Format;
use super::recordings::RecordingName;
use clap::Args;
use std::path::PathBuf;

pub(super) const EXAMPLES: &str = "\
Examples:
  morphquad recover recordings/7f3a.mcap
  morphquad recover cut.mcap --out whole.mcap

What a recorder that was killed, or a full disk, has left is read as it is by every command. This writes \
it once more with the index that viewers want and an audit of what is there; the file is marked as \
recovered. Of a damaged file it keeps every part whose checksum \
fits, and reports what is left out. \
Ends with 0; 2 if the file is complete, or nothing in it can be read; 3 if the new one cannot be written.";

/// A cut recording.
#[derive(Debug, Clone, Args)]
pub struct RecoverArguments {
    /// The recording
    #[arg(value_parser = RecordingName)]
    pub file: PathBuf,
    /// The new file, which must not exist; NAME-recovered.mcap beside the old one if left out
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Form of the answer
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}
