//! What happens to the processes of a flight.

use runtime::ipc::PortError;
use scenario::needs::Shortage;
use shared_types::Seat;
use thiserror::Error;

/// Why a flight cannot go on.
#[derive(Debug, Error)]
pub enum FlightError {
    /// A process cannot be started.
    #[error("{name} cannot be started: {source}")]
    Start {
        /// The process.
        name: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// There is too little shared memory for another process.
    #[error("{name} is not started: {shortage}")]
    NoRoom {
        /// The process.
        name: String,
        /// What is short.
        shortage: Shortage,
    },
    /// A process has ended before the flight began.
    #[error("{name} ended before it was ready ({how}){last_stderr}")]
    NotReady {
        /// The process.
        name: String,
        /// How it has ended.
        how: String,
        /// The last lines of its standard error.
        last_stderr: String,
    },
    /// Processes are too slow to start.
    #[error(
        "{names} not ready within {limit_s} s: raise launcher.startup_timeout_s or free the machine"
    )]
    StartupTimeout {
        /// The processes.
        names: String,
        /// The limit \[s\].
        limit_s: f64,
    },
    /// A process has ended that is not started again.
    #[error("{name} {how}{last_stderr}; {reason}")]
    Lost {
        /// The process.
        name: String,
        /// How it has ended.
        how: String,
        /// The last lines of its standard error.
        last_stderr: String,
        /// Why it is not started again.
        reason: String,
    },
    /// The transport.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// What has happened at a post in a slot.
#[derive(Debug, Clone)]
pub enum PostEvent {
    /// A process is in the registry and may be given where to begin.
    Joined {
        /// Its role and seat.
        place: Seat,
        /// Hash of the layout of its state.
        layout: u64,
        /// Period of its loop \[ns\].
        period_ns: u64,
    },
    /// A process has left, with the reason unless it did so in order.
    Gone {
        /// Its role and seat.
        place: Seat,
        /// How it has ended; none if in order.
        exit_reason: Option<String>,
    },
}

impl PostEvent {
    /// Role and seat of the process.
    #[must_use]
    pub fn place(&self) -> Seat {
        match self {
            Self::Joined { place, .. } | Self::Gone { place, .. } => *place,
        }
    }
}
