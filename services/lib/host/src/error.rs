//! Why a process cannot fly, and what it reports to the process that started it.

use crate::exit;
use crate::realtime::Shortfall;
use runtime::ipc::PortError;
use runtime::namespace::NamespaceError;
use runtime::{Ending, GraphError, ProcessError, RateError};
use std::io::{self, Write as _};
use std::path::PathBuf;
use thiserror::Error;

/// The reason why a component refuses a configuration.
pub type BuildError = Box<dyn std::error::Error>;

/// Why a process cannot fly.
#[derive(Debug, Error)]
pub enum HostError {
    /// The run's folder.
    #[error(transparent)]
    Namespace(#[from] NamespaceError),
    /// What the launcher left of the flight in the run's folder.
    #[error("{}: {reason}; a process joins a run of the same build", path.display())]
    Flight {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The controller's own configuration.
    #[error("{}: {reason}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A rate of the flight.
    #[error(transparent)]
    Rate(#[from] RateError),
    /// The wiring of the flight.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// A role that is empty in this flight.
    #[error("this flight has no {0} loop")]
    NoSuchLoop(&'static str),
    /// A controller that was started for another slot than its own.
    #[error(
        "it writes {topic}, which belongs to the {owner} slot, and was started for {slot}: ask for --slot {owner}"
    )]
    WrongSlot {
        /// One of its outputs.
        topic: &'static str,
        /// The slot that publishes that output.
        owner: &'static str,
        /// What it was started for.
        slot: &'static str,
    },
    /// The component refuses its configuration.
    #[error(transparent)]
    Build(BuildError),
    /// Signals or the launcher cannot be watched.
    #[error("cannot watch {what}: {source}")]
    Watch {
        /// What.
        what: &'static str,
        /// Why.
        source: io::Error,
    },
    /// The flight is strict about what the system must grant.
    #[error(transparent)]
    Unfit(#[from] Shortfall),
    /// A port.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The seat could not be taken.
    #[error(transparent)]
    Process(#[from] ProcessError),
}

impl HostError {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Config { .. } | Self::Build(_) | Self::WrongSlot { .. } => exit::USAGE,
            _ => exit::UNFIT,
        }
    }
}

/// Prints how the process `name` ended, if that is worth a message, and returns its exit code.
#[must_use]
pub fn conclude(name: &str, ended: Result<Ending, HostError>) -> u8 {
    match ended {
        Ok(Ending::Finished | Ending::Retired) => exit::PASS,
        Ok(Ending::Signalled) => {
            complain(name, "stopped by a signal");
            exit::INTERRUPTED
        }
        Ok(Ending::LauncherGone) => exit::CRASHED,
        Err(error) => {
            complain(name, &error.to_string());
            error.exit_code()
        }
    }
}

/// Writes a line for which there may be no reader left.
fn complain(name: &str, what: &str) {
    let _ = writeln!(io::stderr(), "{name}: {what}");
}
