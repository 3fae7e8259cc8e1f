//! Bias of a sensor of one number, beside the error state.

use super::error_state::ErrorState;

/// Sensors of one number, see [`Scalar`](super::Scalar).
pub(super) const SCALARS: usize = 2;

/// What is believed of a bias.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bias {
    /// The sensor has delivered a reading, and has a bias.
    pub(super) is_known: bool,
    /// In the sensor's unit.
    pub(super) value: f64,
    pub(super) variance: f64,
    /// Covariance with the error state.
    pub(super) cross: ErrorState,
}

impl Bias {
    /// Before the first reading, and of a sensor without one.
    pub(super) fn none() -> Self {
        Self { is_known: false, value: 0.0, variance: 0.0, cross: ErrorState::zeros() }
    }

    /// Begins to be known, with the first reading.
    pub(super) fn begin(&mut self, sigma: f64) {
        if !self.is_known {
            *self = Self { is_known: true, variance: sigma * sigma, ..Self::none() };
        }
    }

    /// It has jumped: its variance grows by that of one that is not known yet.
    pub(super) fn reopen(&mut self, sigma: f64) {
        if self.is_known {
            self.variance += sigma * sigma;
        }
    }

    /// A measurement that does not see it has corrected the error state by `gain` times `residual`; `seen` is its covariance
    /// with that measurement, whose variance is `spread`.
    pub(super) fn correct(&mut self, seen: f64, spread: f64, residual: f64, gain: &ErrorState) {
        if self.is_known {
            self.value += seen / spread * residual;
            self.variance = (self.variance - seen * seen / spread).max(0.0);
            self.cross -= gain * seen;
        }
    }
}
