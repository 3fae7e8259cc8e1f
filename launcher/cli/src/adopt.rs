//! `morphquad adopt`: leads a run whose launcher has died to its end.

use super::options::AdoptArguments;
use super::refusal::{Done, Failure};
use flight::{AdoptError, AdoptOptions};
use host::exit;
use protocol::control::runs;
use simulate::RunError;
use std::io::{IsTerminal as _, Write};

/// Takes over and shows how the rest of the flight went.
pub(super) fn adopt(arguments: &AdoptArguments, out: &mut dyn Write) -> Done {
    let found = runs::find_orphan(arguments.run.as_deref());
    let run = found.map_err(|error| Failure::plain(&error, exit::USAGE))?;
    let options = AdoptOptions {
        run: run.id().to_owned(),
        folder: run.folder().to_path_buf(),
        record: arguments.record.clone(),
        no_record: arguments.no_record,
        progress: std::io::stderr().is_terminal(),
    };
    let summary = flight::adopt(&options).map_err(|error| {
        let code = match error {
            AdoptError::Lockstep { .. } => exit::USAGE,
            AdoptError::Run(RunError::Interrupted) => exit::INTERRUPTED,
            _ => exit::UNFIT,
        };
        Failure::plain(&error, code)
    })?;
    super::show_summary(&summary, arguments.format, out)
}
