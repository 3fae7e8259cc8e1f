//! Encoder of the morph angle β.
//!
//! Its error is modelled as white and normal, 0.1° (1 σ), not as quantisation: backlash and
//! magnet errors of such encoders exceed their last digit, and a filter can be configured with a variance.

use garde::Validate;
use noise::{Noise, NoiseMemory, Source};

use super::config::{MorphEncoderConfig, SensorError};
use super::schedule::Schedule;
use super::sensor::Sensor;
use crate::ports::Outputs;
use shared_types::{TopicInfo, topics};
use vehicle::Truth;

shared_types::memory! {
    /// A [`MorphEncoder`] as plain numbers.
    #[derive(PartialEq, Eq)]
    pub struct MorphEncoderMemory {
        /// Noise generator.
        pub noise: NoiseMemory,
        /// Index of the next reading.
        pub next_index: u64,
    }
}

/// Encoder of β.
#[derive(Debug, Clone)]
pub struct MorphEncoder {
    schedule: Schedule,
    noise: Noise,
    sigma_rad: f64,
}

impl Sensor for MorphEncoder {
    type Config = MorphEncoderConfig;
    type Memory = MorphEncoderMemory;
    /// β \[rad\].
    type Reading = f64;

    const TOPIC: &'static TopicInfo = &topics::MORPH_ANGLE.info;

    fn rate_hz(config: &MorphEncoderConfig) -> u32 {
        config.rate_hz
    }

    fn new(config: &MorphEncoderConfig, seed: u64) -> Result<Self, SensorError> {
        config.validate()?;
        let sigma_rad = if config.noise_free { 0.0 } else { config.noise_deg.to_radians() };
        let schedule = Schedule::new(config.rate_hz);
        Ok(Self { schedule, noise: Noise::new(seed, Source::MORPH_ENCODER, 0), sigma_rad })
    }

    fn look(&mut self, now_ns: u64, truth: &Truth, outputs: &mut Outputs) -> Option<f64> {
        let angle_rad = self.sample(now_ns, truth.state.beta.rad())?;
        outputs.morph_angle.write(shared_types::MorphAngle { angle_rad, ..Default::default() });
        Some(angle_rad)
    }

    fn memory(&self) -> MorphEncoderMemory {
        MorphEncoderMemory { noise: self.noise.memory(), next_index: self.schedule.next_index() }
    }

    fn restore(&mut self, memory: &MorphEncoderMemory) {
        self.noise.restore(&memory.noise);
        self.schedule.set_next_index(memory.next_index);
    }

    fn reseed(&mut self, seed: u64) {
        self.noise.reseed(seed);
    }
}

impl MorphEncoder {
    /// Instant of the next reading \[ns\].
    #[must_use]
    pub fn next_sample_ns(&self) -> u64 {
        self.schedule.next_ns()
    }

    /// A reading of β \[rad\] at `now_ns`; noise may carry it past the linkage's range. `None` if
    /// none is due yet, or if the truth is not finite.
    pub fn sample(&mut self, now_ns: u64, morph_angle_rad: f64) -> Option<f64> {
        if self.schedule.take(now_ns) == 0 {
            return None;
        }
        let [error, _] = self.noise.normal2();
        let reading = morph_angle_rad + self.sigma_rad * error;
        reading.is_finite().then_some(reading)
    }
}

#[cfg(test)]
mod tests {
    use statrs::statistics::Statistics;

    use super::*;

    #[test]
    fn the_reading_scatters_by_a_tenth_of_a_degree_about_the_truth() {
        let mut encoder = MorphEncoder::new(&MorphEncoderConfig::default(), 2).unwrap();
        let errors: Vec<f64> = (0..20_000_u64)
            .filter_map(|k| encoder.sample(k * 5_000_000, 1.2))
            .map(|reading| (reading - 1.2).to_degrees())
            .collect();
        assert_eq!(errors.len(), 20_000);
        // 20 000 readings: the mean is known to 0.7 % of σ, σ to 0.5 %.
        assert!(errors.as_slice().mean().abs() < 0.003);
        assert!((errors.as_slice().std_dev() - 0.1).abs() < 0.002);
    }

    #[test]
    fn it_reads_at_its_own_rate_and_refuses_nan() {
        let mut encoder = MorphEncoder::new(&MorphEncoderConfig::default(), 2).unwrap();
        let count = (0..1000).filter(|ms| encoder.sample(ms * 1_000_000, 1.0).is_some()).count();
        assert_eq!(count, 200);
        assert_eq!(encoder.sample(2_000_000_000, f64::NAN), None);
    }

    #[test]
    fn a_noise_free_encoder_is_exact_and_a_restored_one_continues() {
        let exact = MorphEncoderConfig { noise_free: true, ..MorphEncoderConfig::default() };
        let mut encoder = MorphEncoder::new(&exact, 2).unwrap();
        assert_eq!(encoder.sample(0, 1.25), Some(1.25));

        let mut encoder = MorphEncoder::new(&MorphEncoderConfig::default(), 2).unwrap();
        let mut twin = MorphEncoder::new(&MorphEncoderConfig::default(), 3).unwrap();
        for k in 0..100 {
            twin.restore(&encoder.memory());
            assert_eq!(encoder.sample(k * 3_000_000, 1.0), twin.sample(k * 3_000_000, 1.0));
            assert_eq!(encoder.memory(), twin.memory());
        }
    }
}
