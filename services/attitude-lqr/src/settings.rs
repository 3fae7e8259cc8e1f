//! The section `[attitude_lqr]` of a scenario.

use controller::attitude::Timing;
use controller::{ControllerSection, FlightFacts, SectionRefusal};
use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::Slot;

use crate::design::LqrConfig;
use crate::{AttitudeLqr, LqrError, LqrLaw};

/// What a scenario sets of the law.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Control rate \[Hz\]; that of `[attitude_mpc]` if left out.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub rate_hz: Option<f64>,
    /// Error \[rad\] that costs as much as the whole torque built up within `torque_rise_s`.
    #[garde(range(min = 1e-4, max = 10.0))]
    pub angle_error_rad: f64,
    /// Time in which the whole torque of roll, pitch and yaw builds up at the cost of `angle_error_rad` \[s\]: shorter is
    /// faster and passes more noise. If left out 6.25 ms, at least 0.6 of a period.
    #[garde(inner(inner(range(min = 1e-6, max = 100.0))))]
    pub torque_rise_s: Option<[f64; 3]>,
    /// An error of `angle_error_rad` for this long \[s\] costs as much again: shorter takes out a
    /// constant torque faster and overshoots more.
    #[garde(inner(range(min = 1e-3, max = 1e3)))]
    pub integral_s: [f64; 3],
    /// Time in which the integral takes back what bounds and rotors did not give \[s\].
    #[garde(range(min = 1e-3, max = 1e3))]
    pub windup_s: f64,
    /// Rotor lag in the model \[s\]; the vehicle's with a margin if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub rotor_lag_s: Option<f64>,
}

impl Default for Settings {
    /// Roll and pitch as fast as the MPC at the smallest size; slower where there is less torque for
    /// the inertia, because the weight is on shares of the torque.
    fn default() -> Self {
        Self {
            rate_hz: None,
            angle_error_rad: 0.2,
            torque_rise_s: None,
            integral_s: [0.1, 0.1, 0.2],
            windup_s: 0.05,
            rotor_lag_s: None,
        }
    }
}

impl ControllerSection for Settings {
    type Service = AttitudeLqr;
    const SLOT: Slot = Slot::Attitude;

    fn rate_hz(&self) -> Option<f64> {
        self.rate_hz
    }

    fn build(&self, flight: &FlightFacts) -> Result<AttitudeLqr, SectionRefusal> {
        let config = self.law_config(flight.into());
        let law = LqrLaw::new(config, &flight.vehicle).map_err(|error| match error {
            LqrError::Range(error) => error.into(),
            other => SectionRefusal::Refused {
                what: other.to_string(),
                remedy: "choose weights nearer to the defaults",
            },
        })?;
        Ok(AttitudeLqr::new(law, &flight.vehicle, config.timing, flight.start_yaw_rad))
    }
}

impl Settings {
    /// Factor on the vehicle's rotor lag in the model: a lag longer than modelled costs damping, a
    /// shorter one little.
    pub const LAG_MARGIN: f64 = 1.2;

    /// The law's numbers in a flight with these times; the period and the lag of `around` give way to
    /// the section's own.
    #[must_use]
    pub fn law_config(&self, around: Timing) -> LqrConfig {
        let rotor_lag_s = self.rotor_lag_s.unwrap_or(around.rotor_lag_s * Self::LAG_MARGIN);
        let period_s = self.rate_hz.map_or(around.period_s, f64::recip);
        LqrConfig {
            timing: Timing { period_s, rotor_lag_s, ..around },
            angle_error_rad: self.angle_error_rad,
            torque_rise_s: self.torque_rise_s.unwrap_or([(0.6 * period_s).max(0.00625); 3]),
            integral_s: self.integral_s,
            windup_s: self.windup_s,
        }
    }
}
