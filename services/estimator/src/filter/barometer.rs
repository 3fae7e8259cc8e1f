//! Measurement model of the barometer: `y = p_z + b + n`, with a bias that walks.

use garde::Validate;
use nalgebra::{UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;

use super::error_state::{ErrorState, POSITION};
use super::measurement::{BiasModel, MeasurementModel, Predicted};

/// What the filter knows of the barometer.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct BarometerModel {
    /// White noise of a reading, 1 σ \[m\].
    #[garde(range(min = 1e-6, max = 100.0))]
    pub noise_m: f64,
    /// 1 σ of the bias at the first reading \[m\].
    #[garde(range(min = 1e-6, max = 1000.0))]
    pub initial_bias_sigma_m: f64,
    /// Random walk of the bias \[m/s/√Hz\].
    #[garde(range(min = 1e-9, max = 100.0))]
    pub bias_walk_m_s_sqrt_hz: f64,
    /// χ² gate of a reading, 1 degree of freedom.
    #[garde(range(min = 1.0, max = 1e6))]
    pub gate_chi2: f64,
    /// Largest believable height, up or down \[m\].
    #[garde(range(min = 1.0, max = 1e5))]
    pub range_m: f64,
}

impl Default for BarometerModel {
    fn default() -> Self {
        Self {
            noise_m: 0.1,
            initial_bias_sigma_m: 0.5,
            bias_walk_m_s_sqrt_hz: 0.02,
            gate_chi2: 10.828,
            range_m: 1e4,
        }
    }
}

impl MeasurementModel for BarometerModel {
    fn predict(&self, p: &Vector3<f64>, _q: &UnitQuaternion<f64>) -> Option<Predicted> {
        let mut by_error = ErrorState::zeros();
        by_error[POSITION + 2] = 1.0;
        Some(Predicted { value: p.z, by_error })
    }
    fn range(&self) -> core::ops::RangeInclusive<f64> {
        -self.range_m..=self.range_m
    }
    fn sigma(&self) -> f64 {
        self.noise_m
    }
    fn gate(&self) -> f64 {
        self.gate_chi2
    }
    fn bias(&self) -> Option<BiasModel> {
        let (initial_sigma, walk) = (self.initial_bias_sigma_m, self.bias_walk_m_s_sqrt_hz);
        Some(BiasModel { initial_sigma, walk })
    }
}
