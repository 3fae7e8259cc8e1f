//! The time that loops and samples take, as data: what a loaded machine does to a flight, without the machine.
//!
//! [`Script`] sets when a loop that is due begins, how long its step takes, from when to when it is stopped, and when a
//! sample arrives. [`Agenda`] decides which loop has its turn next on a clock that follows from
//! that alone. Neither knows what a loop is: the caller asks the loop itself what it waits for, and
//! enters it in the agenda.
//!
//! All instants are logical. Every draw depends on seed, entry and release alone, hence not on the order in which loops
//! ask for theirs, nor on how often.

#![warn(missing_docs)]

mod agenda;
mod duration;
mod script;

pub use agenda::{Agenda, Answer, Turn, TurnKind};
pub use duration::Duration;
pub use script::{
    Announcements, Arrival, LoopEffect, LoopEntry, LoopName, RecordedStep, SampleEffect,
    SampleEntry, Script, Window,
};
