//! The rehearsal of a swap: a candidate is tested on a simulated nominal plant before it may command the
//! vehicle.
//!
//! Everything here is a function of plain numbers: no IPC, no clock, no file. [`Watcher`] makes a
//! [`Snapshot`] from the samples that a real vehicle has, [`draws`] varies it within one sigma,
//! [`schedule`] defines the challenges and their times, [`Track`] records a rehearsed flight, and
//! [`judge`] compares the candidate with the owner. The launcher derives the scenarios and flies them.
//!
//! Frames are world ENU (`_w_`) and body FLU (`_b_`); quaternions are Hamilton, scalar first.

mod challenge;
mod draw;
mod judge;
mod limits;
mod loss;
mod snapshot;
mod track;
mod tube;
mod verdict;
mod watcher;

pub use challenge::{Axis, Challenge, Schedule, Sweep, Trial, schedule};
pub use draw::{DRAWS, Draw, draws};
pub use judge::{Flown, judge, lost};
pub use limits::{Facts, Limits};
pub use loss::Lost;
pub use snapshot::{Guidance, Snapshot, Turn, Way};
pub use track::{Moment, Motion, Posture, Track, Wanted};
pub use tube::{Figure, Measure, Tube};
pub use verdict::{RehearsalFigures, RehearsalRefusal, Verdict};
pub use watcher::{Known, Watcher};
