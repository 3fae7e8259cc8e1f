//! Where the vehicle is, as far as the gate knows: the last estimate, carried on by the plant's own inertial readings.

use nalgebra::{Quaternion as Components, UnitQuaternion, Vector3};
use shared_types::{Quaternion, StateEstimate};
use vehicle::components;

use crate::sensors::ImuSample;

/// Age from which on an estimate is not taken: it takes 20 ms to reach the plant, and controllers fly one of 20 ms
/// \[ns\].
const AGE_MAX_NS: u64 = 40_000_000;

/// For how long readings alone tell where the vehicle is, and how fast: what is left of their biases, some 0.002 rad/s and
/// 0.02 m/s², makes a quarter of a metre per second of it. By default the vehicle follows for half of this time, and is
/// brought to rest in the other half \[ns\].
const READINGS_MAX_NS: u64 = 4_000_000_000;

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
            let age_ns = now_ns.checked_sub(estimate.described_ns);
            estimate.described_ns > self.described_ns && age_ns.is_some_and(|age| age <= AGE_MAX_NS)
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

    fn is_known(&self) -> bool {
        self.described_ns > 0 && self.now_ns.saturating_sub(self.described_ns) <= READINGS_MAX_NS
    }

    /// Vertical speed, while it is known \[m/s\].
    pub(super) fn climb_m_s(&self) -> Option<f64> {
        self.is_known().then_some(self.velocity_w.z)
    }

    /// Gyro bias by the last estimate, and none before the first \[rad/s\].
    pub(super) fn gyro_bias_b(&self) -> Vector3<f64> {
        self.gyro_bias_b
    }

    /// What is believed of the present instant, without anything else that an estimate has; none once it is not known.
    pub(super) fn believed(&self) -> Option<StateEstimate> {
        self.is_known().then(|| StateEstimate {
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
        let vectors =
            [&self.position_w, &self.velocity_w, &self.gyro_bias_b, &self.accelerometer_bias_b];
        let is_finite =
            vectors.into_iter().flatten().chain(self.q_wb.coords.iter()).all(|n| n.is_finite());
        // A vehicle of which nothing has been read for so long may be anywhere.
        if step_s > STEP_MAX_S || !is_finite {
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

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn estimate(described_ns: u64, east_m: f64) -> StateEstimate {
        StateEstimate {
            described_ns,
            position_w_m: [east_m, 0.0, 1.5],
            velocity_w_m_s: [1.0, 0.0, 0.0],
            q_wb: Quaternion::IDENTITY,
            specific_force_b_m_s2: [0.0, 0.0, 9.81],
            ..StateEstimate::default()
        }
    }

    fn reading() -> ImuSample {
        let specific_force_b_m_s2 = Vector3::new(0.0, 0.0, 9.81);
        ImuSample { gyro_b_rad_s: Vector3::zeros(), specific_force_b_m_s2, saturated: false }
    }

    fn east_m(navigation: &Navigation) -> Option<f64> {
        navigation.believed().map(|believed| believed.position_w_m[0])
    }

    #[test]
    fn an_estimate_is_carried_on_by_readings_and_known_for_four_seconds() {
        let mut navigation = Navigation::new();
        navigation.advance(0, None, Some(&reading()), 9.81);
        assert_eq!(east_m(&navigation), None);
        let known = estimate(100 * MS, 3.0);
        for ms in 1..4200 {
            let arrived = Some(&known).filter(|_| ms >= 120);
            navigation.advance(ms * MS, arrived, Some(&reading()), 9.81);
            let expected_m = (120..=4100).contains(&ms).then(|| 3.0 + (ms - 100) as f64 * 1e-3);
            let difference_m = match (east_m(&navigation), expected_m) {
                (Some(is), Some(expected)) => (is - expected).abs(),
                (is, expected) => f64::from(u8::from(is.is_some() != expected.is_some())),
            };
            assert!(difference_m < 1e-9, "{:?} at {ms} ms", east_m(&navigation));
        }
    }

    #[test]
    fn an_estimate_of_the_future_and_one_without_numbers_are_not_taken() {
        let mut navigation = Navigation::new();
        navigation.advance(100 * MS, Some(&estimate(90 * MS, 1.0)), None, 9.81);
        let before = navigation.memory();
        for described_ns in [101 * MS, u64::MAX, 59 * MS] {
            navigation.advance(100 * MS, Some(&estimate(described_ns, 9.0)), None, 9.81);
            assert_eq!(navigation.memory(), before);
        }
        navigation.advance(101 * MS, Some(&estimate(95 * MS, f64::NAN)), Some(&reading()), 9.81);
        assert_eq!(east_m(&navigation), None, "and it is not known any more");
        navigation.advance(102 * MS, Some(&estimate(96 * MS, 2.0)), None, 9.81);
        assert!(east_m(&navigation).is_some());
    }

    #[test]
    fn without_a_reading_for_too_long_nothing_is_known() {
        let mut navigation = Navigation::new();
        navigation.advance(100 * MS, Some(&estimate(90 * MS, 1.0)), None, 9.81);
        navigation.advance(140 * MS, None, Some(&reading()), 9.81);
        assert!(east_m(&navigation).is_some());
        navigation.advance(191 * MS, None, Some(&reading()), 9.81);
        assert_eq!(east_m(&navigation), None);
    }
}
