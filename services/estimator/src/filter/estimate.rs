//! What the filter publishes.

use nalgebra::{UnitQuaternion, Vector3};

use super::bias::SCALARS;
use super::error_state::STATE_DIMENSION;
use super::sample::Verdict;

shared_types::memory! {
    /// How often each verdict fell on one kind of sample.
    #[derive(PartialEq, Eq)]
    pub struct VerdictCounts {
        /// Used.
        pub accepted: u64,
        /// Refused by the innovation gate.
        pub gated: u64,
        /// Refused as not finite.
        pub not_finite: u64,
        /// Refused as out of the sensor's range.
        pub out_of_range: u64,
        /// Refused as not newer than the last.
        pub out_of_order: u64,
        /// Refused as older than the history reaches.
        pub too_old: u64,
        /// Refused as newer than the last inertial sample.
        pub ahead: u64,
        /// Refused because the innovation covariance was not positive definite.
        pub numerical: u64,
    }
}

impl VerdictCounts {
    pub(super) fn record(&mut self, verdict: Verdict) -> Verdict {
        let counter = match verdict {
            Verdict::Accepted => &mut self.accepted,
            Verdict::Gated => &mut self.gated,
            Verdict::NotFinite => &mut self.not_finite,
            Verdict::OutOfRange => &mut self.out_of_range,
            Verdict::OutOfOrder => &mut self.out_of_order,
            Verdict::TooOld => &mut self.too_old,
            Verdict::Ahead => &mut self.ahead,
            Verdict::Numerical => &mut self.numerical,
        };
        *counter = counter.saturating_add(1);
        verdict
    }

    /// Samples refused for any reason but the gate.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.not_finite
            + self.out_of_range
            + self.out_of_order
            + self.too_old
            + self.ahead
            + self.numerical
    }
}

shared_types::memory! {
    /// Everything counted since the filter was made.
    #[derive(PartialEq, Eq)]
    pub struct Counters {
        /// Inertial samples.
        pub imu: VerdictCounts,
        /// Pose fixes.
        pub pose_fix: VerdictCounts,
        /// Readings of the morph angle's encoder.
        pub morph_angle: VerdictCounts,
        /// Readings of each sensor of one number.
        pub scalars: [VerdictCounts; SCALARS],
        /// Times the inertial samples were missing for longer than `max_imu_gap_ns`.
        pub imu_gaps: u64,
        /// Times the windowed NIS test failed.
        pub nis_alarms: u64,
        /// Times the covariance was re-opened, for whatever reason.
        pub reopened: u64,
    }
}

/// What is wrong right now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "facts of their own, in any combination")]
pub struct AlarmFlags {
    /// The last full window of innovations was inconsistent with the covariance.
    pub nis: bool,
    /// The last fix was refused by the gate.
    pub fix_gated: bool,
    /// No fix has been accepted for `fix_timeout_ns`.
    pub fix_overdue: bool,
    /// The inertial samples have been missing for longer than `max_imu_gap_ns`.
    pub imu_overdue: bool,
}

/// The state as believed at the last inertial sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Instant of validity \[ns\].
    pub time_ns: u64,
    /// Position, world frame \[m\].
    pub position_w: Vector3<f64>,
    /// Velocity, world frame \[m/s\].
    pub velocity_w: Vector3<f64>,
    /// Attitude, body to world, w ≥ 0.
    pub q_wb: UnitQuaternion<f64>,
    /// Body rate, bias removed, body frame \[rad/s\].
    pub body_rate_b: Vector3<f64>,
    /// Specific force, bias removed, body frame \[m/s²\].
    pub specific_force_b: Vector3<f64>,
    /// Gyro bias, body frame \[rad/s\].
    pub gyro_bias_b: Vector3<f64>,
    /// Accelerometer bias, body frame \[m/s²\].
    pub accel_bias_b: Vector3<f64>,
    /// Morph angle \[rad\], extrapolated to `time_ns`.
    pub beta_rad: f64,
    /// Rate of the morph angle \[rad/s\].
    pub beta_rate_rad_s: f64,
    /// 1σ of the error states, in the order and units of [`Covariance`](super::Covariance), with which
    /// the state stands for the instant that was asked about.
    pub sigmas: [f64; STATE_DIMENSION],
    /// NIS of the last fix that was compared, 6 degrees of freedom.
    pub nis: f64,
    /// What is wrong right now.
    pub alarms: AlarmFlags,
    /// What happened so far.
    pub counters: Counters,
}
