//! The error state: its blocks and its covariance.

use nalgebra::{SMatrix, SVector};

/// Number of error states.
pub const STATE_DIMENSION: usize = 15;

/// Covariance of the error state, in the order position \[m\], velocity \[m/s\] (both world frame),
/// attitude \[rad\] (body side: `q_true = q_wb * Exp(error)`), gyro bias \[rad/s\], accelerometer bias
/// \[m/s²\] (both body frame).
pub type Covariance = SMatrix<f64, STATE_DIMENSION, STATE_DIMENSION>;

pub(super) type ErrorState = SVector<f64, STATE_DIMENSION>;

/// First row of each block of the error state (Solà eq. 235).
pub(super) const POSITION: usize = 0;
pub(super) const VELOCITY: usize = 3;
pub(super) const ATTITUDE: usize = 6;
pub(super) const GYRO_BIAS: usize = 9;
pub(super) const ACCEL_BIAS: usize = 12;

/// Makes the upper triangle the mirror of the lower, which rounding lets drift apart.
pub(super) fn symmetrize(covariance: &mut Covariance) {
    covariance.fill_upper_triangle_with_lower_triangle();
}
