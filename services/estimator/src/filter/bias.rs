//! Bias of a sensor of one number, beside the error state.

use super::error_state::ErrorState;

/// Sensors of one number, see [`Scalar`](super::Scalar).
pub(super) const SCALARS: usize = 2;

/// What is believed of a bias.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bias {
    /// In the sensor's unit.
    pub(super) value: f64,
    /// 0 before the first reading, and of a sensor without a bias.
    pub(super) variance: f64,
    /// Covariance with the error state.
    pub(super) cross: ErrorState,
}

impl Bias {
    /// Nothing is known of it, or it has none.
    pub(super) fn none() -> Self {
        Self { value: 0.0, variance: 0.0, cross: ErrorState::zeros() }
    }

    /// True once the sensor has been heard, if it has a bias.
    pub(super) fn is_known(&self) -> bool {
        self.variance > 0.0
    }

    /// Begins to be known, with the first reading.
    pub(super) fn begin(&mut self, sigma: f64) {
        if !self.is_known() {
            self.variance = sigma * sigma;
        }
    }

    /// May be anything again, as before the first reading.
    pub(super) fn reopen(&mut self, sigma: f64) {
        if self.is_known() {
            self.variance += sigma * sigma;
        }
    }
}
