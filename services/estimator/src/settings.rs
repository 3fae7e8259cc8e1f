//! The section `[estimator]` of a scenario.

use garde::Validate;
use nalgebra::{UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::time::ns_from_s;

use crate::{BarometerModel, ConfigError, FilterConfig, InitialState, RangeFinderModel};

/// What a scenario sets of the filter. What is not listed here keeps the value of
/// [`FilterConfig::default`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Loop rate \[Hz\]: that of the IMU, to give an estimate at each of its samples.
    #[garde(range(min = 1.0, max = 10000.0))]
    pub rate_hz: f64,
    /// Steps from one published state to the next.
    #[garde(range(min = 1, max = 100000))]
    pub state_every: u32,
    /// White noise of the gyro \[rad/s/√Hz\].
    #[garde(range(min = 1e-9, max = 1.0))]
    pub gyro_noise_density_rad_s_sqrt_hz: f64,
    /// Random walk of the gyro's bias \[rad/s²/√Hz\].
    #[garde(range(min = 1e-9, max = 1.0))]
    pub gyro_bias_walk_rad_s2_sqrt_hz: f64,
    /// White noise of the accelerometer \[m/s²/√Hz\].
    #[garde(range(min = 1e-9, max = 10.0))]
    pub accelerometer_noise_density_m_s2_sqrt_hz: f64,
    /// Random walk of the accelerometer's bias \[m/s³/√Hz\].
    #[garde(range(min = 1e-9, max = 10.0))]
    pub accelerometer_bias_walk_m_s3_sqrt_hz: f64,
    /// 1σ of a fix's position, per axis \[m\].
    #[garde(range(min = 1e-9, max = 10.0))]
    pub fix_position_noise_m: f64,
    /// 1σ of a fix's attitude, per body axis \[rad\].
    #[garde(range(min = 1e-9, max = 1.0))]
    pub fix_attitude_noise_rad: f64,
    /// Longest delay from capture to arrival that is bridged \[s\].
    #[garde(range(min = 0.0, max = 1.0))]
    pub fix_latency_s: f64,
    /// χ² gate of a fix, 6 degrees of freedom.
    #[garde(range(min = 1.0, max = 1e6))]
    pub fix_gate_chi2: f64,
    /// Without an accepted fix for this long a flag is raised \[s\].
    #[garde(range(min = 0.001, max = 100.0))]
    pub fix_timeout_s: f64,
    /// Fixes rejected in a row after which the covariance is re-opened.
    #[garde(range(min = 1, max = 1000000))]
    pub reopen_after_rejections: u32,
    /// 1σ of the encoder of β \[°\].
    #[garde(range(min = 1e-6, max = 90.0))]
    pub morph_noise_deg: f64,
    /// χ² gate of an encoder reading, 1 degree of freedom.
    #[garde(range(min = 1.0, max = 1e6))]
    pub morph_gate_chi2: f64,
    /// 1σ of the position believed at start \[m\].
    #[garde(range(min = 1e-9, max = 100.0))]
    pub initial_position_sigma_m: f64,
    /// 1σ of the velocity believed at start \[m/s\].
    #[garde(range(min = 1e-9, max = 100.0))]
    pub initial_velocity_sigma_m_s: f64,
    /// 1σ of the attitude believed at start \[rad\].
    #[garde(range(min = 1e-9, max = 3.0))]
    pub initial_attitude_sigma_rad: f64,
    /// 1σ of the gyro's bias at start \[rad/s\].
    #[garde(range(min = 1e-9, max = 10.0))]
    pub initial_gyro_bias_sigma_rad_s: f64,
    /// 1σ of the accelerometer's bias at start \[m/s²\].
    #[garde(range(min = 1e-9, max = 100.0))]
    pub initial_accelerometer_bias_sigma_m_s2: f64,
    /// Height by air pressure.
    #[garde(dive)]
    pub barometer: BarometerModel,
    /// Distance to the ground below.
    #[garde(dive)]
    pub range_finder: RangeFinderModel,
}

impl Default for Settings {
    fn default() -> Self {
        let filter = FilterConfig::default();
        let initial = InitialState::default();
        Self {
            rate_hz: 1000.0,
            state_every: 10,
            gyro_noise_density_rad_s_sqrt_hz: filter.gyro_noise_rad_s_rthz,
            gyro_bias_walk_rad_s2_sqrt_hz: filter.gyro_walk_rad_s2_rthz,
            accelerometer_noise_density_m_s2_sqrt_hz: filter.accel_noise_m_s2_rthz,
            accelerometer_bias_walk_m_s3_sqrt_hz: filter.accel_walk_m_s3_rthz,
            fix_position_noise_m: filter.fix_position_sigma_m,
            fix_attitude_noise_rad: filter.fix_attitude_sigma_rad,
            fix_latency_s: 0.010,
            fix_gate_chi2: filter.fix_gate,
            fix_timeout_s: 0.1,
            reopen_after_rejections: 10,
            morph_noise_deg: 0.1,
            morph_gate_chi2: filter.morph_gate,
            initial_position_sigma_m: initial.position_sigma_m,
            initial_velocity_sigma_m_s: initial.velocity_sigma_m_s,
            initial_attitude_sigma_rad: initial.attitude_sigma_rad,
            initial_gyro_bias_sigma_rad_s: initial.gyro_bias_sigma_rad_s,
            initial_accelerometer_bias_sigma_m_s2: initial.accel_bias_sigma_m_s2,
            barometer: filter.barometer,
            range_finder: filter.range_finder,
        }
    }
}

impl Settings {
    /// The filter's numbers for `gravity_m_s2`, an IMU of `imu_rate_hz` and a morph encoder of `encoder_rate_hz`, checked.
    /// A gap is what is longer than two periods of a slow sensor.
    ///
    /// # Errors
    /// The first number that the filter refuses.
    pub fn filter_config(
        &self,
        gravity_m_s2: f64,
        imu_rate_hz: f64,
        encoder_rate_hz: f64,
    ) -> Result<FilterConfig, ConfigError> {
        let usual = FilterConfig::default();
        let config = FilterConfig {
            gravity_m_s2,
            gyro_noise_rad_s_rthz: self.gyro_noise_density_rad_s_sqrt_hz,
            gyro_walk_rad_s2_rthz: self.gyro_bias_walk_rad_s2_sqrt_hz,
            accel_noise_m_s2_rthz: self.accelerometer_noise_density_m_s2_sqrt_hz,
            accel_walk_m_s3_rthz: self.accelerometer_bias_walk_m_s3_sqrt_hz,
            imu_period_ns: ns_from_s(1.0 / imu_rate_hz),
            max_imu_gap_ns: usual.max_imu_gap_ns.max(ns_from_s(2.0 / imu_rate_hz)),
            fix_position_sigma_m: self.fix_position_noise_m,
            fix_attitude_sigma_rad: self.fix_attitude_noise_rad,
            fix_latency_ns: ns_from_s(self.fix_latency_s),
            fix_gate: self.fix_gate_chi2,
            fix_timeout_ns: ns_from_s(self.fix_timeout_s),
            reopen_after_rejections: self.reopen_after_rejections.into(),
            morph_sigma_rad: self.morph_noise_deg.to_radians(),
            morph_gate: self.morph_gate_chi2,
            morph_coast_ns: usual.morph_coast_ns.max(ns_from_s(2.0 / encoder_rate_hz)),
            barometer: self.barometer,
            range_finder: self.range_finder,
            ..usual
        };
        config.validate()?;
        Ok(config)
    }

    /// What is believed at the start of a flight at rest at `position_w_m`, heading `yaw_rad`.
    #[must_use]
    pub fn initial_state(
        &self,
        position_w_m: [f64; 3],
        yaw_rad: f64,
        morph_angle_rad: f64,
    ) -> InitialState {
        InitialState {
            time_ns: 0,
            position_w: Vector3::from(position_w_m),
            velocity_w: Vector3::zeros(),
            q_wb: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad),
            morph_angle_rad,
            position_sigma_m: self.initial_position_sigma_m,
            velocity_sigma_m_s: self.initial_velocity_sigma_m_s,
            attitude_sigma_rad: self.initial_attitude_sigma_rad,
            gyro_bias_sigma_rad_s: self.initial_gyro_bias_sigma_rad_s,
            accel_bias_sigma_m_s2: self.initial_accelerometer_bias_sigma_m_s2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_is_the_default_filter() {
        let settings: Settings = toml::from_str("").unwrap();
        assert!(settings.validate().is_ok());
        assert_eq!(settings.filter_config(9.81, 1000.0, 200.0), Ok(FilterConfig::default()));
        let initial = settings.initial_state([0.0; 3], 0.0, 45.0_f64.to_radians());
        assert_eq!(initial, InitialState::default());
    }

    #[test]
    fn a_latency_that_the_history_cannot_bridge_is_refused() {
        let settings: Settings = toml::from_str("fix_latency_s = 1.0").unwrap();
        let refusal = settings.filter_config(9.81, 10000.0, 200.0).unwrap_err();
        assert!(matches!(refusal, ConfigError::LatencyTooLong { .. }));
    }
}
