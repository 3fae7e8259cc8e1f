//! How a section of a scenario becomes a controller.

use crate::OutOfRange;
use crate::preview::Landing;
use runtime::Service;
use shared_types::{PerSlot, Slot};
use thiserror::Error;
use vehicle::VehicleParameters;

/// What a controller is given about the flight that it is built for, beside its own section.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightFacts {
    /// The vehicle as it is modelled.
    pub vehicle: VehicleParameters,
    /// Heading at the start \[rad\].
    pub start_yaw_rad: f64,
    /// True if the vehicle is held in its place, so that set points come as steps, and none from a position controller.
    pub is_rig: bool,
    /// Rate of the plant, which reports what was applied \[Hz\].
    pub plant_rate_hz: f64,
    /// Rate of the loop that flies in a slot \[Hz\].
    pub rate_hz: PerSlot<f64>,
    /// Rate of a controller of the slot whose section has none \[Hz\].
    pub usual_rate_hz: PerSlot<f64>,
    /// Declared latency of the wrench command \[s\].
    pub wrench_latency_s: f64,
    /// Declared latency of the attitude set point \[s\].
    pub setpoint_latency_s: f64,
    /// Bounds on set points of a position controller whose section has none.
    pub setpoint_bounds: SetpointBounds,
    /// What a position controller flies without a reference.
    pub landing: Landing,
}

/// Bounds on what a position controller asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetpointBounds {
    /// Bound on |φ| and |θ| \[rad\].
    pub tilt_max_rad: f64,
    /// Least and largest thrust over weight.
    pub thrust_weights: [f64; 2],
    /// Bound on the change of thrust over weight in one sample.
    pub thrust_step_max_weights: f64,
}

/// Why no controller can be built from a section.
#[derive(Debug, Error)]
pub enum SectionRefusal {
    /// A number that does not go with the others.
    #[error(transparent)]
    Range(#[from] OutOfRange),
    /// Anything else.
    #[error("{what}; {remedy}")]
    Refused {
        /// What is refused.
        what: String,
        /// What to do about it.
        remedy: &'static str,
    },
}

/// A section of a scenario that is all a built-in controller is configured by.
pub trait ControllerSection {
    /// The controller.
    type Service: Service + 'static;
    /// Slot that it fills.
    const SLOT: Slot;

    /// Its control rate \[Hz\]; none for the usual one of its slot, that of its MPC.
    fn rate_hz(&self) -> Option<f64>;

    /// Bounds of its own on the least and the largest thrust over weight that it asks for. The monitor must know them: it
    /// takes a position controller that asks for more than its own thresholds for one that fails.
    fn thrust_weights(&self) -> [Option<f64>; 2] {
        [None; 2]
    }

    /// Builds it, at trim.
    ///
    /// # Errors
    /// What does not go together.
    fn build(&self, flight: &FlightFacts) -> Result<Self::Service, SectionRefusal>;

    /// Finds what [`build`](Self::build) refuses, without more effort than that needs.
    ///
    /// # Errors
    /// As there.
    fn check(&self, flight: &FlightFacts) -> Result<(), SectionRefusal> {
        self.build(flight).map(drop)
    }
}
