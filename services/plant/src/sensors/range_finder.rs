//! Range finder that looks along the body's -z axis, at the plane z = 0 of the world.

use super::config::{DropOut, MAX_HEIGHT_RATE_HZ, SensorError, finite, later_than};
use super::schedule::{DropOuts, Schedule};
use super::sensor::Sensor;
use crate::ports::Outputs;
use garde::Validate;
use nalgebra::Vector3;
use noise::{Noise, NoiseMemory, Source};
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::{TopicInfo, topics};
use vehicle::Truth;

/// Cosine of the tilt beyond which the ground gives no echo, 60°.
const MIN_COS_TILT: f64 = 0.5;

/// Range finder.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct RangeFinderConfig {
    /// Readings per second; 0: the vehicle has no range finder.
    #[garde(range(min = 0, max = MAX_HEIGHT_RATE_HZ))]
    pub rate_hz: u32,
    /// White noise of a reading, 1 σ.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub noise_m: f64,
    /// What is nearer gives no reading.
    #[garde(range(min = 0.0, max = 100.0), custom(finite))]
    pub min_range_m: f64,
    /// What is farther away gives none, nor does a tilt of more than 60°.
    #[garde(range(min = 0.0, max = 1000.0), custom(finite), custom(later_than(self.min_range_m, "min_range_m")))]
    pub max_range_m: f64,
    /// Spans whose readings are lost.
    #[garde(dive)]
    pub drop_outs: Vec<DropOut>,
    /// No noise; range and drop-outs remain.
    #[garde(skip)]
    pub noise_free: bool,
}

impl Default for RangeFinderConfig {
    fn default() -> Self {
        Self {
            rate_hz: 0,
            noise_m: 0.02,
            min_range_m: 0.05,
            max_range_m: 4.0,
            drop_outs: Vec::new(),
            noise_free: false,
        }
    }
}

shared_types::memory! {
    /// A [`RangeFinder`] as plain numbers.
    #[derive(PartialEq, Eq)]
    pub struct RangeFinderMemory {
        /// Noise generator.
        pub noise: NoiseMemory,
        /// Index of the next reading.
        pub next_index: u64,
    }
}

/// Range finder.
#[derive(Debug, Clone)]
pub struct RangeFinder {
    schedule: Schedule,
    noise: Noise,
    sigma_m: f64,
    range_m: core::ops::RangeInclusive<f64>,
    drop_outs: DropOuts,
}

impl RangeFinder {
    /// Its part of the key of the noise, which stays as it is.
    const SOURCE: Source = Source::of_bytes(b"range_finder");

    /// A reading \[m\] at `now_ns` of a vehicle at this height \[m\] whose z axis points along `up_w` in the world. `None`
    /// if none is due yet, if the ground is out of range, or if it is lost in a drop-out.
    pub fn sample(&mut self, now_ns: u64, height_w_m: f64, up_w: &Vector3<f64>) -> Option<f64> {
        if self.schedule.take(now_ns) == 0 {
            return None;
        }
        // Drawn whether it is lost or not.
        let [error, _] = self.noise.normal2();
        let reading = height_w_m / up_w.z + error * self.sigma_m;
        let is_seen = up_w.z >= MIN_COS_TILT && self.range_m.contains(&reading);
        (is_seen && !self.drop_outs.contains(now_ns)).then_some(reading)
    }
}

impl Sensor for RangeFinder {
    type Config = RangeFinderConfig;
    type Memory = RangeFinderMemory;
    /// Range \[m\].
    type Reading = f64;

    const TOPIC: &'static TopicInfo = &topics::RANGE_FINDER.info;

    fn rate_hz(config: &RangeFinderConfig) -> u32 {
        config.rate_hz
    }

    fn new(config: &RangeFinderConfig, seed: u64) -> Result<Self, SensorError> {
        config.validate()?;
        Ok(Self {
            schedule: Schedule::new(config.rate_hz),
            noise: Noise::new(seed, Self::SOURCE, 0),
            sigma_m: if config.noise_free { 0.0 } else { config.noise_m },
            range_m: config.min_range_m..=config.max_range_m,
            drop_outs: DropOuts::new(&config.drop_outs),
        })
    }

    fn look(&mut self, now_ns: u64, truth: &Truth, outputs: &mut Outputs) -> Option<f64> {
        let state = &truth.state;
        let range_m = self.sample(now_ns, state.position_w.z, &(state.q_wb * Vector3::z()))?;
        outputs.range_finder.write(shared_types::RangeFinder { range_m, ..Default::default() });
        Some(range_m)
    }

    fn memory(&self) -> RangeFinderMemory {
        RangeFinderMemory { noise: self.noise.memory(), next_index: self.schedule.next_index() }
    }

    fn restore(&mut self, memory: &RangeFinderMemory) {
        self.noise.restore(&memory.noise);
        self.schedule.set_next_index(memory.next_index);
    }

    fn reseed(&mut self, seed: u64) {
        self.noise.reseed(seed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::statistics::Statistics;

    fn finder(noise_free: bool) -> RangeFinder {
        let config = RangeFinderConfig { rate_hz: 100, noise_free, ..Default::default() };
        RangeFinder::new(&config, 5).unwrap()
    }

    fn up_at(tilt_rad: f64) -> Vector3<f64> {
        Vector3::new(libm::sin(tilt_rad), 0.0, libm::cos(tilt_rad))
    }

    #[test]
    fn the_range_is_that_along_the_tilted_axis() {
        for (k, tilt_rad) in (0..).zip([0.0, 0.3, -0.3, 1.0]) {
            let reading = finder(true).sample(k * 10_000_000, 1.5, &up_at(tilt_rad)).unwrap();
            assert!((reading - 1.5 / libm::cos(tilt_rad)).abs() < 1e-12);
        }
    }

    #[test]
    fn there_is_no_reading_beyond_its_range_or_upside_down() {
        for (height_m, tilt_rad) in
            [(4.1, 0.0), (0.04, 0.0), (3.9, 0.5), (1.0, 1.1), (1.0, 3.0), (f64::NAN, 0.0)]
        {
            assert_eq!(finder(true).sample(0, height_m, &up_at(tilt_rad)), None, "{height_m}");
        }
        assert_eq!(finder(true).sample(0, 3.9, &up_at(0.0)), Some(3.9));
    }

    #[test]
    fn readings_scatter_by_two_centimetres_and_a_restored_one_continues() {
        let mut one = finder(false);
        let mut errors = Vec::new();
        for k in 0..5000 {
            let mut twin = finder(false);
            twin.restore(&one.memory());
            let reading = one.sample(k * 10_000_000, 2.0, &Vector3::z());
            assert_eq!(twin.sample(k * 10_000_000, 2.0, &Vector3::z()), reading);
            errors.push(reading.unwrap() - 2.0);
        }
        assert!((errors.std_dev() / 0.02 - 1.0).abs() < 0.04);
    }
}
