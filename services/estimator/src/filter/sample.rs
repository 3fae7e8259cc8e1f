//! The readings of the sensors, and the answers of the filter.

use nalgebra::{UnitQuaternion, Vector3};

/// One inertial sample: instantaneous values, not means over the period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Instant of the sample \[ns\].
    pub time_ns: u64,
    /// Body rate ω, body frame \[rad/s\].
    pub gyro_rad_s: Vector3<f64>,
    /// Specific force (acceleration minus gravity), body frame \[m/s²\].
    pub accel_m_s2: Vector3<f64>,
}

/// One pose fix: arrives late, stamped at capture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseFixSample {
    /// Instant at which the pose was true \[ns\].
    pub captured_ns: u64,
    /// Position of the body, world frame \[m\].
    pub position_w: Vector3<f64>,
    /// Attitude, body to world.
    pub q_wb: UnitQuaternion<f64>,
}

/// One encoder reading of the morph angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MorphAngleSample {
    /// Instant of the reading \[ns\].
    pub time_ns: u64,
    /// Deployable angle β \[rad\].
    pub angle_rad: f64,
}

/// What became of a sample. All but `Accepted` leave the estimate untouched by its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Used.
    Accepted,
    /// The innovation gate refused it.
    Gated,
    /// A component is NaN or infinite, or a quaternion is not of unit length.
    NotFinite,
    /// A component lies outside the sensor's range.
    OutOfRange,
    /// Not newer than the last sample of its kind.
    OutOfOrder,
    /// Made before the oldest instant that the filter can still go back to.
    TooOld,
    /// A pose fix captured after the last inertial sample, or a reading of one number more than a period after it.
    Ahead,
    /// The innovation covariance was not positive definite; after a pose fix the covariance was re-opened.
    Numerical,
}
