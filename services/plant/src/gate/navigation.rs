//! Where the vehicle is, as far as the gate knows: the last estimate, carried on by the plant's own inertial readings.

use nalgebra::{Quaternion as Components, UnitQuaternion, Vector3};
use shared_types::{Quaternion, StateEstimate};
use vehicle::components;

use crate::sensors::ImuSample;

/// Age from which on an estimate is not taken: it takes 20 ms to reach the plant, and controllers fly one that is as old
/// \[ns\].
const AGE_MAX_NS: u64 = 40_000_000;

/// For how long readings alone tell where the vehicle is: what is left of their biases, 0.002 rad/s and 0.02 m/s² or so,
/// makes five centimetres in that time \[ns\].
const READINGS_MAX_NS: u64 = 2_000_000_000;

/// Time without a reading, or an estimate, after which nothing is known \[s\].
const STEP_MAX_S: f64 = 0.05;

shared_types::memory! {
    /// A [`Navigation`] as plain numbers.
    #[derive(PartialEq)]
    pub struct NavigationMemory {
        /// Position \[m\].
        pub position_w_m: [f64; 3],
        /// Velocity \[m/s\].
        pub velocity_w_m_s: [f64; 3],
        /// Attitude, scalar first.
        pub q_wb: [f64; 4],
        /// Gyro bias by the last estimate \[rad/s\].
        pub gyro_bias_b_rad_s: [f64; 3],
        /// Accelerometer bias by it [m/s^2].
        pub accelerometer_bias_b_m_s2: [f64; 3],
        /// Instant that the last estimate describes; 0 before the first \[ns\].
        pub described_ns: u64,
        /// Instant of all this \[ns\].
        pub now_ns: u64,
    }
}

/// Position, velocity and attitude in W, which need not be known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Navigation {
    position_w: Vector3<f64>,
    velocity_w: Vector3<f64>,
    q_wb: UnitQuaternion<f64>,
    gyro_bias_b: Vector3<f64>,
    accelerometer_bias_b: Vector3<f64>,
    described_ns: u64,
    now_ns: u64,
}

impl Navigation {
    /// Nothing is known.
    pub(super) fn new() -> Self {
        Self {
            position_w: Vector3::zeros(),
            velocity_w: Vector3::zeros(),
            q_wb: UnitQuaternion::identity(),
            gyro_bias_b: Vector3::zeros(),
            accelerometer_bias_b: Vector3::zeros(),
            described_ns: 0,
            now_ns: 0,
        }
    }

    /// Takes an estimate that is newer than the last one, or goes on by a usable reading.
    pub(super) fn advance(
        &mut self,
        now_ns: u64,
        estimate: Option<&StateEstimate>,
        reading: Option<&ImuSample>,
        gravity_m_s2: f64,
    ) {
        let is_new = |estimate: &&StateEstimate| {
            estimate.described_ns > self.described_ns
                && now_ns.saturating_sub(estimate.described_ns) <= AGE_MAX_NS
        };
        let newer = estimate.filter(is_new).and_then(|estimate| Some((estimate, of(estimate)?)));
        if let Some((estimate, known)) = newer {
            *self = known;
            let (rate_b, force_b) = (estimate.body_rate_b_rad_s, estimate.specific_force_b_m_s2);
            self.step(now_ns, &rate_b.into(), &force_b.into(), gravity_m_s2);
        } else if let Some(reading) = reading {
            let rate_b = reading.gyro_b_rad_s - self.gyro_bias_b;
            let force_b = reading.specific_force_b_m_s2 - self.accelerometer_bias_b;
            self.step(now_ns, &rate_b, &force_b, gravity_m_s2);
        }
    }

    /// What is believed of the present instant, without anything else that an estimate has; none once it is not known.
    pub(super) fn believed(&self) -> Option<StateEstimate> {
        let is_known = self.described_ns > 0
            && self.now_ns.saturating_sub(self.described_ns) <= READINGS_MAX_NS;
        is_known.then(|| StateEstimate {
            position_w_m: self.position_w.into(),
            velocity_w_m_s: self.velocity_w.into(),
            q_wb: Quaternion::from_array(components(self.q_wb)),
            ..StateEstimate::default()
        })
    }

    /// Moves on to `now_ns` with this rate \[rad/s\] and specific force \[m/s²\].
    fn step(
        &mut self,
        now_ns: u64,
        rate_b: &Vector3<f64>,
        force_b: &Vector3<f64>,
        gravity_m_s2: f64,
    ) {
        let step_s = now_ns.saturating_sub(self.now_ns) as f64 * 1e-9;
        let acceleration_w = self.q_wb * force_b - Vector3::z() * gravity_m_s2;
        self.position_w += (self.velocity_w + 0.5 * step_s * acceleration_w) * step_s;
        self.velocity_w += step_s * acceleration_w;
        self.q_wb *= UnitQuaternion::from_scaled_axis(rate_b * step_s);
        self.now_ns = now_ns;
        let numbers = self.position_w.iter().chain(&self.velocity_w).chain(self.q_wb.coords.iter());
        // A vehicle of which nothing has been read for so long may be anywhere.
        if step_s > STEP_MAX_S || !numbers.fold(0.0, |sum, number| sum + number).is_finite() {
            *self = Self::new();
        }
    }

    /// Everything that evolves.
    pub(super) fn memory(&self) -> NavigationMemory {
        NavigationMemory {
            position_w_m: self.position_w.into(),
            velocity_w_m_s: self.velocity_w.into(),
            q_wb: [self.q_wb.w, self.q_wb.i, self.q_wb.j, self.q_wb.k],
            gyro_bias_b_rad_s: self.gyro_bias_b.into(),
            accelerometer_bias_b_m_s2: self.accelerometer_bias_b.into(),
            described_ns: self.described_ns,
            now_ns: self.now_ns,
        }
    }

    /// Continues from a memory, bit for bit.
    pub(super) fn restore(memory: &NavigationMemory) -> Self {
        let [w, x, y, z] = memory.q_wb;
        Self {
            position_w: memory.position_w_m.into(),
            velocity_w: memory.velocity_w_m_s.into(),
            q_wb: UnitQuaternion::new_unchecked(Components::new(w, x, y, z)),
            gyro_bias_b: memory.gyro_bias_b_rad_s.into(),
            accelerometer_bias_b: memory.accelerometer_bias_b_m_s2.into(),
            described_ns: memory.described_ns,
            now_ns: memory.now_ns,
        }
    }
}

/// What an estimate says of the instant that it describes; none if its attitude is none.
fn of(estimate: &StateEstimate) -> Option<Navigation> {
    let [w, x, y, z] = estimate.q_wb.to_array();
    Some(Navigation {
        position_w: estimate.position_w_m.into(),
        velocity_w: estimate.velocity_w_m_s.into(),
        q_wb: UnitQuaternion::try_new(Components::new(w, x, y, z), 0.1)?,
        gyro_bias_b: estimate.gyro_bias_b_rad_s.into(),
        accelerometer_bias_b: estimate.accelerometer_bias_b_m_s2.into(),
        described_ns: estimate.described_ns,
        now_ns: estimate.described_ns,
    })
}
