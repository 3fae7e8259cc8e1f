//! The section `[position_mpc]` of a scenario.
//!
//! Keys left out take the value that suits the rate, see [`PositionLawConfig::flight`].

use garde::Validate;
use serde::Deserialize;

use crate::{ConfigError, Horizon, PositionLawConfig, SolverKind};

/// What the position law is told by a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Control rate \[Hz\].
    #[garde(range(min = 1.0, max = 200.0))]
    pub rate_hz: f64,
    /// Np in samples.
    #[garde(range(min = 1, max = 100))]
    pub prediction_horizon: Option<u16>,
    /// Nc in samples.
    #[garde(range(min = 1, max = 50))]
    pub control_horizon: Option<u16>,
    /// W of (15) on tilt increments \[m²/rad²\].
    #[garde(range(min = 1e-9, max = 1e9))]
    pub tilt_weight: Option<f64>,
    /// W of (15) on thrust increments \[m²/N²\].
    #[garde(range(min = 1e-9, max = 1e9))]
    pub thrust_weight: Option<f64>,
    /// Bound on |φ| and |θ| \[rad\].
    #[garde(range(min = 0.01, max = 0.8))]
    pub tilt_max_rad: Option<f64>,
    /// Bound on their change in one sample \[rad\].
    #[garde(range(min = 1e-3, max = 1.6))]
    pub tilt_step_max_rad: Option<f64>,
    /// Least thrust over weight.
    #[garde(range(min = 0.0, max = 4.0))]
    pub thrust_min_weights: Option<f64>,
    /// Largest thrust over weight.
    #[garde(range(min = 0.0, max = 4.0))]
    pub thrust_max_weights: Option<f64>,
    /// Bound on the change of thrust over weight in one sample.
    #[garde(range(min = 1e-3, max = 4.0))]
    pub thrust_step_max_weights: Option<f64>,
    /// Lag of the attitude loop as seen from here \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub tilt_lag_s: Option<f64>,
    /// Delay of the attitude loop as seen from here \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub tilt_delay_s: Option<f64>,
    /// Lag of the thrust \[s\]; the vehicle's rotor lag if left out.
    #[garde(range(min = 0.0, max = 1.0))]
    pub thrust_lag_s: Option<f64>,
    /// Delay of the thrust \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub thrust_delay_s: Option<f64>,
    /// Solver of (16).
    #[garde(skip)]
    pub solver: Solver,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            rate_hz: 50.0,
            prediction_horizon: None,
            control_horizon: None,
            tilt_weight: None,
            thrust_weight: None,
            tilt_max_rad: None,
            tilt_step_max_rad: None,
            thrust_min_weights: None,
            thrust_max_weights: None,
            thrust_step_max_weights: None,
            tilt_lag_s: None,
            tilt_delay_s: None,
            thrust_lag_s: None,
            thrust_delay_s: None,
            solver: Solver::ActiveSet,
        }
    }
}

/// Solver of the quadratic program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// [`SolverKind::ActiveSet`].
    ActiveSet,
    /// [`SolverKind::Hildreth`].
    Hildreth,
    /// [`SolverKind::HildrethConverged`].
    HildrethConverged,
}

impl Settings {
    /// The law's numbers for rotors of `rotor_lag_s`, checked.
    ///
    /// # Errors
    /// The first number that the law refuses.
    pub fn law_config(&self, rotor_lag_s: f64) -> Result<PositionLawConfig, ConfigError> {
        let base = PositionLawConfig::flight(self.rate_hz);
        let config = PositionLawConfig {
            horizon: self.horizon(base.horizon),
            tilt_weight: self.tilt_weight.unwrap_or(base.tilt_weight),
            thrust_weight: self.thrust_weight.unwrap_or(base.thrust_weight),
            tilt_max_rad: self.tilt_max_rad.unwrap_or(base.tilt_max_rad),
            tilt_step_max_rad: self.tilt_step_max_rad.unwrap_or(base.tilt_step_max_rad),
            thrust_min_weights: self.thrust_min_weights.unwrap_or(base.thrust_min_weights),
            thrust_max_weights: self.thrust_max_weights.unwrap_or(base.thrust_max_weights),
            thrust_step_max_weights: self
                .thrust_step_max_weights
                .unwrap_or(base.thrust_step_max_weights),
            tilt_lag_s: self.tilt_lag_s.unwrap_or(base.tilt_lag_s),
            tilt_delay_s: self.tilt_delay_s.unwrap_or(base.tilt_delay_s),
            thrust_lag_s: self.thrust_lag_s.unwrap_or(rotor_lag_s),
            thrust_delay_s: self.thrust_delay_s.unwrap_or(base.thrust_delay_s),
            solver: self.solver.into(),
            ..base
        };
        config.validate()?;
        Ok(config)
    }

    fn horizon(&self, base: Horizon) -> Horizon {
        self.prediction_horizon.map_or(base, |prediction| Horizon {
            prediction: prediction.into(),
            control: self.control_horizon.unwrap_or(prediction.div_ceil(10).max(3)).into(),
        })
    }
}

impl From<Solver> for SolverKind {
    fn from(solver: Solver) -> Self {
        match solver {
            Solver::ActiveSet => Self::ActiveSet,
            Solver::Hildreth => Self::Hildreth,
            Solver::HildrethConverged => Self::HildrethConverged,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(toml: &str) -> Settings {
        toml::from_str(toml).unwrap()
    }

    #[test]
    fn an_empty_section_flies_the_law_of_its_rate() {
        for rate_hz in [20.0, 50.0, 100.0, 200.0] {
            let settings = settings(&format!("rate_hz = {rate_hz}"));
            assert_eq!(settings.law_config(0.015), Ok(PositionLawConfig::flight(rate_hz)));
        }
    }

    #[test]
    fn a_delay_beyond_one_period_is_refused_by_name() {
        let refusal = settings("tilt_delay_s = 0.05").law_config(0.015).unwrap_err();
        assert!(matches!(refusal, ConfigError::OutOfRange { name: "tilt_delay_s", .. }));
    }
}
