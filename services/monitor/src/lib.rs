//! Monitor: judges the owner of a slot until it has proven itself, and trips it before the vehicle is
//! lost.
//!
//! An admission check compares what a candidate says while it shadows; what it does with the vehicle
//! shows only once it commands. The monitor reads what a vehicle knows (estimate, applied set point and
//! command, reference, owner records) and publishes a `trip` when the owner that a record calls
//! *watched* flies the vehicle out of what can be recovered. Whoever obeys the slot then moves to the
//! record's fallback by itself; nobody has to be alive for that but the monitor and the consumer.
//!
//! * [`judge`] holds the criteria, as a pure function of time and numbers. Start there.
//! * [`limits`] derives their thresholds from the vehicle.
//! * [`settings`] is the section `[watch]` of a scenario, which may replace each of them.
//! * [`component`] is the process: which owner is watched, and which of two is to blame.

pub mod component;
pub mod judge;
pub mod limits;
pub mod settings;
mod swings;

pub use component::{Monitor, MonitorConfig};
pub use judge::{Applied, Finding, Judge, Moment, Setpoint};
pub use limits::Limits;
