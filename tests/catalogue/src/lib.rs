//! Bad controllers for tests: shipped laws, each with one fault in its commands.
//!
//! [`Spoiler`] is the pure part, which is used in two ways: the executable `catalogue` wraps any shipped law
//! ([`Spoiled`]) and is a swap candidate like any other, and [`Altering`] alters the candidate's commands in
//! a flight within one process.

mod altering;
mod entry;
pub mod limits;
mod received;
mod spoiled;
mod spoiler;
pub mod swapped;

pub use altering::Altering;
pub use entry::{Entry, Fault, entries, entries_of_pairs, late_entries, patient_entries};
pub use received::Received;
pub use spoiled::{Builder, Spoiled};
pub use spoiler::{Seen, Spoiler};
