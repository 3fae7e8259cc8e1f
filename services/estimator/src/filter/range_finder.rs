//! Measurement model of the downward range finder over the plane z = 0: `y = p_z / R₃₃ + n`.

use garde::Validate;
use nalgebra::{UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;

use super::error_state::{ATTITUDE, ErrorState, POSITION};
use super::measurement::{MeasurementModel, Predicted};

/// Cosine of the tilt beyond which a reading does not measure the height, 60°.
const MIN_COS_TILT: f64 = 0.5;

/// What the filter knows of the range finder.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct RangeFinderModel {
    /// White noise of a reading, 1 σ \[m\].
    #[garde(range(min = 1e-6, max = 10.0))]
    pub noise_m: f64,
    /// χ² gate of a reading, 1 degree of freedom.
    #[garde(range(min = 1.0, max = 1e6))]
    pub gate_chi2: f64,
    /// Largest believable range \[m\].
    #[garde(range(min = 0.01, max = 1e4))]
    pub max_range_m: f64,
}

impl Default for RangeFinderModel {
    fn default() -> Self {
        Self { noise_m: 0.02, gate_chi2: 10.828, max_range_m: 100.0 }
    }
}

impl MeasurementModel for RangeFinderModel {
    fn predict(&self, p: &Vector3<f64>, q: &UnitQuaternion<f64>) -> Option<Predicted> {
        // The world's z axis in the body: the third row of R.
        let row = q.inverse_transform_vector(&Vector3::z());
        if row.z < MIN_COS_TILT {
            return None;
        }
        let value = p.z / row.z;
        let mut by_error = ErrorState::zeros();
        by_error[POSITION + 2] = 1.0 / row.z;
        // ∂R₃₃/∂δθ = (−R₃₂, R₃₁, 0)
        by_error[ATTITUDE] = value / row.z * row.y;
        by_error[ATTITUDE + 1] = -value / row.z * row.x;
        Some(Predicted { value, by_error })
    }
    fn range(&self) -> core::ops::RangeInclusive<f64> {
        0.0..=self.max_range_m
    }
    fn sigma(&self) -> f64 {
        self.noise_m
    }
    fn gate(&self) -> f64 {
        self.gate_chi2
    }
}
