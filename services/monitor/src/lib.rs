//! Monitor: judges the owner of a slot until it has proven itself, and trips it before the vehicle is
//! lost.
//!
//! The admission check compares the commands of a candidate while it shadows; how the vehicle responds to
//! them shows only once it commands. The monitor reads what a real vehicle can measure or estimate
//! (estimate, applied set point and command, reference, owner records) and publishes a `trip` when the
//! owner that a record calls *watched* is about to fly the vehicle to where it cannot be recovered. The
//! consumer of the slot then switches to the record's fallback by itself; only the monitor and the consumer
//! have to be running for that.
//!
//! * [`judge`] holds the criteria, as a pure function of time and numbers. Start there.
//! * [`reports`] compares what the attitude slot's owner reports of its set point with the set points themselves.
//! * [`limits`] derives their thresholds from the vehicle.
//! * [`settings`] is the section `[monitor]` of a scenario, which may replace each of them.
//! * [`component`] is the process: it decides which owner is watched; `blame.rs` which of two a finding is about,
//!   `last_trip.rs` whether a trip still counts.

mod blame;
pub mod component;
mod finding;
pub mod judge;
mod last_trip;
pub mod limits;
pub mod reports;
pub mod settings;
mod swings;
mod torque;

pub use component::{Monitor, MonitorConfig};
pub use finding::Finding;
pub use judge::{Applied, Judge, Moment, Setpoint};
pub use limits::Limits;
