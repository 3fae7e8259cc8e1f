//! Bad controllers: what a shipped law commands, spoiled in one way each.
//!
//! [`Spoiler`] is the pure part. It serves two ways: the executable `catalogue` wraps any shipped law
//! ([`Spoiled`]) and is a swap candidate like any other, and [`Altering`] spoils the candidate's commands
//! in a flight within one process.

mod altering;
mod entry;
pub mod limits;
mod spoiled;
mod spoiler;
pub mod swapped;

pub use altering::Altering;
pub use entry::{Entry, Fault, entries, late_entries};
pub use spoiled::{Builder, Spoiled};
pub use spoiler::{Seen, Spoiler};
