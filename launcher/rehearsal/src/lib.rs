//! The rehearsal of a swap: a candidate is flown ahead on a nominal plant before it flies the vehicle.
//!
//! Everything here is a function of plain numbers: no IPC, no clock, no file. [`Watcher`] makes a
//! [`Snapshot`] of the samples that a vehicle knows, [`draws`] moves it within its one-sigma,
//! [`schedule`] says which challenge comes when, [`Track`] is what a rehearsed flight left, and
//! [`judge`] sets the candidate beside the owner. The launcher derives the scenarios and flies them.

mod challenge;
mod draw;
mod judge;
mod limits;
mod snapshot;
mod track;
mod tube;
mod verdict;
mod watcher;

pub use challenge::{Axis, Challenge, Schedule, Sweep, Trial, schedule};
pub use draw::{DRAWS, Draw, draws};
pub use judge::{Flown, Lost, judge, lost};
pub use limits::{Facts, Limits, Slot};
pub use snapshot::{Guidance, Instance, Snapshot, Turn, Way};
pub use track::{Moment, Motion, Track, Wanted};
pub use tube::{Figure, Measure, Tube};
pub use verdict::{RehearsalFigures, RehearsalRefusal, Verdict};
pub use watcher::{Known, Watcher};
