//! Position law over attitude law over the nonlinear vehicle, each edge 1 ms late, perfect state.
#![allow(dead_code, reason = "each test file uses its own part of the cascade")]

#[path = "../../../attitude-mpc/tests/rig/mod.rs"]
mod rig;

use attitude_mpc::{AttitudeLaw, AttitudeLawConfig};
use nalgebra::Vector3;
use position_mpc::{Input, LawStatus, Output, PositionLaw, PositionLawConfig, Setpoint};
pub(crate) use rig::Flight;
use rig::{MS, nanoseconds, release_ns};
use vehicle::{VehicleParameters, Wrench, euler_from_quaternion};

/// Desired position \[m\] and heading \[rad\] at a time \[s\].
pub(crate) type Reference<'a> = &'a dyn Fn(f64) -> (Vector3<f64>, f64);

/// White noise on what the laws are given: 1 mm, 8 mm/s, 1 mrad, 10 mrad/s (1σ), an estimator's.
pub(crate) struct Noise(u64);

impl Noise {
    /// Uniform in (−1, 1), a linear congruence (Knuth's constants).
    fn uniform(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Sums of three have unit variance and are normal enough.
    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| sigma * (self.uniform() + self.uniform() + self.uniform()))
    }
}

/// Sees what the position law is given and what it returns.
pub(crate) type Watch = Box<dyn FnMut(&Input<'_>, &Output)>;

pub(crate) struct Cascade {
    /// Sees nothing unless a test looks.
    pub(crate) watch: Watch,
    /// Off (0) unless a test turns it on.
    pub(crate) noise_gain: f64,
    noise: Noise,
    pub(crate) flight: Flight,
    pub(crate) position: PositionLaw,
    pub(crate) attitude: AttitudeLaw,
    pub(crate) position_rate_hz: f64,
    pub(crate) attitude_rate_hz: f64,
    pub(crate) preview: usize,
}

/// Position error every millisecond, and every output of the position law.
pub(crate) struct Trace {
    pub(crate) t_s: Vec<f64>,
    pub(crate) error_m: Vec<Vector3<f64>>,
    pub(crate) yaw_error_rad: Vec<f64>,
    pub(crate) outputs: Vec<Output>,
}

impl Trace {
    fn from(&self, from_s: f64) -> impl Iterator<Item = &Vector3<f64>> {
        self.t_s.iter().zip(&self.error_m).filter(move |(t, _)| **t > from_s).map(|(_, e)| e)
    }

    pub(crate) fn mean_error_m(&self, from_s: f64) -> f64 {
        let (sum, count) = self.from(from_s).fold((0.0, 0.0), |(s, n), e| (s + e.norm(), n + 1.0));
        sum / count
    }

    pub(crate) fn worst_error_m(&self, from_s: f64) -> f64 {
        self.from(from_s).map(Vector3::norm).fold(0.0, f64::max)
    }
}

impl Cascade {
    /// A flight of `flown`, by laws that believe in the default vehicle.
    pub(crate) fn new(flight: Flight, position: &PositionLawConfig, attitude_rate_hz: f64) -> Self {
        let believed = VehicleParameters::default();
        let attitude = AttitudeLawConfig {
            setpoint_ramp_s: position.period_s(),
            ..AttitudeLawConfig::flight(attitude_rate_hz)
        };
        let law = PositionLaw::new(*position, &believed).unwrap();
        Self {
            watch: Box::new(|_, _| {}),
            noise_gain: 0.0,
            noise: Noise(1),
            flight,
            position_rate_hz: position.rate_hz,
            attitude_rate_hz,
            preview: law.look_ahead(),
            position: law,
            attitude: AttitudeLaw::new(attitude, &believed).unwrap(),
        }
    }

    pub(crate) fn fly(
        &mut self,
        seconds: f64,
        reference: Reference<'_>,
        mut script: impl FnMut(f64, &mut Flight),
    ) -> Trace {
        let mut trace =
            Trace { t_s: vec![], error_m: vec![], yaw_error_rad: vec![], outputs: vec![] };
        let (mut p, mut a, mut tick) = (0, 0, 0);
        let weight = VehicleParameters::default().weight_n();
        let mut in_effect = Setpoint { gamma_rad: Vector3::zeros(), thrust_n: weight };
        let mut coming: Option<(u64, Setpoint)> = None;
        while tick * MS < nanoseconds(seconds) {
            let next_p = release_ns(p, self.position_rate_hz);
            let next_a = release_ns(a, self.attitude_rate_hz);
            let next = next_p.min(next_a).min(tick * MS);
            script(next as f64 * 1e-9, &mut self.flight);
            self.flight.advance(next);
            if let Some((_, setpoint)) = coming.take_if(|(at, _)| *at <= next) {
                in_effect = setpoint;
            }
            if next == next_p {
                let output = self.position_step(next, reference, in_effect);
                coming = Some((next + MS, output.setpoint));
                trace.outputs.push(output);
                p += 1;
            }
            if next == next_a {
                self.attitude_step(next, in_effect);
                a += 1;
            }
            if next == tick * MS {
                let state = self.flight.sampled().0;
                let (wanted, yaw) = reference(next as f64 * 1e-9);
                trace.t_s.push(next as f64 * 1e-9);
                trace.error_m.push(state.position_w - wanted);
                let heading = euler_from_quaternion(&state.q_wb).z;
                trace.yaw_error_rad.push(vehicle::wrap_pi(heading - yaw));
                tick += 1;
            }
        }
        trace
    }

    fn position_step(&mut self, now: u64, reference: Reference<'_>, applied: Setpoint) -> Output {
        let t = now as f64 * 1e-9;
        let period = 1.0 / self.position_rate_hz;
        let points: Vec<_> =
            (1..=self.preview).map(|j| reference(t + j as f64 * period).0).collect();
        let state = self.flight.sampled().0;
        let gain = self.noise_gain;
        let input = Input {
            position_w_m: state.position_w + self.noise.vector(1e-3 * gain),
            velocity_w_m_s: state.velocity_w + self.noise.vector(8e-3 * gain),
            gamma_rad: euler_from_quaternion(&state.q_wb) + self.noise.vector(1e-3 * gain),
            age_s: (now % MS) as f64 * 1e-9,
            reference_w_m: &points,
            reference_yaw_rad: reference(t).1,
            applied: Some(applied),
        };
        let output = self.position.step(&input);
        (self.watch)(&input, &output);
        assert_eq!(output.status, LawStatus::Solved);
        assert!(output.violation <= 1e-9, "{output:?}");
        output
    }

    fn attitude_step(&mut self, now: u64, setpoint: Setpoint) {
        let (state, applied) = self.flight.sampled();
        let gain = self.noise_gain;
        let output = self.attitude.step(&attitude_mpc::Input {
            gamma_rad: euler_from_quaternion(&state.q_wb) + self.noise.vector(1e-3 * gain),
            body_rate_rad_s: state.omega_b + self.noise.vector(10e-3 * gain),
            age_s: (now % MS) as f64 * 1e-9,
            morph_angle: state.beta,
            setpoint: attitude_mpc::Setpoint {
                gamma_rad: setpoint.gamma_rad,
                thrust_n: setpoint.thrust_n,
            },
            applied_torque_nm: Some(applied),
        });
        assert_eq!(output.status, attitude_mpc::LawStatus::Solved);
        assert!(output.violation_nm <= 1e-9, "{output:?}");
        self.flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
    }
}
