//! Loops, ports, clocks, timing and ownership, once for every morphquad process.
//!
//! A component ([`Service`]) is pure; this crate gives it time, inputs and outputs. Open in order:
//! [`graph`] (which loop waits for which), [`service`] and [`input`] (what a component sees), [`executor`]
//! (when a step may run), [`process`] (the loop of a real process), [`ipc`] (ports over shared
//! memory), [`namespace`] (a run's own corner of the machine).

#![warn(missing_docs)]

pub mod arbiter;
pub mod backup;
pub mod clock;
mod collector;
pub mod component;
pub mod connect;
pub mod delays;
mod deviations;
pub mod executor;
pub mod graph;
pub mod input;
pub mod ipc;
pub mod leader;
pub mod namespace;
mod namespace_error;
pub mod output;
pub mod ownership;
pub mod pacing;
pub mod priority;
pub mod process;
pub mod rate;
mod seat_marks;
pub mod service;
mod state_header;
pub mod timed;
pub mod upkeep;
mod wakes;
pub mod watch;

pub use arbiter::setpoints::{SetpointMemory, SetpointSlot};
pub use arbiter::{ArbiterMemory, CommandArbiter, Selection};
pub use component::Component;
pub use deviations::{life_number, seat_of_loop};
pub use executor::{Executor, Place, StateSink, StepStamps};
pub use graph::MarkView;
pub use graph::{Graph, GraphError, Marks, MissPolicy, Node};
pub use input::{Input, InputCounts, InputSet, InputVisitor, Link, Source};
pub use output::{Output, OutputSet, OutputVisitor, Sink};
pub use process::{Ending, Process, ProcessError, Timing};
pub use rate::{Rate, RateError};
pub use seat_marks::SeatMarks;
pub use service::{Layout, RestoreError, Service};
pub use slot::Authority;
pub use state_header::StateHeader;
