//! Tuning of the filter: plain numbers with units, checked once.

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;

use super::barometer::BarometerModel;
use super::history::HISTORY_CAPACITY;
use super::range_finder::RangeFinderModel;

/// Room for the window of the NIS monitor.
pub const MAX_NIS_WINDOW: usize = 32;

/// 1σ added per state when the covariance is re-opened.
///
/// Sized for the faults to survive: a gyro bias jump of 0.02 rad/s is noticed when the attitude is
/// off by about 0.01 rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReopenSigmas {
    /// Position \[m\].
    pub position_m: f64,
    /// Velocity \[m/s\].
    pub velocity_m_s: f64,
    /// Attitude \[rad\].
    pub attitude_rad: f64,
    /// Gyro bias \[rad/s\].
    pub gyro_bias_rad_s: f64,
    /// Accelerometer bias \[m/s²\].
    pub accel_bias_m_s2: f64,
}

/// Noise densities, limits and monitors of the filter. Defaults are those of a small MEMS IMU and a
/// motion-capture system.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterConfig {
    /// Gravity \[m/s²\], along −z of the world.
    pub gravity_m_s2: f64,
    /// Gyro white noise \[rad/s/√Hz\].
    pub gyro_noise_rad_s_rthz: f64,
    /// Gyro bias random walk \[rad/s²/√Hz\].
    pub gyro_walk_rad_s2_rthz: f64,
    /// Accelerometer white noise \[m/s²/√Hz\].
    pub accel_noise_m_s2_rthz: f64,
    /// Accelerometer bias random walk \[m/s³/√Hz\].
    pub accel_walk_m_s3_rthz: f64,
    /// Largest believable |gyro component| \[rad/s\].
    pub gyro_range_rad_s: f64,
    /// Largest believable |accelerometer component| \[m/s²\].
    pub accel_range_m_s2: f64,
    /// Nominal period of the IMU \[ns\]. After more than that without a sample the published covariance grows, and
    /// the history must reach back far enough with it; what is integrated follows the stamps.
    pub imu_period_ns: u64,
    /// Longest step that is integrated \[ns\]; over a longer gap the state is held and opened.
    pub max_imu_gap_ns: u64,
    /// 1σ of a fix's position, per axis \[m\].
    pub fix_position_sigma_m: f64,
    /// 1σ of a fix's attitude, per body axis \[rad\].
    pub fix_attitude_sigma_rad: f64,
    /// Largest believable |position component| of a fix \[m\].
    pub fix_range_m: f64,
    /// Longest delay from capture to arrival \[ns\] that must be bridged.
    pub fix_latency_ns: u64,
    /// χ² gate of a fix, 6 degrees of freedom (0.999).
    pub fix_gate: f64,
    /// 1σ of the encoder of the morph angle \[rad\].
    pub morph_sigma_rad: f64,
    /// White acceleration that the morph angle may undergo \[rad/s²/√Hz\]. The default follows a
    /// sweep of 383 °/s without a rejection; less is quieter at rest and lags at a sweep's ends.
    pub morph_accel_noise_rad_s2_rthz: f64,
    /// χ² gate of an encoder reading, 1 degree of freedom (0.999).
    pub morph_gate: f64,
    /// Smallest believable morph angle \[rad\].
    pub morph_min_rad: f64,
    /// Largest believable morph angle \[rad\].
    pub morph_max_rad: f64,
    /// Longest time \[ns\] that the morph angle is extrapolated without a reading.
    pub morph_coast_ns: u64,
    /// Rejections in a row, of fixes or of encoder readings, after which the covariance is re-opened.
    pub reopen_after_rejections: u64,
    /// Without an accepted fix for this long \[ns\], measured at capture, a flag is raised.
    pub fix_timeout_ns: u64,
    /// Fixes in the window of the NIS monitor, at most [`MAX_NIS_WINDOW`].
    pub nis_window: usize,
    /// Alarm when the mean NIS over the window exceeds this (6 degrees of freedom each).
    pub nis_mean_alarm: f64,
    /// Noise that was found to be larger is believed to be smaller again when the mean NIS falls below this.
    pub nis_mean_quiet: f64,
    /// Alarm when the NIS of the window's mean innovation exceeds this (6 degrees of freedom).
    pub nis_bias_alarm: f64,
    /// What a re-opening adds.
    pub reopen: ReopenSigmas,
    /// Barometer, if there is one.
    pub barometer: BarometerModel,
    /// Range finder, if there is one.
    pub range_finder: RangeFinderModel,
}

impl Default for ReopenSigmas {
    fn default() -> Self {
        Self {
            position_m: 0.02,
            velocity_m_s: 0.1,
            attitude_rad: 0.02,
            gyro_bias_rad_s: 0.02,
            accel_bias_m_s2: 0.05,
        }
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self {
            gravity_m_s2: 9.81,
            gyro_noise_rad_s_rthz: 1.2e-4,
            gyro_walk_rad_s2_rthz: 2e-5,
            accel_noise_m_s2_rthz: 2e-3,
            accel_walk_m_s3_rthz: 1e-4,
            gyro_range_rad_s: 35.0,
            accel_range_m_s2: 157.0,
            imu_period_ns: 1_000_000,
            max_imu_gap_ns: 20_000_000,
            fix_position_sigma_m: 2e-3,
            fix_attitude_sigma_rad: 3e-3,
            fix_range_m: 1e4,
            fix_latency_ns: 10_000_000,
            fix_gate: 22.458,
            morph_sigma_rad: 0.1_f64.to_radians(),
            morph_accel_noise_rad_s2_rthz: 10.0,
            morph_gate: 10.828,
            morph_min_rad: 44.0_f64.to_radians(),
            morph_max_rad: 161.0_f64.to_radians(),
            morph_coast_ns: 20_000_000,
            fix_timeout_ns: 100_000_000,
            reopen_after_rejections: 10,
            nis_window: 25,
            // Per window, one false alarm in a million: χ²(150)/25 and χ²(6).
            nis_mean_alarm: 9.886,
            nis_mean_quiet: 3.26,
            nis_bias_alarm: 38.258,
            reopen: ReopenSigmas::default(),
            barometer: BarometerModel::default(),
            range_finder: RangeFinderModel::default(),
        }
    }
}

/// A configuration or initial state that no filter can be built from.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ConfigError {
    /// A parameter that must be positive and finite is not.
    #[error("{name} = {value}: must be positive and finite")]
    NotPositive {
        /// Name of the parameter.
        name: &'static str,
        value: f64,
    },
    /// The history cannot reach back to the capture of a fix.
    #[error(
        "fix_latency_ns = {latency_ns} spans more than {HISTORY_CAPACITY} samples of \
         imu_period_ns = {period_ns}: slow the IMU down or shorten the latency"
    )]
    LatencyTooLong {
        /// `fix_latency_ns` \[ns\].
        latency_ns: u64,
        /// `imu_period_ns` \[ns\].
        period_ns: u64,
    },
    /// `nis_window` is zero or larger than the fixed buffer.
    #[error("nis_window = {0}: must be 1 to {MAX_NIS_WINDOW}")]
    Window(usize),
    /// `morph_min_rad` is not below `morph_max_rad`.
    #[error("morph_min_rad = {min_rad} must be below morph_max_rad = {max_rad}")]
    MorphRange {
        /// `morph_min_rad` \[rad\].
        min_rad: f64,
        /// `morph_max_rad` \[rad\].
        max_rad: f64,
    },
    /// The initial state has a component that is not finite, or a morph angle out of its range.
    #[error("the initial {0} must be finite and within the sensor's range")]
    Initial(&'static str),
}

impl FilterConfig {
    /// Checks every parameter.
    ///
    /// # Errors
    /// [`ConfigError`] names the first parameter that is out of its domain.
    pub fn validate(&self) -> Result<(), ConfigError> {
        for (name, value) in self.positives() {
            if !(value.is_finite() && value > 0.0) {
                return Err(ConfigError::NotPositive { name, value });
            }
        }
        if self.nis_window == 0 || self.nis_window > MAX_NIS_WINDOW {
            return Err(ConfigError::Window(self.nis_window));
        }
        if self.morph_min_rad >= self.morph_max_rad {
            return Err(ConfigError::MorphRange {
                min_rad: self.morph_min_rad,
                max_rad: self.morph_max_rad,
            });
        }
        if self.fix_latency_ns / self.imu_period_ns >= HISTORY_CAPACITY as u64 {
            return Err(ConfigError::LatencyTooLong {
                latency_ns: self.fix_latency_ns,
                period_ns: self.imu_period_ns,
            });
        }
        Ok(())
    }

    fn positives(&self) -> [(&'static str, f64); 37] {
        [
            ("gravity_m_s2", self.gravity_m_s2),
            ("gyro_noise_rad_s_rthz", self.gyro_noise_rad_s_rthz),
            ("gyro_walk_rad_s2_rthz", self.gyro_walk_rad_s2_rthz),
            ("accel_noise_m_s2_rthz", self.accel_noise_m_s2_rthz),
            ("accel_walk_m_s3_rthz", self.accel_walk_m_s3_rthz),
            ("gyro_range_rad_s", self.gyro_range_rad_s),
            ("accel_range_m_s2", self.accel_range_m_s2),
            ("imu_period_ns", self.imu_period_ns as f64),
            ("max_imu_gap_ns", self.max_imu_gap_ns as f64),
            ("fix_position_sigma_m", self.fix_position_sigma_m),
            ("fix_attitude_sigma_rad", self.fix_attitude_sigma_rad),
            ("fix_range_m", self.fix_range_m),
            ("fix_gate", self.fix_gate),
            ("morph_sigma_rad", self.morph_sigma_rad),
            ("morph_accel_noise_rad_s2_rthz", self.morph_accel_noise_rad_s2_rthz),
            ("morph_gate", self.morph_gate),
            ("morph_min_rad", self.morph_min_rad),
            ("morph_max_rad", self.morph_max_rad),
            ("morph_coast_ns", self.morph_coast_ns as f64),
            ("reopen_after_rejections", self.reopen_after_rejections as f64),
            ("fix_timeout_ns", self.fix_timeout_ns as f64),
            ("nis_mean_alarm", self.nis_mean_alarm),
            ("nis_mean_quiet", self.nis_mean_quiet),
            ("nis_bias_alarm", self.nis_bias_alarm),
            ("reopen.position_m", self.reopen.position_m),
            ("reopen.velocity_m_s", self.reopen.velocity_m_s),
            ("reopen.attitude_rad", self.reopen.attitude_rad),
            ("reopen.gyro_bias_rad_s", self.reopen.gyro_bias_rad_s),
            ("reopen.accel_bias_m_s2", self.reopen.accel_bias_m_s2),
            ("barometer.noise_m", self.barometer.noise_m),
            ("barometer.initial_bias_sigma_m", self.barometer.initial_bias_sigma_m),
            ("barometer.gate_chi2", self.barometer.gate_chi2),
            ("barometer.range_m", self.barometer.range_m),
            ("barometer.bias_walk_m_s_sqrt_hz", self.barometer.bias_walk_m_s_sqrt_hz),
            ("range_finder.noise_m", self.range_finder.noise_m),
            ("range_finder.gate_chi2", self.range_finder.gate_chi2),
            ("range_finder.max_range_m", self.range_finder.max_range_m),
        ]
    }
}

/// What is believed before the first sample, with 1σ per axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InitialState {
    /// Instant at which this is believed \[ns\]; no sample may be older.
    pub time_ns: u64,
    /// Position, world frame \[m\].
    pub position_w: Vector3<f64>,
    /// Velocity, world frame \[m/s\].
    pub velocity_w: Vector3<f64>,
    /// Attitude, body to world.
    pub q_wb: UnitQuaternion<f64>,
    /// Morph angle \[rad\].
    pub morph_angle_rad: f64,
    /// 1σ of the position \[m\].
    pub position_sigma_m: f64,
    /// 1σ of the velocity \[m/s\].
    pub velocity_sigma_m_s: f64,
    /// 1σ of the attitude, per body axis \[rad\].
    pub attitude_sigma_rad: f64,
    /// 1σ of the gyro bias, which starts at zero \[rad/s\].
    pub gyro_bias_sigma_rad_s: f64,
    /// 1σ of the accelerometer bias, which starts at zero \[m/s²\].
    pub accel_bias_sigma_m_s2: f64,
}

impl Default for InitialState {
    fn default() -> Self {
        Self {
            time_ns: 0,
            position_w: Vector3::zeros(),
            velocity_w: Vector3::zeros(),
            q_wb: UnitQuaternion::identity(),
            morph_angle_rad: 45.0_f64.to_radians(),
            position_sigma_m: 0.01,
            velocity_sigma_m_s: 0.05,
            attitude_sigma_rad: 0.01,
            gyro_bias_sigma_rad_s: 0.01,
            accel_bias_sigma_m_s2: 0.05,
        }
    }
}

impl InitialState {
    /// Checks every component.
    pub(super) fn validate(&self, config: &FilterConfig) -> Result<(), ConfigError> {
        let sigmas = [
            ("position_sigma_m", self.position_sigma_m),
            ("velocity_sigma_m_s", self.velocity_sigma_m_s),
            ("attitude_sigma_rad", self.attitude_sigma_rad),
            ("gyro_bias_sigma_rad_s", self.gyro_bias_sigma_rad_s),
            ("accel_bias_sigma_m_s2", self.accel_bias_sigma_m_s2),
        ];
        for (name, value) in sigmas {
            if !(value.is_finite() && value > 0.0) {
                return Err(ConfigError::NotPositive { name, value });
            }
        }
        let finite = [
            ("position_w", self.position_w.iter().all(|x| x.is_finite())),
            ("velocity_w", self.velocity_w.iter().all(|x| x.is_finite())),
            ("q_wb", (self.q_wb.coords.norm() - 1.0).abs() < 1e-6),
            (
                "morph_angle_rad",
                (config.morph_min_rad..=config.morph_max_rad).contains(&self.morph_angle_rad),
            ),
        ];
        finite.iter().find(|(_, good)| !good).map_or(Ok(()), |(n, _)| Err(ConfigError::Initial(n)))
    }
}
