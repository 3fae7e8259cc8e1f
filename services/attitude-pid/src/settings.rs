//! The section `[attitude_pid]` of a scenario.

use controller::attitude::Timing;
use controller::{ControllerSection, FlightFacts, SectionRefusal};
use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::Slot;

use crate::AttitudePid;
use crate::law::{PidConfig, PidLaw};

/// What a scenario sets of the law.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Control rate \[Hz\]; that of `[attitude_mpc]` if left out.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub rate_hz: Option<f64>,
    /// Time constant asked of the rate loop of roll, pitch and yaw \[s\], before its delay. If left out
    /// 12 ms, at least 1.2 periods, and twice that for yaw.
    #[garde(inner(inner(range(min = 1e-4, max = 100.0))))]
    pub rate_time_s: Option<[f64; 3]>,
    /// Angle loop over rate loop: rate set point per angle error, times what the rate loop takes.
    #[garde(range(min = 1e-3, max = 1.0))]
    pub angle_ratio: f64,
    /// Integral time of the rate error over what the rate loop takes.
    #[garde(range(min = 0.1, max = 1e6))]
    pub integral_ratio: f64,
    /// Largest rate set point \[rad/s\].
    #[garde(range(min = 0.01, max = 1000.0))]
    pub rate_max_rad_s: f64,
    /// Share of the torque that a turn may need to be braked in time.
    #[garde(range(min = 1e-3, max = 1.0))]
    pub braking_share: f64,
    /// Derivative time over that of its filter.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub filter_ratio: f64,
    /// Time in which the integral takes back what bounds and rotors did not give \[s\].
    #[garde(range(min = 1e-3, max = 1e3))]
    pub windup_s: f64,
    /// Rotor lag that the derivative answers \[s\]; the vehicle's if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub rotor_lag_s: Option<f64>,
}

impl Default for Settings {
    /// At 100 Hz the rate loop has a delay of 6 ms beside its lag; twice that as its time constant
    /// keeps it damped with lags of 10 to 20 ms together with 0.8 to 1.5 times the inertia.
    fn default() -> Self {
        Self {
            rate_hz: None,
            rate_time_s: None,
            angle_ratio: 0.25,
            integral_ratio: 8.0,
            rate_max_rad_s: 8.0,
            braking_share: 0.5,
            filter_ratio: 8.0,
            windup_s: 0.03,
            rotor_lag_s: None,
        }
    }
}

impl ControllerSection for Settings {
    type Service = AttitudePid;
    const SLOT: Slot = Slot::Attitude;

    fn rate_hz(&self) -> Option<f64> {
        self.rate_hz
    }

    fn build(&self, flight: &FlightFacts) -> Result<AttitudePid, SectionRefusal> {
        let config = self.law_config(flight.into());
        let law = PidLaw::new(config)?;
        Ok(AttitudePid::new(law, &flight.vehicle, config.timing, flight.start_yaw_rad))
    }
}

impl Settings {
    /// The law's numbers in a flight with these times; the period and the lag of `around` give way to
    /// the section's own.
    #[must_use]
    pub fn law_config(&self, around: Timing) -> PidConfig {
        let rotor_lag_s = self.rotor_lag_s.unwrap_or(around.rotor_lag_s);
        let period_s = self.rate_hz.map_or(around.period_s, f64::recip);
        let pace_s = (1.2 * period_s).max(0.012);
        PidConfig {
            timing: Timing { period_s, rotor_lag_s, ..around },
            rate_time_s: self.rate_time_s.unwrap_or([pace_s, pace_s, 2.0 * pace_s]),
            angle_ratio: self.angle_ratio,
            integral_ratio: self.integral_ratio,
            rate_max_rad_s: self.rate_max_rad_s,
            braking_share: self.braking_share,
            filter_ratio: self.filter_ratio,
            windup_s: self.windup_s,
        }
    }
}
