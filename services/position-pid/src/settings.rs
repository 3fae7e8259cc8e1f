//! The section `[position_pid]` of a scenario.

use controller::{ControllerSection, FlightFacts, SectionRefusal, SetpointBounds};
use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::Slot;

use crate::PositionPid;
use crate::law::PositionPidConfig;

/// What a scenario sets of the law; bounds left out are those of `[position_mpc]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Control rate \[Hz\]; that of `[position_mpc]` if left out.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub rate_hz: Option<f64>,
    /// Velocity per position error for x, y and z \[1/s\].
    #[garde(inner(range(min = 1e-3, max = 1e3)))]
    pub position_gain_s: [f64; 3],
    /// Acceleration per velocity error \[1/s\].
    #[garde(inner(range(min = 1e-3, max = 1e3)))]
    pub velocity_gain_s: [f64; 3],
    /// Integral time of the velocity error \[s\].
    #[garde(inner(range(min = 1e-3, max = 1e6)))]
    pub integral_s: [f64; 3],
    /// Largest velocity that a position error may ask for beside the reference's \[m/s\].
    #[garde(range(min = 1e-3, max = 1e3))]
    pub speed_max_m_s: f64,
    /// How far ahead the reference's acceleration is taken \[s\]: the lag of the attitude loop.
    #[garde(range(min = 0.0, max = 0.5))]
    pub lead_s: f64,
    /// Time in which the integral takes back what was not applied \[s\].
    #[garde(range(min = 1e-3, max = 1e3))]
    pub windup_s: f64,
    /// Bound on |φ| and |θ| \[rad\].
    #[garde(range(min = 0.01, max = 0.8))]
    pub tilt_max_rad: Option<f64>,
    /// Bound on their change in one sample \[rad\].
    #[garde(range(min = 1e-3, max = 1.6))]
    pub tilt_step_max_rad: f64,
    /// Least thrust over weight.
    #[garde(range(min = 0.0, max = 1.0))]
    pub thrust_min_weights: Option<f64>,
    /// Largest thrust over weight.
    #[garde(range(min = 1.0, max = 4.0))]
    pub thrust_max_weights: Option<f64>,
    /// Bound on the change of thrust over weight in one sample.
    #[garde(range(min = 1e-3, max = 4.0))]
    pub thrust_step_max_weights: Option<f64>,
}

impl Default for Settings {
    /// The attitude loop answers after some 55 ms, by a PID after 90: K = 1/2θ for the velocity, a
    /// quarter of it a second for the position less a tenth, integral times of 8θ \[Skogestad\].
    fn default() -> Self {
        Self {
            rate_hz: None,
            position_gain_s: [2.2, 2.2, 3.0],
            velocity_gain_s: [5.5, 5.5, 8.0],
            integral_s: [0.7, 0.7, 0.5],
            speed_max_m_s: 2.0,
            lead_s: 0.05,
            windup_s: 0.2,
            tilt_max_rad: None,
            tilt_step_max_rad: 0.10,
            thrust_min_weights: None,
            thrust_max_weights: None,
            thrust_step_max_weights: None,
        }
    }
}

impl ControllerSection for Settings {
    type Service = PositionPid;
    const SLOT: Slot = Slot::Position;

    fn rate_hz(&self) -> Option<f64> {
        self.rate_hz
    }

    fn thrust_weights(&self) -> [Option<f64>; 2] {
        [self.thrust_min_weights, self.thrust_max_weights]
    }

    fn build(&self, flight: &FlightFacts) -> Result<PositionPid, SectionRefusal> {
        let config = self.law_config(flight.usual_rate_hz[Slot::Position], &flight.setpoint_bounds);
        Ok(PositionPid::new(config, &flight.vehicle, flight.landing)?)
    }
}

impl Settings {
    /// The law's numbers, with a rate and bounds for what the section leaves out.
    #[must_use]
    pub fn law_config(&self, usual_rate_hz: f64, bounds: &SetpointBounds) -> PositionPidConfig {
        let [least, most] = bounds.thrust_weights;
        PositionPidConfig {
            rate_hz: self.rate_hz.unwrap_or(usual_rate_hz),
            position_gain_s: self.position_gain_s,
            velocity_gain_s: self.velocity_gain_s,
            integral_s: self.integral_s,
            speed_max_m_s: self.speed_max_m_s,
            lead_s: self.lead_s,
            windup_s: self.windup_s,
            tilt_max_rad: self.tilt_max_rad.unwrap_or(bounds.tilt_max_rad),
            tilt_step_max_rad: self.tilt_step_max_rad,
            thrust_weights: [
                self.thrust_min_weights.unwrap_or(least),
                self.thrust_max_weights.unwrap_or(most),
            ],
            thrust_step_max_weights: self
                .thrust_step_max_weights
                .unwrap_or(bounds.thrust_step_max_weights),
        }
    }
}
