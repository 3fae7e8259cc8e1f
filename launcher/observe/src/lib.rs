//! What is made of the samples of a flight, one by one: its hash, what is measured of it and what it is judged by.
//!
//! [`Observer`] is what sees a flight. [`Metrics`] gathers the facts with bounded memory and judges; [`FlightHash`]
//! and [`LogHash`] show whether two flights are the same; [`stopwatch`] and [`usage`] serve programs that measure
//! times.

mod command_audit;
mod course_bins;
mod estimate_log;
mod evidence;
mod facts;
mod hash;
mod judgement;
mod loops;
mod metrics;
mod misses;
mod observer;
mod response;
pub mod stopwatch;
mod tracking;
mod upkeep;
pub mod usage;

pub use command_audit::CommandTally;
pub use facts::{FACTS, Fact, Facts, Part};
pub use hash::{FlightHash, HASH_FORM, LogHash, fingerprint, kept_hash};
pub use judgement::{Closing, ENDED, FLOWN_NS, describe_end, exit_code, read as read_end};
pub use loops::{LoopLedger, Totals, missed, seat_name, sum};
pub use metrics::{Effort, Metrics, News, VIOLATION_TOLERANCE};
pub use misses::{EdgeName, MissLog, Missed, Place, TIMING};
pub use observer::Observer;
pub use response::{AxisResponse, SETTLED_RAD, StepResponse};
pub use tracking::{Course, Tracking};
pub use upkeep::Upkeep;
