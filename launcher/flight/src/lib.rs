//! A flight of processes: `morphquad run`, from a scenario to a flown flight, a summary and a recording.
//!
//! [`run`] starts the processes, publishes the clock, supervises and records them and sums the flight up; [`adopt`]
//! goes on with a flight whose launcher has died. `supervisor/deaths.rs` has what happens when a process dies.

mod checkpoint;
mod conductor;
mod disorder;
mod flight;
mod grants;
mod live;
mod processes;
mod rehearser;
mod stall;
mod supervisor;
pub mod tap;
mod turns;
mod viewer_process;

pub use flight::{AdoptError, AdoptOptions, adopt, run, run_measured};
