//! What a reading of one number implies about the state.

use nalgebra::{UnitQuaternion, Vector3};

use super::error_state::ErrorState;

/// What a sensor should read.
pub(super) struct Predicted {
    /// Its reading by the belief, without a bias.
    pub(super) value: f64,
    /// Derivative of that by the error state.
    pub(super) by_error: ErrorState,
}

/// The bias of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BiasModel {
    /// 1σ before the first reading.
    pub(super) initial_sigma: f64,
    /// Density of its random walk.
    pub(super) walk: f64,
}

/// How a sensor of one number reads the state.
pub(super) trait MeasurementModel {
    /// What it should read at a position \[m\] and an attitude, body to world; `None` where the model does not hold.
    fn predict(&self, p: &Vector3<f64>, q: &UnitQuaternion<f64>) -> Option<Predicted>;
    /// Readings that it can mean.
    fn range(&self) -> core::ops::RangeInclusive<f64>;
    /// White noise of a reading, 1σ.
    fn sigma(&self) -> f64;
    /// χ² gate of a reading, 1 degree of freedom.
    fn gate(&self) -> f64;
    /// Its bias, if it has one.
    fn bias(&self) -> Option<BiasModel> {
        None
    }
}
