//! What a scenario sets for the sensors.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use thiserror::Error;

/// Fixes that can be under way at once.
pub const DELAY_LINE_LEN: usize = 32;

/// Highest rate of any sensor \[Hz\].
pub const MAX_SENSOR_RATE_HZ: u32 = 10_000;

/// Highest rate of a sensor that reads the height \[Hz\].
pub(super) const MAX_HEIGHT_RATE_HZ: u32 = 500;

/// Longest instant a configuration may name \[s\], eleven days.
const MAX_TIME_S: f64 = 1e6;

/// A sensor that cannot be built.
#[derive(Debug, Error)]
pub enum SensorError {
    /// A value is out of its range.
    #[error("a sensor's configuration is not usable:\n{0}")]
    Config(#[from] garde::Report),
    /// More fixes would be under way at once than the delay line holds.
    #[error(
        "pose fixes at rate_hz = {rate_hz} with latency_s = {latency_s} put {needed} of them under \
         way at once, but the delay line holds {DELAY_LINE_LEN}: lower the rate or the latency"
    )]
    DelayLine {
        /// Configured rate.
        rate_hz: u32,
        /// Configured latency.
        latency_s: f64,
        /// Places the two would need.
        needed: u64,
    },
}

/// Gyro and accelerometer. Components are along the body axes, forward, left, up.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct ImuConfig {
    /// Samples per second.
    #[garde(range(min = 1, max = MAX_SENSOR_RATE_HZ))]
    pub rate_hz: u32,
    /// White noise of the gyro.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub gyro_noise_density_rad_s_sqrt_hz: f64,
    /// Random walk of the gyro's bias.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub gyro_bias_walk_rad_s2_sqrt_hz: f64,
    /// Bias of the gyro at start, 1 σ.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub gyro_initial_bias_rad_s: f64,
    /// The gyro clips beyond ± this.
    #[garde(range(min = 0.1, max = 1e3), custom(finite))]
    pub gyro_range_rad_s: f64,
    /// White noise of the accelerometer.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub accelerometer_noise_density_m_s2_sqrt_hz: f64,
    /// Random walk of the accelerometer's bias.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub accelerometer_bias_walk_m_s3_sqrt_hz: f64,
    /// Bias of the accelerometer at start, 1 σ.
    #[garde(range(min = 0.0, max = 100.0), custom(finite))]
    pub accelerometer_initial_bias_m_s2: f64,
    /// The accelerometer clips beyond ± this.
    #[garde(range(min = 1.0, max = 1e4), custom(finite))]
    pub accelerometer_range_m_s2: f64,
    /// A jump of the biases, to try an estimator with.
    #[garde(dive)]
    pub bias_step: Option<BiasStep>,
    /// Spans whose samples are lost.
    #[garde(dive)]
    pub drop_outs: Vec<DropOut>,
    /// No white noise, no bias, no walk; a bias step, the ranges and drop-outs remain.
    #[garde(skip)]
    pub noise_free: bool,
}

impl Default for ImuConfig {
    fn default() -> Self {
        Self {
            rate_hz: 1000,
            gyro_noise_density_rad_s_sqrt_hz: 1.2e-4,
            gyro_bias_walk_rad_s2_sqrt_hz: 2e-5,
            gyro_initial_bias_rad_s: 0.01,
            gyro_range_rad_s: 35.0,
            accelerometer_noise_density_m_s2_sqrt_hz: 2e-3,
            accelerometer_bias_walk_m_s3_sqrt_hz: 1e-4,
            accelerometer_initial_bias_m_s2: 0.05,
            accelerometer_range_m_s2: 157.0,
            bias_step: None,
            drop_outs: Vec::new(),
            noise_free: false,
        }
    }
}

/// Added to the biases from an instant on.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct BiasStep {
    /// From here on.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// Added to the gyro.
    #[garde(inner(range(min = -100.0, max = 100.0), custom(finite)))]
    pub gyro_b_rad_s: [f64; 3],
    /// Added to the accelerometer.
    #[garde(inner(range(min = -1e3, max = 1e3), custom(finite)))]
    pub accelerometer_b_m_s2: [f64; 3],
}

/// Pose from a tracker outside.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct PoseFixConfig {
    /// Captures per second.
    #[garde(range(min = 1, max = MAX_SENSOR_RATE_HZ))]
    pub rate_hz: u32,
    /// From capture to arrival.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub latency_s: f64,
    /// Position noise per axis, 1 σ.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub position_noise_m: f64,
    /// Attitude noise per body axis, 1 σ.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub attitude_noise_rad: f64,
    /// Probability that a capture is lost, each on its own.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub drop_out_probability: f64,
    /// Spans whose captures are lost.
    #[garde(dive)]
    pub drop_outs: Vec<DropOut>,
    /// No position and attitude noise; latency and drop-outs remain.
    #[garde(skip)]
    pub noise_free: bool,
}

impl Default for PoseFixConfig {
    fn default() -> Self {
        Self {
            rate_hz: 100,
            latency_s: 0.010,
            position_noise_m: 0.002,
            attitude_noise_rad: 0.003,
            drop_out_probability: 0.0,
            drop_outs: Vec::new(),
            noise_free: false,
        }
    }
}

/// Samples or captures in [`from_s`, `until_s`) are lost.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct DropOut {
    /// First instant lost.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub from_s: f64,
    /// First instant seen again.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite), custom(later_than(self.from_s, "from_s")))]
    pub until_s: f64,
}

/// Encoder of the morph angle β.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct MorphEncoderConfig {
    /// Readings per second. With a single one the plant allocates a second behind its folding arms.
    #[garde(range(min = 2, max = MAX_SENSOR_RATE_HZ))]
    pub rate_hz: u32,
    /// Noise of β, 1 σ.
    #[garde(range(min = 0.0, max = 90.0), custom(finite))]
    pub noise_deg: f64,
    /// No noise.
    #[garde(skip)]
    pub noise_free: bool,
}

impl Default for MorphEncoderConfig {
    fn default() -> Self {
        Self { rate_hz: 200, noise_deg: 0.1, noise_free: false }
    }
}

/// Accepts finite numbers; a range alone would let NaN pass.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that the validator calls")]
pub(crate) fn finite(value: &f64, _context: &()) -> garde::Result {
    if value.is_finite() {
        Ok(())
    } else {
        Err(garde::Error::new(format!("{value} is not a number")))
    }
}

pub(super) fn later_than(start: f64, name: &'static str) -> impl Fn(&f64, &()) -> garde::Result {
    move |value, ()| {
        if *value > start {
            Ok(())
        } else {
            Err(garde::Error::new(format!("{value} is not more than {name} = {start}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imu(toml: &str) -> Result<(), String> {
        let config: ImuConfig = toml::from_str(toml).map_err(|e| e.to_string())?;
        config.validate().map_err(|e| e.to_string())
    }

    fn pose(toml: &str) -> Result<(), String> {
        let config: PoseFixConfig = toml::from_str(toml).map_err(|e| e.to_string())?;
        config.validate().map_err(|e| e.to_string())
    }

    #[test]
    fn an_empty_section_means_the_defaults_and_they_are_valid() {
        assert_eq!(imu(""), Ok(()));
        assert_eq!(pose(""), Ok(()));
        assert!(MorphEncoderConfig::default().validate().is_ok());
    }

    #[test]
    fn nan_infinite_negative_and_unknown_values_are_refused_by_name() {
        for value in ["nan", "inf", "-inf", "-1e-4"] {
            for key in ["gyro_noise_density_rad_s_sqrt_hz", "accelerometer_bias_walk_m_s3_sqrt_hz"]
            {
                let refusal = imu(&format!("{key} = {value}")).unwrap_err();
                assert!(refusal.contains(key), "{refusal}");
            }
            assert!(pose(&format!("latency_s = {value}")).is_err());
            assert!(pose(&format!("drop_out_probability = {value}")).is_err());
        }
        assert!(imu("gyro_noise = 1.0").unwrap_err().contains("unknown field"));
        assert!(imu("bias_step = { at_s = 1.0, gyro_b_rad_s = [nan, 0.0, 0.0] }").is_err());
    }

    #[test]
    fn rates_lie_between_1_hz_and_10_khz() {
        for (rate, good) in [(0, false), (1, true), (10_000, true), (10_001, false), (-5, false)] {
            assert_eq!(imu(&format!("rate_hz = {rate}")).is_ok(), good);
            assert_eq!(pose(&format!("rate_hz = {rate}")).is_ok(), good);
        }
    }

    #[test]
    fn a_drop_out_ends_after_it_begins() {
        assert_eq!(pose("drop_outs = [{ from_s = 1.0, until_s = 2.0 }]"), Ok(()));
        let refusal = pose("drop_outs = [{ from_s = 2.0, until_s = 2.0 }]").unwrap_err();
        assert!(refusal.contains("drop_outs[0].until_s"), "{refusal}");
    }
}
