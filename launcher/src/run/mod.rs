//! `morphquad run`: from a scenario to a flown flight, a summary and a recording.

mod alone;
mod audience;
mod burst;
mod child;
mod command_audit;
mod conductor;
mod consumers;
mod disorder;
mod flight;
mod grants;
mod hash;
mod live;
mod loops;
mod metrics;
mod misses;
mod notes;
mod order_sinks;
mod owners;
mod pilot_thread;
mod post;
mod response;
mod services;
mod setup;
mod slots;
mod standstill;
mod summary;
mod supervisor;
mod tap;
mod tracking;
mod upkeep;

pub use alone::{Branched, run_branch, run_in_process};
pub use burst::Burst;
pub(crate) use child::{ChildSpec, Launch};
pub use command_audit::CommandTally;
pub use conductor::Speed;
pub use flight::{AdoptError, AdoptOptions, adopt, run, run_measured};
pub use hash::{FlightHash, LogHash, MACHINE_FIELDS};
pub(crate) use loops::{LoopLedger, seat_name};
pub(crate) use metrics::LOST_M;
pub use metrics::{Effort, Metrics, VIOLATION_TOLERANCE};
pub(crate) use misses::TIMING;
pub use misses::{EdgeName, MissLog, Missed, Place};
pub use response::{AxisResponse, SETTLED_RAD, StepResponse};
pub use setup::{LiveOptions, RunError, RunOptions};
pub use slots::SwapReport;
pub(crate) use slots::{FAULT, Means, Posts, Script, Seen, SlotWatch, Slots};
pub use summary::Summary;
pub(crate) use supervisor::{FlightError, PostEvent};
pub(crate) use tracking::Course;
pub use tracking::Tracking;
pub use upkeep::Upkeep;

/// Which processor a flight's processes stay on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pin {
    /// One processor for all in lockstep, where waking a neighbour on the same one is cheapest;
    /// free in realtime.
    Auto,
    /// Wherever the system puts them.
    None,
    /// This one.
    Cpu(usize),
}
