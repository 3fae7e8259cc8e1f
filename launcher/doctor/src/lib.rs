//! `morphquad doctor`: what of this machine is in the way of a realtime flight.
//!
//! A check looks at one thing and gives a [`Finding`]. Those of `settings.rs` and `means.rs` read what the
//! kernel writes into files, so that tests can write other files; `rights.rs` asks for what a flight asks for,
//! `places.rs` looks at shared memory and disk, `clocks.rs` measures, `programs.rs` asks executables.

mod clocks;
mod means;
mod places;
mod programs;
mod report;
mod rights;
mod settings;
#[cfg(test)]
mod tests;

pub use report::Report;

use core::fmt;
use std::path::{Path, PathBuf};
use std::thread::{self, Builder};

/// How bad something is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// As a flight wants it.
    Ok,
    /// Flights miss more than they need to.
    Warn,
    /// Flights, or recordings, will fail.
    Fail,
}

impl Verdict {
    /// As in the report.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Ok => "OK",
            Self::Warn => "WARN",
            Self::Fail => "FAIL",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.label())
    }
}

/// What a check has found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Name of the check.
    pub check: &'static str,
    /// How bad it is.
    pub verdict: Verdict,
    /// What is the case.
    pub found: String,
    /// What to do about it; empty if nothing.
    pub remedy: String,
}

impl Finding {
    fn ok(check: &'static str, found: impl Into<String>) -> Self {
        Self { check, verdict: Verdict::Ok, found: found.into(), remedy: String::new() }
    }

    fn warn(check: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { check, verdict: Verdict::Warn, found: found.into(), remedy: remedy.into() }
    }

    fn fail(check: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { verdict: Verdict::Fail, ..Self::warn(check, found, remedy) }
    }

    /// The first, or the second where `bad`.
    fn warn_if(
        bad: bool,
        check: &'static str,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        if bad { Self::warn(check, found, remedy) } else { Self::ok(check, found) }
    }
}

/// Where the kernel's files are; somewhere else in tests.
#[derive(Debug, Clone)]
struct Machine {
    root: PathBuf,
}

impl Machine {
    /// Content of a file without the white space around it; `None` if there is none to read.
    fn read(&self, path: &str) -> Option<String> {
        let text = std::fs::read_to_string(self.root.join(path)).ok()?;
        Some(text.trim().to_owned())
    }

    fn number(&self, path: &str) -> Option<i64> {
        self.read(path)?.parse().ok()
    }
}

/// Examines the machine and what is installed; `recordings` is where flights would be recorded. Nothing
/// is changed but a file in there, which is removed again.
#[must_use]
pub fn examine(recordings: &Path) -> Report {
    let machine = Machine { root: PathBuf::from("/") };
    let before = means::Stolen::look(&machine);
    let findings = thread::scope(|scope| {
        // What waits for something other than the processor waits at once.
        let disk = || places::disk(recordings);
        let waiting = [
            Builder::new().spawn_scoped(scope, disk).map_err(|_| disk()),
            Builder::new().spawn_scoped(scope, programs::checks).map_err(|_| programs::checks()),
        ];
        let mut findings = settings::checks(&machine);
        findings.extend(rights::checks());
        findings.extend(places::shared_memory());
        findings.extend(clocks::checks());
        for waited_for in waiting {
            // Where no thread can be had it has been done at once.
            findings
                .extend(waited_for.map_or_else(|done| done, |it| it.join().unwrap_or_default()));
        }
        findings.push(before.since(&machine));
        findings
    });
    Report { findings, fixed: Vec::new() }
}

/// Does what harms no run: removes what dead runs have left in shared memory. Returns what it did.
#[must_use]
pub fn fix() -> Vec<String> {
    places::fix()
}
