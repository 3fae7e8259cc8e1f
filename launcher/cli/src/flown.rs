//! Commands that show a flight take a recording, or a scenario that is flown for it.

use super::refusal::Failure;
use document::{shell_path, suggestion};
use host::exit;
use protocol::control::runs::{self, Run};
use record::named::{FOLDER, latest, newest};
use record::read::RecordedFlight;
use runtime::leader::leading;
use scenario::{Scenario, shipped};
use simulate::{Pin, RunError, RunOptions, Speed, Summary};
use std::io::{IsTerminal as _, Write};
use std::path::{Path, PathBuf};

/// So many are named to choose from.
const LISTED: usize = 5;

/// What a command that shows a flight is to show: what is named, or else the latest recording, reported to
/// `diagnostics`.
pub(super) fn named_or_latest(
    name: Option<&Path>,
    diagnostics: &mut dyn Write,
) -> Result<PathBuf, Failure> {
    if let Some(name) = name {
        return Ok(name.to_owned());
    }
    let path = latest().map_err(|error| {
        let known = shipped::names().collect::<Vec<_>>().join(", ");
        unreadable(&format!("{error}\nor name a scenario, to be flown first: {known}"))
    })?;
    writeln!(diagnostics, "morphquad: the latest recording, {}", path.display())?;
    Ok(path)
}

/// Opens a recording, or the one of a shipped scenario, flown now, if that is what `name` names.
pub(super) fn open(name: &Path) -> Result<RecordedFlight, Failure> {
    let path = match shipped::names().find(|shipped| Path::new(shipped) == name) {
        Some(scenario) if !name.exists() => fly(scenario)?,
        _ => name.to_owned(),
    };
    RecordedFlight::open(&path).map_err(|error| {
        let reason = format!("{error}{}", hints(&path));
        if path.exists() {
            return unreadable(&reason);
        }
        let known = suggestion(&name.to_string_lossy(), shipped::names());
        unreadable(&format!("{reason}\nor name a scenario, to be flown first: {known}"))
    })
}

/// Opens a recording; one that cannot be read, or is none, was asked for wrongly, by every command.
pub(super) fn recorded(path: &Path) -> Result<RecordedFlight, Failure> {
    RecordedFlight::open(path).map_err(|error| unreadable(&format!("{error}{}", hints(path))))
}

/// What a user may have meant by a name that is no recording; nothing about a damaged one.
fn hints(path: &Path) -> String {
    if path.is_dir() {
        return listed("recordings in it", newest(path));
    }
    if path.exists() {
        let is_toml = path.extension().is_some_and(|kind| kind == "toml");
        return if is_toml {
            let path = shell_path(path);
            format!("\nis it a scenario? `morphquad run {path}` flies and records it")
        } else {
            String::new()
        };
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let folders = [path.parent().unwrap_or(Path::new("")), Path::new(FOLDER), Path::new("")];
    let near = folders.map(|folder| newest(if folder == "" { Path::new(".") } else { folder }));
    let alike = |found: &&PathBuf| {
        let stem = found.file_stem().unwrap_or_default().to_string_lossy();
        stem.starts_with(name.trim_end_matches(".mcap")) && !name.is_empty()
    };
    if let Some(meant) = near.iter().flatten().find(alike) {
        return format!("\ndid you mean {}?", meant.display());
    }
    let found = near.into_iter().find(|found| !found.is_empty());
    listed("recordings here", found.unwrap_or_default())
}

fn listed(what: &str, mut found: Vec<PathBuf>) -> String {
    let more = found.len().saturating_sub(LISTED);
    found.truncate(LISTED);
    let names: Vec<String> = found.iter().map(|path| path.display().to_string()).collect();
    match (names.is_empty(), more) {
        (true, _) => String::new(),
        (_, 0) => format!("\n{what}: {}", names.join(", ")),
        (_, more) => format!("\n{what}: {} and {more} older", names.join(", ")),
    }
}

/// Runs that are being recorded at this moment.
pub(super) struct Writers(Vec<Run>);

impl Writers {
    /// Those that are running.
    pub(super) fn now() -> Self {
        let mut living = runs::living();
        living.retain(|run| leading(run.folder()).is_some());
        Self(living)
    }

    /// The run that still writes a recording.
    pub(super) fn of(&self, flight: &RecordedFlight) -> Option<String> {
        let run = flight.facts().get("run_id")?;
        self.0.iter().any(|living| living.id() == run).then(|| run.clone())
    }
}

/// As [`recorded`], where the trouble shows further on in the file.
pub(super) fn unreadable(error: &dyn core::fmt::Display) -> Failure {
    Failure::plain(&error, exit::USAGE)
}

fn fly(name: &str) -> Result<PathBuf, Failure> {
    let scenario =
        Scenario::load(name, &[]).map_err(|error| Failure::report(error, exit::USAGE))?;
    let options = RunOptions {
        scenario,
        speed: Speed::Max,
        record: Some(FOLDER.into()),
        name: None,
        pin: Pin::Auto,
        disorder: None,
        progress: std::io::stderr().is_terminal(),
        live: None,
    };
    let summary = summary(flight::run(&options))?;
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
            RunError::NotServed { exit_code, .. } => exit_code,
            _ => exit::UNFIT,
        };
        Failure::plain(&error, code)
    })
}
