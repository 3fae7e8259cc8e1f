//! Arguments of `doctor`.

use super::Format;
use clap::Args;
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  morphquad doctor
  morphquad doctor --fix
  morphquad doctor --format json --record /data/flights

Each line is a check: OK, WARN where flights would miss more than they need to, FAIL where they or their \
recordings would not work, with what to do about it. --fix removes what dead runs have left in shared memory \
and changes no setting of the system. Ends with 0 if nothing fails, 3 otherwise.";

/// How to examine this machine.
#[derive(Debug, Clone, Args)]
pub struct DoctorArguments {
    /// Remove what dead runs have left behind, and list it
    #[arg(long)]
    pub fix: bool,
    /// Folder in which flights would be recorded
    #[arg(long, value_name = "DIR", default_value = "recordings")]
    pub record: PathBuf,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}
