//! Height by air pressure.
//!
//! Reading = height + bias + white noise. The bias stands for the weather and the temperature of the sensor: it is drawn
//! at the start and walks, by σ = K / √f between readings at the rate f (IEEE Std 952-1997, annex C).

use super::config::{DropOut, MAX_HEIGHT_RATE_HZ, SensorError, finite};
use super::schedule::{DropOuts, Schedule};
use super::sensor::Sensor;
use crate::ports::Outputs;
use garde::Validate;
use noise::{Noise, NoiseMemory, Source};
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::{TopicInfo, topics};
use vehicle::Truth;

/// Barometer.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct BarometerConfig {
    /// Readings per second; 0: the vehicle has no barometer.
    #[garde(range(min = 0, max = MAX_HEIGHT_RATE_HZ))]
    pub rate_hz: u32,
    /// White noise of a reading, 1 σ.
    #[garde(range(min = 0.0, max = 100.0), custom(finite))]
    pub noise_m: f64,
    /// Bias at start, 1 σ.
    #[garde(range(min = 0.0, max = 1000.0), custom(finite))]
    pub initial_bias_m: f64,
    /// Random walk of the bias.
    #[garde(range(min = 0.0, max = 100.0), custom(finite))]
    pub bias_walk_m_s_sqrt_hz: f64,
    /// Spans whose readings are lost.
    #[garde(dive)]
    pub drop_outs: Vec<DropOut>,
    /// No noise, no bias, no walk; drop-outs remain.
    #[garde(skip)]
    pub noise_free: bool,
}

impl Default for BarometerConfig {
    fn default() -> Self {
        Self {
            rate_hz: 0,
            noise_m: 0.1,
            initial_bias_m: 0.5,
            bias_walk_m_s_sqrt_hz: 0.02,
            drop_outs: Vec::new(),
            noise_free: false,
        }
    }
}

shared_types::memory! {
    /// A [`Barometer`] as plain numbers.
    #[derive(PartialEq)]
    pub struct BarometerMemory {
        /// Noise generator.
        pub noise: NoiseMemory,
        /// Index of the next reading.
        pub next_index: u64,
        /// Walking bias \[m\].
        pub bias_m: f64,
    }
}

/// Barometer.
#[derive(Debug, Clone)]
pub struct Barometer {
    schedule: Schedule,
    noise: Noise,
    sigma_m: f64,
    walk_m: f64,
    bias_m: f64,
    drop_outs: DropOuts,
}

impl Barometer {
    /// Its part of the key of the noise, which stays as it is.
    const SOURCE: Source = Source::of_bytes(b"barometer");

    /// A reading of a height \[m\] at `now_ns`. `None` if none is due yet, if it is lost in a drop-out, or if the height
    /// is not finite.
    pub fn sample(&mut self, now_ns: u64, height_w_m: f64) -> Option<f64> {
        let passed = self.schedule.take(now_ns);
        if passed == 0 {
            return None;
        }
        let [walked, error] = self.noise.normal2();
        self.bias_m += walked * self.walk_m * f64::sqrt(passed as f64);
        let reading = height_w_m + self.bias_m + error * self.sigma_m;
        // After the draws: a drop-out changes no other reading.
        (!self.drop_outs.contains(now_ns) && reading.is_finite()).then_some(reading)
    }
}

impl Sensor for Barometer {
    type Config = BarometerConfig;
    type Memory = BarometerMemory;
    /// Height \[m\].
    type Reading = f64;

    const TOPIC: &'static TopicInfo = &topics::BAROMETER.info;

    fn rate_hz(config: &BarometerConfig) -> u32 {
        config.rate_hz
    }

    fn new(config: &BarometerConfig, seed: u64) -> Result<Self, SensorError> {
        config.validate()?;
        let mut noise = Noise::new(seed, Self::SOURCE, 0);
        let level = if config.noise_free { 0.0 } else { 1.0 };
        let [initial, _] = noise.normal2();
        let root_rate = f64::sqrt(config.rate_hz.max(1).into());
        Ok(Self {
            schedule: Schedule::new(config.rate_hz),
            noise,
            sigma_m: level * config.noise_m,
            walk_m: level * config.bias_walk_m_s_sqrt_hz / root_rate,
            bias_m: level * config.initial_bias_m * initial,
            drop_outs: DropOuts::new(&config.drop_outs),
        })
    }

    fn look(&mut self, now_ns: u64, truth: &Truth, outputs: &mut Outputs) -> Option<f64> {
        let height_w_m = self.sample(now_ns, truth.state.position_w.z)?;
        outputs.barometer.write(shared_types::Barometer { height_w_m, ..Default::default() });
        Some(height_w_m)
    }

    fn memory(&self) -> BarometerMemory {
        let Self { schedule, noise, bias_m, .. } = self;
        BarometerMemory {
            noise: noise.memory(),
            next_index: schedule.next_index(),
            bias_m: *bias_m,
        }
    }

    fn restore(&mut self, memory: &BarometerMemory) {
        self.noise.restore(&memory.noise);
        self.schedule.set_next_index(memory.next_index);
        self.bias_m = memory.bias_m;
    }

    fn reseed(&mut self, seed: u64) {
        self.noise.reseed(seed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::statistics::Statistics;

    const PERIOD_NS: u64 = 20_000_000;

    fn at_50_hz() -> BarometerConfig {
        BarometerConfig { rate_hz: 50, ..BarometerConfig::default() }
    }

    #[test]
    fn without_a_rate_there_is_none() {
        let mut none = Barometer::new(&BarometerConfig::default(), 1).unwrap();
        assert!((0..1000).all(|ms| none.sample(ms * 1_000_000, 1.0).is_none()));
    }

    #[test]
    fn readings_scatter_about_a_bias_that_walks_by_its_density() {
        let (mut firsts, mut walked, mut scatter) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 0..400 {
            let mut barometer = Barometer::new(&at_50_hz(), seed).unwrap();
            let first = barometer.memory().bias_m;
            for k in 0..500 {
                let reading = barometer.sample(k * PERIOD_NS, 2.0).unwrap();
                scatter.push(reading - 2.0 - barometer.memory().bias_m);
            }
            firsts.push(first);
            walked.push(barometer.memory().bias_m - first);
        }
        // 400 draws: σ is known to 3.5 %, and 0.02 m/√s for ten seconds are 0.063 m.
        assert!((firsts.std_dev() / 0.5 - 1.0).abs() < 0.15);
        assert!((walked.std_dev() / (0.02 * f64::sqrt(10.0)) - 1.0).abs() < 0.15);
        assert!((scatter.std_dev() / 0.1 - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_drop_out_changes_no_other_reading_and_a_restored_one_continues() {
        let drop_outs = vec![DropOut { from_s: 0.1, until_s: 0.2 }];
        let dropping = BarometerConfig { drop_outs, ..at_50_hz() };
        let mut whole = Barometer::new(&at_50_hz(), 3).unwrap();
        let mut holed = Barometer::new(&dropping, 3).unwrap();
        let mut twin = Barometer::new(&dropping, 4).unwrap();
        for k in 0..20 {
            twin.restore(&holed.memory());
            let reading = whole.sample(k * PERIOD_NS, 1.0);
            let expected = if (5..10).contains(&k) { None } else { reading };
            assert_eq!(holed.sample(k * PERIOD_NS, 1.0), expected, "{k}");
            assert_eq!(twin.sample(k * PERIOD_NS, 1.0), expected, "{k}");
        }
    }
}
