//! What the controllers of a slot have in common besides their law.
//!
//! [`attitude`] turns an [`attitude::AttitudeLaw`], which answers a torque to a sample, into a
//! service of the attitude slot: ports, judging of set points, bounds, reports, memory. [`position`],
//! [`preview`] and [`heading`] are what position controllers share: ports and the set point that is
//! tracked, the reference at their own instants, and the frame in which tilts are bounded. [`Limited`] holds every input to its level and its increment.
//! [`ControllerSection`] builds a controller from its section of a scenario.

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

pub mod attitude;
mod build;
pub mod heading;
mod limited;
pub mod position;
pub mod preview;
pub mod sampling;
mod setpoint;

pub use build::{ControllerSection, FlightFacts, SectionRefusal, SetpointBounds};
pub use limited::Limited;
pub use setpoint::Setpoint;

use thiserror::Error;

/// A number of a configuration outside its range, or not a number.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{name} = {value} must lie in {least}..={most}")]
pub struct OutOfRange {
    /// The parameter, as the configuration spells it.
    pub name: &'static str,
    pub value: f64,
    /// Least value accepted.
    pub least: f64,
    /// Largest value accepted.
    pub most: f64,
}

/// `Ok` if `value` lies in `least..=most`; NaN lies nowhere.
///
/// # Errors
/// [`OutOfRange`] with the name and all numbers.
pub fn within(name: &'static str, value: f64, least: f64, most: f64) -> Result<(), OutOfRange> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(OutOfRange { name, value, least, most })
    }
}
