//! What a flight is asked for and what it sums up to, and flights in one thread.
//!
//! [`RunOptions`] is the order, [`Sinks`] takes everything that a flight publishes, and [`Summary`] is what came of
//! it, whatever flew it. [`in_process`] flies the components of a flight in a single thread, [`alone`] does so as
//! `run` does, [`rehearse`] flies a swap ahead, and [`mod@fan_out`] uses all cores for many such flights.

pub mod alone;
pub mod fan_out;
pub mod in_process;
pub mod rehearse;
pub mod setup;
mod sinks;
mod summary;

pub use alone::{FlownAlone, fly_alone, run_in_process};
pub use setup::{LiveOptions, Pin, RunError, RunOptions, Speed};
pub use sinks::Sinks;
pub use summary::Summary;
