//! Pose from a tracker outside: stamped at capture, delivered a latency later, sometimes lost.

use garde::Validate;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use noise::{Noise, NoiseMemory, Source};

use super::config::{DELAY_LINE_LEN, PoseFixConfig, SensorError};
use super::schedule::{DropOuts, Schedule};
use super::sensor::Sensor;
use crate::ports::Outputs;
use shared_types::time::ns_from_s;
use shared_types::{TopicInfo, topics};
use vehicle::{Truth, components};

/// Where the vehicle is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Position \[m\] in W.
    pub position_w_m: Vector3<f64>,
    /// Attitude, body to world.
    pub q_wb: UnitQuaternion<f64>,
}

/// A fix that has arrived.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseSample {
    /// When the pose was true \[ns\].
    pub captured_ns: u64,
    /// When it arrived, capture plus latency \[ns\].
    pub arrived_ns: u64,
    /// The pose as measured, w ≥ 0.
    pub pose: Pose,
}

shared_types::memory! {
    /// A [`PoseFix`] as plain numbers.
    #[derive(PartialEq)]
    pub struct PoseFixMemory {
        /// Noise generator.
        pub noise: NoiseMemory,
        /// Index of the next capture.
        pub next_index: u64,
        /// Place of the oldest fix under way.
        pub oldest: u64,
        /// Fixes under way.
        pub count: u64,
        /// Capture instants by place \[ns\].
        pub captured_ns: [u64; DELAY_LINE_LEN],
        /// x, y, z \[m\], then q w, x, y, z, by place.
        pub poses: [[f64; 7]; DELAY_LINE_LEN],
    }
}

/// Tracker.
#[derive(Debug, Clone)]
pub struct PoseFix {
    schedule: Schedule,
    noise: Noise,
    latency_ns: u64,
    sigma_position: f64,
    sigma_attitude: f64,
    drop_out_probability: f64,
    drop_outs: DropOuts,
    oldest: usize,
    count: usize,
    captured_ns: [u64; DELAY_LINE_LEN],
    poses: [[f64; 7]; DELAY_LINE_LEN],
}

impl Sensor for PoseFix {
    type Config = PoseFixConfig;
    type Memory = PoseFixMemory;
    type Reading = PoseSample;

    const TOPIC: &'static TopicInfo = &topics::POSE_FIX.info;

    fn rate_hz(config: &PoseFixConfig) -> u32 {
        config.rate_hz
    }

    /// # Errors
    /// [`SensorError::Config`] for a value out of its range, [`SensorError::DelayLine`] if rate
    /// times latency is more than the delay line holds.
    fn new(config: &PoseFixConfig, seed: u64) -> Result<Self, SensorError> {
        config.validate()?;
        let (rate_hz, latency_s) = (config.rate_hz, config.latency_s);
        let latency_ns = ns_from_s(latency_s);
        // One more than fit into the latency, for a fix that leaves as the next one enters.
        let needed = latency_ns.saturating_mul(u64::from(rate_hz)).div_ceil(1_000_000_000) + 1;
        if needed > DELAY_LINE_LEN as u64 {
            return Err(SensorError::DelayLine { rate_hz, latency_s, needed });
        }
        let level = if config.noise_free { 0.0 } else { 1.0 };
        Ok(Self {
            schedule: Schedule::new(rate_hz),
            noise: Noise::new(seed, Source::POSE_FIX, 0),
            latency_ns,
            sigma_position: level * config.position_noise_m,
            sigma_attitude: level * config.attitude_noise_rad,
            drop_out_probability: config.drop_out_probability,
            drop_outs: DropOuts::new(&config.drop_outs),
            oldest: 0,
            count: 0,
            captured_ns: [0; DELAY_LINE_LEN],
            poses: [[0.0; 7]; DELAY_LINE_LEN],
        })
    }

    fn look(&mut self, now_ns: u64, truth: &Truth, outputs: &mut Outputs) -> Option<PoseSample> {
        let state = &truth.state;
        self.capture(now_ns, &Pose { position_w_m: state.position_w, q_wb: state.q_wb });
        let fix = self.deliver(now_ns)?;
        outputs.pose_fix.write(shared_types::PoseFix {
            captured_ns: fix.captured_ns,
            position_w_m: fix.pose.position_w_m.into(),
            q_wb: shared_types::Quaternion::from_array(components(fix.pose.q_wb)),
            ..shared_types::PoseFix::default()
        });
        Some(fix)
    }

    fn memory(&self) -> PoseFixMemory {
        PoseFixMemory {
            noise: self.noise.memory(),
            next_index: self.schedule.next_index(),
            oldest: self.oldest as u64,
            count: self.count as u64,
            captured_ns: self.captured_ns,
            poses: self.poses,
        }
    }

    fn reseed(&mut self, seed: u64) {
        self.noise.reseed(seed);
    }

    fn restore(&mut self, memory: &PoseFixMemory) {
        let place = |value: u64| usize::try_from(value).unwrap_or(usize::MAX);
        self.noise.restore(&memory.noise);
        self.schedule.set_next_index(memory.next_index);
        self.oldest = place(memory.oldest) % DELAY_LINE_LEN;
        self.count = place(memory.count).min(DELAY_LINE_LEN);
        self.captured_ns = memory.captured_ns;
        self.poses = memory.poses;
    }
}

impl PoseFix {
    /// Instant of the next capture \[ns\].
    #[must_use]
    pub fn next_capture_ns(&self) -> u64 {
        self.schedule.next_ns()
    }

    /// Arrival of the oldest fix under way \[ns\]; `None` if none is.
    #[must_use]
    pub fn next_arrival_ns(&self) -> Option<u64> {
        (self.count > 0).then(|| self.captured_ns[self.oldest].saturating_add(self.latency_ns))
    }

    /// Looks at the vehicle if a capture is due at `now_ns`, and stamps what it sees with `now_ns`.
    /// A pose that is not finite is lost.
    pub fn capture(&mut self, now_ns: u64, truth: &Pose) {
        if self.schedule.take(now_ns) == 0 {
            return;
        }
        // Drawn whether lost or not, so that a drop-out leaves every other fix as it was.
        let position =
            truth.position_w_m + Vector3::from(self.noise.normal3()) * self.sigma_position;
        let turn = UnitQuaternion::from_scaled_axis(
            Vector3::from(self.noise.normal3()) * self.sigma_attitude,
        );
        let unlucky = self.noise.uniform() < self.drop_out_probability;
        let lost = unlucky || self.drop_outs.contains(now_ns);
        let q = vehicle::canonical(truth.q_wb * turn);
        let pose = [position.x, position.y, position.z, q.w, q.i, q.j, q.k];
        if !lost && pose.iter().all(|x| x.is_finite()) {
            self.push(now_ns, pose);
        }
    }

    /// The oldest fix that has arrived by `now_ns`; ask until there is none.
    pub fn deliver(&mut self, now_ns: u64) -> Option<PoseSample> {
        let arrived_ns = self.next_arrival_ns().filter(|arrival| *arrival <= now_ns)?;
        let captured_ns = self.captured_ns[self.oldest];
        let [x, y, z, qw, qx, qy, qz] = self.poses[self.oldest];
        self.drop_oldest();
        let q_wb = UnitQuaternion::new_unchecked(Quaternion::new(qw, qx, qy, qz));
        let pose = Pose { position_w_m: Vector3::new(x, y, z), q_wb };
        Some(PoseSample { captured_ns, arrived_ns, pose })
    }

    /// A caller that never asks for its fixes loses the oldest.
    fn push(&mut self, captured_ns: u64, pose: [f64; 7]) {
        if self.count == DELAY_LINE_LEN {
            self.drop_oldest();
        }
        let place = (self.oldest + self.count) % DELAY_LINE_LEN;
        self.captured_ns[place] = captured_ns;
        self.poses[place] = pose;
        self.count += 1;
    }

    fn drop_oldest(&mut self) {
        self.oldest = (self.oldest + 1) % DELAY_LINE_LEN;
        self.count -= 1;
    }
}

#[cfg(test)]
mod tests;
