//! Where to fly and how wide to spread the arms, as functions of time and of what is ordered in flight.
//!
//! [`Pilot`] publishes a [`Trajectory`] with preview and a [`MorphSchedule`] with its path;
//! [`RigPilot`] holds the position slot of a rig flight and steps the attitude instead. Open
//! [`trajectory`] for the shapes, [`morph`] for the deployable angle, [`diversion`] for what orders make
//! of both, [`flight`] and [`rig`] for what is published,
//! [`settings`] for the section of a scenario.

pub mod diversion;
pub mod divert;
pub mod error;
pub mod figure_eight;
pub mod flight;
pub mod morph;
mod pace;
pub mod polynomials;
pub mod rig;
pub mod settings;
mod spline;
#[cfg(test)]
mod tests;
mod time_scaling;
pub mod trajectory;
mod trajectory_point;
pub mod waypoints;

pub use error::PilotError;
pub use figure_eight::{FigureEightConfig, Heading};
pub use flight::{Pilot, PilotConfig, PilotInputs, PilotMemory, PilotOutputs, TakenUp};
pub use morph::{MorphKnot, MorphSchedule};
pub use polynomials::{COEFFICIENTS, PathSample, Piece};
pub use rig::{AttitudeStep, RigPilot, RigPilotConfig, RigPilotOutputs};
pub use trajectory::{Trajectory, TrajectoryConfig};
pub use trajectory_point::TrajectoryPoint;
pub use waypoints::Waypoint;

/// Time between two points of a reference \[ns\]: 48 of them show a position loop more than two
/// seconds, and a cubic through two of them with their velocities is a micrometre off a figure
/// eight in 4 s.
pub const REFERENCE_SPACING_NS: u64 = 50_000_000;
/// Time between two points of a morph path \[ns\]: an attitude loop takes it for linear between them.
pub const MORPH_SPACING_NS: u64 = 20_000_000;
