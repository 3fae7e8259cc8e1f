//! Loops of a flight in one process that are processes all the same: executables of users, and services
//! of our own that shall be flown as what they really are.
//!
//! Such a loop sits in a run namespace of its own, in which no other loop is. The flight's thread stands
//! in for all its neighbours: before each step it publishes what they have written and how far they have got
//! (`feeds.rs`, `namespace.rs`), wakes the process, waits for its progress (`process.rs`) and puts what it
//! writes on the queues of the flight (`outputs.rs`). What the process sees is a lockstep flight like any
//! other, step by step, so that the flight has the same bits.

mod feeds;
mod namespace;
mod outputs;
mod process;

pub(super) use process::{OutsideLoop, Start};

use core::time::Duration;
use scenario::Settings;
use scenario::candidate::Candidate;
use std::path::PathBuf;

/// How processes are started that fly in an [`InProcess`](super::InProcess) flight, and how long they are
/// waited for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outside {
    /// The `morphquad` whose services join the flight as processes, by `proc NAME`; without one they
    /// join within the flight's thread, and only executables of their own are processes.
    pub services: Option<PathBuf>,
    /// Processor for processes to stay on; a round trip is cheapest on that of the flight's thread.
    pub cpu: Option<usize>,
    /// How much processes stand back for others.
    pub nice: Option<i32>,
    /// Wall time for a process to be ready, and to leave.
    pub startup_limit: Duration,
    /// Wall time for one step, of a process that sleeps; one that only waits for a processor has more.
    pub step_limit: Duration,
}

impl Outside {
    /// Anywhere on the machine, with as much patience as the scenario's launcher has.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let seconds = |s: f64| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX);
        Self {
            services: None,
            cpu: None,
            nice: None,
            startup_limit: seconds(settings.launcher.startup_timeout_s),
            step_limit: seconds(settings.launcher.stall_timeout_s),
        }
    }
}

/// True if a scenario's script has a slot taken over by an executable of its own.
pub(crate) fn joins_executable(settings: &Settings) -> bool {
    let swaps = settings.swap.iter().map(|swap| (swap.slot, &swap.to));
    let standbys = settings.standby.iter().map(|standby| (standby.slot, &standby.name));
    let is_executable = |(slot, name): (_, &String)| {
        matches!(Candidate::find(slot, name), Ok(Candidate::Executable(_)))
    };
    swaps.chain(standbys).any(is_executable)
}

/// A process that has failed in an [`InProcess`](super::InProcess) flight.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExitReport {
    /// Name of the controller.
    pub name: String,
    /// Instant of the step that it did not complete \[ns\].
    pub at_ns: u64,
    /// What became of it.
    pub how: String,
    /// The last lines of its standard error; empty if it wrote none.
    pub last_stderr: String,
}

impl core::fmt::Display for ExitReport {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} {}", self.name, self.how)?;
        if self.last_stderr.is_empty() {
            return Ok(());
        }
        write!(f, ", its last words:\n{}\n", self.last_stderr)
    }
}
