//! `morphquad run`: from a scenario to a flown flight, a summary and a recording.

mod alone;
mod audience;
mod burst;
mod child;
mod command_audit;
mod conductor;
mod consumers;
mod course_bins;
mod disorder;
mod estimate_log;
mod evidence;
mod flight;
mod grants;
mod hash;
mod judgement;
mod live;
mod loops;
mod metrics;
mod misses;
mod notes;
mod order_sinks;
mod owners;
mod pilot_thread;
mod post;
mod rehearser;
mod response;
mod services;
mod setup;
mod slots;
mod standstill;
pub mod stopwatch;
mod summary;
mod supervisor;
mod tap;
mod tracking;
mod upkeep;
pub mod usage;

pub use alone::{FlownAlone, fly_alone, run_in_process};
pub use burst::Burst;
pub(crate) use child::{ChildSpec, Launch, RunningChild, describe};
pub use command_audit::CommandTally;
pub use conductor::Speed;
pub use consumers::Consumers;
pub use flight::{AdoptError, AdoptOptions, adopt, run, run_measured};
pub use hash::{FlightHash, LogHash, MACHINE_FIELDS};
pub use judgement::Closing;
pub use judgement::{ENDED, FLOWN_NS, read as read_end, told_end};
pub use loops::{LoopLedger, seat_name};
pub use metrics::{Effort, Metrics, VIOLATION_TOLERANCE};
pub use misses::TIMING;
pub use misses::{EdgeName, MissLog, Missed, Place};
pub(crate) use owners::RollKeeper;
pub(crate) use post::Post;
pub use response::{AxisResponse, SETTLED_RAD, StepResponse};
pub(crate) use services::{HeldServices, concerns, stand_in};
pub use setup::{LiveOptions, RunError, RunOptions};
pub(crate) use setup::{require_shared_memory, run_id};
pub use slots::FAULT;
pub use slots::SwapReport;
pub(crate) use slots::{Means, Posts, Script, Seen, SlotWatch, Slots};
pub(crate) use standstill::Standstill;
pub use summary::Summary;
pub(crate) use supervisor::{FlightError, PostEvent};
pub use tracking::Course;
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
