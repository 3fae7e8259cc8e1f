//! Arguments of `morphquad recordings`, and recordings as arguments of other commands.

use super::Format;
use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::error::{Error, ErrorKind};
use clap::{Arg, Args, Command, Subcommand};
use record::named::{FOLDER, named};
use std::ffi::OsStr;
use std::path::PathBuf;

pub(super) const LIST_EXAMPLES: &str = "\
Examples:
  morphquad recordings list
  morphquad recordings list elsewhere --format json

The newest comes first. `morphquad report recordings` judges all of them.";

pub(super) const SHOW_EXAMPLES: &str = "\
Examples:
  morphquad recordings show latest
  morphquad recordings show 7f3a

Wherever a command takes a recording, `latest` stands for the newest flight in recordings/, and the beginning of a name, \
or of the ID of its run, for the one there that has it. Ends with 2 for a file that cannot be read or is not a recording.";

/// What to do with recordings.
#[derive(Debug, Clone, Subcommand)]
pub enum RecordingsCommand {
    /// Name the recordings of a folder
    #[command(after_help = LIST_EXAMPLES)]
    List(RecordingsListArguments),
    /// Tell what a recording is, and the verdict of its flight
    #[command(after_help = SHOW_EXAMPLES)]
    Show(RecordingsShowArguments),
}

/// Which folder to list.
#[derive(Debug, Clone, Args)]
pub struct RecordingsListArguments {
    /// The folder
    #[arg(value_name = "DIR", default_value = FOLDER)]
    pub folder: PathBuf,
    /// Form of the list
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Which recording to show.
#[derive(Debug, Clone, Args)]
pub struct RecordingsShowArguments {
    /// The recording; the latest if left out
    #[arg(value_parser = RecordingName)]
    pub file: Option<PathBuf>,
    /// Form of the output
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Takes the path of a recording, `latest`, or the beginning of a name. What is none of them is left to the command,
/// which reports what may have been meant.
#[derive(Debug, Clone, Copy)]
pub(super) struct RecordingName;

impl TypedValueParser for RecordingName {
    type Value = PathBuf;

    fn parse_ref(
        &self,
        command: &Command,
        argument: Option<&Arg>,
        value: &OsStr,
    ) -> Result<PathBuf, Error> {
        let word = PathBufValueParser::new().parse_ref(command, argument, value)?;
        named(&word).map_err(|error| command.clone().error(ErrorKind::ValueValidation, error))
    }
}
