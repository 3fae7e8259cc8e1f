//! Why a flight in one process cannot be flown.

use runtime::service::RestoreError;
use scenario::WiringError;
use thiserror::Error;

/// Why a flight cannot be flown to its end.
#[derive(Debug, Error)]
pub enum InProcessError {
    /// A process that cannot be given a place in the flight.
    #[error("{name} cannot fly as a process of its own: {error}")]
    Outside {
        /// The program that was to take over.
        name: String,
        /// The error of the system or the transport.
        error: String,
    },
    /// A fault of a process that no other can stand in for.
    #[error(
        "{name} fills no slot, and only a process of it can be killed or stopped: leave this fault \
         away, or fly with processes"
    )]
    NoSlot {
        /// The process that was to fail.
        name: String,
    },
    /// A slot cannot be given to the process that was to have it.
    #[error("{0}")]
    Slots(String),
    /// The loops cannot be wired.
    #[error(transparent)]
    Wiring(#[from] WiringError),
    /// A component refuses its configuration.
    #[error("{role}: {error}")]
    Component {
        /// Label of the role it fills.
        role: &'static str,
        /// Its complaint.
        error: String,
    },
    /// A component cannot go on from a state.
    #[error("{role} refuses to go on from the recorded state: {error}")]
    Restore {
        /// Label of the role.
        role: &'static str,
        /// Its complaint.
        error: RestoreError,
    },
    /// A flight whose loops take time cannot be taken up in the middle: which of them compute, and what is on the way, is in
    /// no state.
    #[error("a flight with [[timing]] is flown from its start")]
    TimingResumed,
    /// No step may run although the flight is not over: the graph is wrong.
    #[error("the flight hangs at {t_s} s: no loop may step, {role} is the furthest behind")]
    Stuck {
        /// Mark of the slowest loop \[s\].
        t_s: f64,
        /// Its label.
        role: &'static str,
    },
    /// A step panicked, which is a defect of its component.
    #[error("{role} panicked at {t_s} s: {message}")]
    Panicked {
        /// Label of the role.
        role: &'static str,
        /// Release of the step \[s\].
        t_s: f64,
        /// Its message.
        message: String,
    },
}
