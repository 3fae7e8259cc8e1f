//! Commands that show a flight take a recording, or a scenario that is flown for it.

use super::refusal::Failure;
use crate::run::{self, Pin, RunError, RunOptions, Speed, Summary};
use crate::scenario::{Scenario, shipped};
use crate::{exit, record::read::RecordedFlight};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

/// Folder of recordings that nobody placed.
const RECORDINGS: &str = "recordings";

/// Opens a recording, or the one of a shipped scenario, flown now, if that is what `name` names.
pub(super) fn open(name: &Path) -> Result<RecordedFlight, Failure> {
    let path = match shipped::names().find(|shipped| Path::new(shipped) == name) {
        Some(scenario) if !name.exists() => fly(scenario)?,
        _ => name.to_owned(),
    };
    RecordedFlight::open(&path).map_err(|error| Failure::plain(&error, exit::UNFIT))
}

fn fly(name: &str) -> Result<PathBuf, Failure> {
    let scenario =
        Scenario::load(name, &[]).map_err(|error| Failure::report(error, exit::USAGE))?;
    let options = RunOptions {
        scenario,
        speed: Speed::Max,
        record: Some(RECORDINGS.into()),
        pin: Pin::Auto,
        disorder: None,
        progress: std::io::stderr().is_terminal(),
    };
    let summary = summary(run::run(&options))?;
    let unrecorded = || Failure::plain(&"the flight was not recorded", exit::UNFIT);
    summary.recording.ok_or_else(unrecorded)
}

/// The summary of a flight, or why there was none.
pub(super) fn summary(flown: Result<Summary, RunError>) -> Result<Summary, Failure> {
    flown.map_err(|error| {
        let code = match error {
            RunError::Interrupted => exit::INTERRUPTED,
            RunError::NoSuchProcessor { .. }
            | RunError::RealtimeInProcess
            | RunError::ScriptInProcess(_) => exit::USAGE,
            _ => exit::UNFIT,
        };
        Failure::plain(&error, code)
    })
}
