//! Gyro and accelerometer at the centre of mass.
//!
//! Reading = truth + bias + white noise, clipped to the range. White noise of density N sampled at
//! rate f has σ = N √f; a bias that walks with density K moves by σ = K / √f between samples
//! [IEEE Std 952-1997, annex C].

use garde::Validate;
use nalgebra::Vector3;
use noise::{Noise, NoiseMemory, Source};

use super::config::{BiasStep, ImuConfig, SensorError};
use super::schedule::{DropOuts, Schedule};
use super::sensor::Sensor;
use crate::ports::Outputs;
use shared_types::time::ns_from_s;
use shared_types::{Flag, TopicInfo, topics};
use vehicle::Truth;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Body rate \[rad/s\] in B.
    pub gyro_b_rad_s: Vector3<f64>,
    /// Specific force \[m/s²\] in B: acceleration minus gravity.
    pub specific_force_b_m_s2: Vector3<f64>,
    /// A component was clipped to the range.
    pub saturated: bool,
}

shared_types::memory! {
    /// An [`Imu`] as plain numbers.
    #[derive(PartialEq)]
    pub struct ImuMemory {
        /// Noise generator.
        pub noise: NoiseMemory,
        /// Index of the next sample.
        pub next_index: u64,
        /// Walking bias of the gyro \[rad/s\], without a scripted step.
        pub gyro_bias_b_rad_s: [f64; 3],
        /// Walking bias of the accelerometer \[m/s²\], without a scripted step.
        pub accelerometer_bias_b_m_s2: [f64; 3],
    }
}

/// Three axes of one kind.
#[derive(Debug, Clone)]
struct Triad {
    white: f64,
    walk: f64,
    range: f64,
    bias: Vector3<f64>,
}

impl Triad {
    fn read(
        &mut self,
        truth: Vector3<f64>,
        samples_passed: f64,
        noise: &mut Noise,
    ) -> Vector3<f64> {
        self.bias += Vector3::from(noise.normal3()) * (self.walk * samples_passed.sqrt());
        truth + self.bias + Vector3::from(noise.normal3()) * self.white
    }

    fn clip(&self, reading: Vector3<f64>) -> (Vector3<f64>, bool) {
        let clipped = reading.map(|x| x.clamp(-self.range, self.range));
        (clipped, clipped != reading)
    }
}

/// Inertial sensor.
#[derive(Debug, Clone)]
pub struct Imu {
    schedule: Schedule,
    noise: Noise,
    gyro: Triad,
    accelerometer: Triad,
    step: Option<BiasStep>,
    drop_outs: DropOuts,
}

impl Sensor for Imu {
    type Config = ImuConfig;
    type Memory = ImuMemory;
    type Reading = ImuSample;

    const TOPIC: &'static TopicInfo = &topics::IMU.info;

    fn rate_hz(config: &ImuConfig) -> u32 {
        config.rate_hz
    }

    fn new(config: &ImuConfig, seed: u64) -> Result<Self, SensorError> {
        config.validate()?;
        let mut noise = Noise::new(seed, Source::IMU, 0);
        let root_rate = f64::from(config.rate_hz).sqrt();
        let level = if config.noise_free { 0.0 } else { 1.0 };
        let mut triad = |density: f64, walk: f64, initial: f64, range: f64| Triad {
            white: level * density * root_rate,
            walk: level * walk / root_rate,
            range,
            bias: Vector3::from(noise.normal3()) * (level * initial),
        };
        let gyro = triad(
            config.gyro_noise_density_rad_s_sqrt_hz,
            config.gyro_bias_walk_rad_s2_sqrt_hz,
            config.gyro_initial_bias_rad_s,
            config.gyro_range_rad_s,
        );
        let accelerometer = triad(
            config.accelerometer_noise_density_m_s2_sqrt_hz,
            config.accelerometer_bias_walk_m_s3_sqrt_hz,
            config.accelerometer_initial_bias_m_s2,
            config.accelerometer_range_m_s2,
        );
        let schedule = Schedule::new(config.rate_hz);
        let drop_outs = DropOuts::new(&config.drop_outs);
        Ok(Self { schedule, noise, gyro, accelerometer, step: config.bias_step, drop_outs })
    }

    fn look(&mut self, now_ns: u64, truth: &Truth, outputs: &mut Outputs) -> Option<ImuSample> {
        let (rate, force) = (&truth.state.omega_b, &truth.specific_force_b_m_s2);
        let sample = self.sample(now_ns, rate, force)?;
        outputs.imu.write(shared_types::Imu {
            gyro_b_rad_s: sample.gyro_b_rad_s.into(),
            specific_force_b_m_s2: sample.specific_force_b_m_s2.into(),
            saturated: Flag::from(sample.saturated),
            ..shared_types::Imu::default()
        });
        Some(sample)
    }

    fn memory(&self) -> ImuMemory {
        ImuMemory {
            noise: self.noise.memory(),
            next_index: self.schedule.next_index(),
            gyro_bias_b_rad_s: self.gyro.bias.into(),
            accelerometer_bias_b_m_s2: self.accelerometer.bias.into(),
        }
    }

    fn restore(&mut self, memory: &ImuMemory) {
        self.noise.restore(&memory.noise);
        self.schedule.set_next_index(memory.next_index);
        self.gyro.bias = memory.gyro_bias_b_rad_s.into();
        self.accelerometer.bias = memory.accelerometer_bias_b_m_s2.into();
    }

    fn reseed(&mut self, seed: u64) {
        self.noise.reseed(seed);
    }
}

impl Imu {
    /// Instant of the next sample \[ns\].
    #[must_use]
    pub fn next_sample_ns(&self) -> u64 {
        self.schedule.next_ns()
    }

    /// A reading at `now_ns` of body rate \[rad/s\] and specific force \[m/s²\], both in B. `None`
    /// if none is due yet, if it is lost in a drop-out, or if the truth is not finite.
    pub fn sample(
        &mut self,
        now_ns: u64,
        body_rate_b_rad_s: &Vector3<f64>,
        specific_force_b_m_s2: &Vector3<f64>,
    ) -> Option<ImuSample> {
        let passed = self.schedule.take(now_ns);
        if passed == 0 {
            return None;
        }
        let (gyro_step, accelerometer_step) = self.step_at(now_ns);
        let (omega, f) =
            (body_rate_b_rad_s + gyro_step, specific_force_b_m_s2 + accelerometer_step);
        let passed = passed as f64;
        let gyro = self.gyro.read(omega, passed, &mut self.noise);
        let force = self.accelerometer.read(f, passed, &mut self.noise);
        // After the draws: a drop-out changes no other sample.
        let lost = self.drop_outs.contains(now_ns);
        if lost || !gyro.iter().chain(&force).all(|x| x.is_finite()) {
            return None;
        }
        let (gyro_b_rad_s, gyro_clipped) = self.gyro.clip(gyro);
        let (specific_force_b_m_s2, force_clipped) = self.accelerometer.clip(force);
        let saturated = gyro_clipped || force_clipped;
        Some(ImuSample { gyro_b_rad_s, specific_force_b_m_s2, saturated })
    }

    /// True bias of the gyro \[rad/s\] in B at `now_ns`, scripted step included.
    #[must_use]
    pub fn gyro_bias_b_rad_s(&self, now_ns: u64) -> Vector3<f64> {
        self.gyro.bias + self.step_at(now_ns).0
    }

    /// True bias of the accelerometer \[m/s²\] in B at `now_ns`, scripted step included.
    #[must_use]
    pub fn accelerometer_bias_b_m_s2(&self, now_ns: u64) -> Vector3<f64> {
        self.accelerometer.bias + self.step_at(now_ns).1
    }

    fn step_at(&self, now_ns: u64) -> (Vector3<f64>, Vector3<f64>) {
        match &self.step {
            Some(step) if now_ns >= ns_from_s(step.at_s) => {
                (step.gyro_b_rad_s.into(), step.accelerometer_b_m_s2.into())
            }
            _ => (Vector3::zeros(), Vector3::zeros()),
        }
    }
}

#[cfg(test)]
mod tests;
