//! Time update: one inertial sample moves the belief forward (Solà sections 5.4 and 6.2).

use nalgebra::{Matrix3, Vector3};

use super::belief::{Belief, Inertial};
use super::config::FilterConfig;
use super::error_state::{
    ACCEL_BIAS, ATTITUDE, Covariance, GYRO_BIAS, POSITION, STATE_DIMENSION, VELOCITY, symmetrize,
};
use super::rotation;
use super::sample::ImuSample;
use super::scalar::Scalar;

/// What the vehicle may do unseen over an inertial gap: acceleration \[m/s²\], rate \[rad/s\].
const GAP_ACCELERATION_M_S2: f64 = 10.0;
const GAP_RATE_RAD_S: f64 = 3.0;

/// Blocks of the error transition F that differ from 0 and I.
struct Transition {
    dt: f64,
    /// δθ → δv
    velocity_attitude: Matrix3<f64>,
    /// `δa_b` → δv
    velocity_bias: Matrix3<f64>,
    /// δθ → δθ
    attitude: Matrix3<f64>,
}

impl Belief {
    /// Moves to the instant of `sample`, which must not be older than the belief.
    pub(super) fn propagate(&mut self, sample: &ImuSample, config: &FilterConfig) {
        let end = Inertial { gyro: sample.gyro_rad_s, accel: sample.accel_m_s2 };
        let start = self.inertial.unwrap_or(end);
        let dt_ns = sample.time_ns.saturating_sub(self.time_ns);
        let dt = dt_ns as f64 * 1e-9;
        let transition = if dt_ns > config.max_imu_gap_ns {
            self.open_over_gap(dt);
            None
        } else {
            let transition = self.integrate(&start, &end, dt, config.gravity_m_s2);
            transition.apply(&mut self.covariance);
            add_noise(&mut self.covariance, dt, config);
            Some(transition)
        };
        for (bias, of) in self.biases.iter_mut().zip(Scalar::ALL).filter(|(b, _)| b.is_known) {
            if let Some(transition) = &transition {
                transition.advance(&mut bias.cross.data.0[0]);
            }
            let walk = of.model(config).bias().map_or(0.0, |model| model.walk);
            bias.variance += walk * walk * dt;
        }
        self.time_ns = sample.time_ns;
        self.inertial = Some(end);
    }

    /// Nominal state by the trapezoidal rule over both readings, second order in `dt`:
    /// q ← q ⊗ Exp(ω dt), v ← v + (½(R₀a₀ + R₁a₁) + g) dt, p ← p + ½(v₀ + v₁) dt.
    fn integrate(&mut self, start: &Inertial, end: &Inertial, dt: f64, g: f64) -> Transition {
        let turn = ((start.gyro + end.gyro) * 0.5 - self.gyro_bias) * dt;
        let r0 = rotation::matrix(&self.q);
        let step = rotation::exp(&turn);
        self.q = rotation::compose(&self.q, &step);
        let r1 = rotation::matrix(&self.q);
        let force_0 = r0 * (start.accel - self.accel_bias);
        let force_1 = r1 * (end.accel - self.accel_bias);
        let force = (force_0 + force_1) * 0.5;
        let change = (force - Vector3::new(0.0, 0.0, g)) * dt;
        self.p += (self.v + change * 0.5) * dt;
        self.v += change;
        // R [a]× = [R a]× R and R₁ F_θθ = R₀, so one mean force in world axes serves both ends.
        Transition {
            dt,
            velocity_attitude: force.cross_matrix() * r0 * -dt,
            velocity_bias: (r0 + r1) * (-0.5 * dt),
            attitude: rotation::matrix(&step).transpose(),
        }
    }

    /// Too long to integrate: the nominal state is held, its uncertainty grows to cover a flight.
    pub(super) fn open_over_gap(&mut self, gap_s: f64) {
        let velocity = GAP_ACCELERATION_M_S2 * gap_s;
        let travelled = (self.v.norm() + velocity) * gap_s;
        let turned = (GAP_RATE_RAD_S * gap_s).min(1.0);
        self.open(&[(POSITION, travelled), (VELOCITY, velocity), (ATTITUDE, turned)]);
    }
}

impl Transition {
    /// P ← F P Fᵀ for a symmetric P, at the cost of the blocks of F that are not zero or I.
    ///
    /// F (Solà eq. 270, with the half-step terms of the trapezoid in δp):
    /// ```text
    /// δp ← δp + dt (δv + ½ w),  w = F_vθ δθ + F_va δa_b
    /// δv ← δv + w
    /// δθ ← F_θθ δθ − dt δω_b
    /// ```
    fn apply(&self, covariance: &mut Covariance) {
        let p = covariance.data.0; // by columns
        let moved = &mut covariance.data.0;
        // M = P Fᵀ combines columns of P; the columns of the biases stay.
        for i in 0..3 {
            for k in 0..STATE_DIMENSION {
                let w = self.velocity_attitude[(i, 0)] * p[ATTITUDE][k]
                    + self.velocity_attitude[(i, 1)] * p[ATTITUDE + 1][k]
                    + self.velocity_attitude[(i, 2)] * p[ATTITUDE + 2][k]
                    + self.velocity_bias[(i, 0)] * p[ACCEL_BIAS][k]
                    + self.velocity_bias[(i, 1)] * p[ACCEL_BIAS + 1][k]
                    + self.velocity_bias[(i, 2)] * p[ACCEL_BIAS + 2][k];
                moved[POSITION + i][k] += self.dt * (p[VELOCITY + i][k] + 0.5 * w);
                moved[VELOCITY + i][k] += w;
                moved[ATTITUDE + i][k] = self.attitude[(i, 0)] * p[ATTITUDE][k]
                    + self.attitude[(i, 1)] * p[ATTITUDE + 1][k]
                    + self.attitude[(i, 2)] * p[ATTITUDE + 2][k]
                    - self.dt * p[GYRO_BIAS + i][k];
            }
        }
        // F M, needed in the columns before the biases only: the lower triangle is mirrored.
        for column in &mut moved[..GYRO_BIAS] {
            self.advance(column);
        }
        symmetrize(covariance);
    }

    /// x ← F x for one error state.
    fn advance(&self, x: &mut [f64; STATE_DIMENSION]) {
        let part = |block: usize| Vector3::new(x[block], x[block + 1], x[block + 2]);
        let w = self.velocity_attitude * part(ATTITUDE) + self.velocity_bias * part(ACCEL_BIAS);
        let travelled = (part(VELOCITY) + w * 0.5) * self.dt;
        let attitude = self.attitude * part(ATTITUDE) - part(GYRO_BIAS) * self.dt;
        for i in 0..3 {
            x[POSITION + i] += travelled[i];
            x[VELOCITY + i] += w[i];
            x[ATTITUDE + i] = attitude[i];
        }
    }
}

/// Q of white sensor noise and bias walks over `dt` (Solà eq. 262–265), with the position terms that
/// the noise on the acceleration integrates to.
fn add_noise(covariance: &mut Covariance, dt: f64, config: &FilterConfig) {
    let accel = config.accel_noise_m_s2_rthz * config.accel_noise_m_s2_rthz * dt;
    let gyro = config.gyro_noise_rad_s_rthz * config.gyro_noise_rad_s_rthz * dt;
    let gyro_walk = config.gyro_walk_rad_s2_rthz * config.gyro_walk_rad_s2_rthz * dt;
    let accel_walk = config.accel_walk_m_s3_rthz * config.accel_walk_m_s3_rthz * dt;
    for i in 0..3 {
        let (p, v) = (POSITION + i, VELOCITY + i);
        covariance[(p, p)] += accel * dt * dt / 3.0;
        covariance[(p, v)] += accel * dt / 2.0;
        covariance[(v, p)] += accel * dt / 2.0;
        covariance[(v, v)] += accel;
        covariance[(ATTITUDE + i, ATTITUDE + i)] += gyro;
        covariance[(GYRO_BIAS + i, GYRO_BIAS + i)] += gyro_walk;
        covariance[(ACCEL_BIAS + i, ACCEL_BIAS + i)] += accel_walk;
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::InitialState;
    use super::super::error_state::ErrorState;
    use super::*;

    const DT: f64 = 1e-3;

    fn moving_belief() -> (Belief, Inertial, Inertial) {
        let mut belief = Belief::new(&InitialState::default());
        belief.v = Vector3::new(1.0, -2.0, 0.5);
        belief.q = rotation::exp(&Vector3::new(0.3, -0.4, 1.2));
        belief.gyro_bias = Vector3::new(0.01, -0.02, 0.005);
        belief.accel_bias = Vector3::new(0.05, 0.02, -0.04);
        let start =
            Inertial { gyro: Vector3::new(2.0, -1.0, 0.5), accel: Vector3::new(1.0, -0.5, 11.0) };
        let end =
            Inertial { gyro: Vector3::new(2.1, -1.2, 0.4), accel: Vector3::new(0.8, -0.6, 11.5) };
        (belief, start, end)
    }

    fn difference(of: &Belief, from: &Belief) -> ErrorState {
        let mut error = ErrorState::zeros();
        let turn = rotation::log(&rotation::compose(&from.q.inverse(), &of.q));
        error.fixed_rows_mut::<3>(POSITION).copy_from(&(of.p - from.p));
        error.fixed_rows_mut::<3>(VELOCITY).copy_from(&(of.v - from.v));
        error.fixed_rows_mut::<3>(ATTITUDE).copy_from(&turn);
        error.fixed_rows_mut::<3>(GYRO_BIAS).copy_from(&(of.gyro_bias - from.gyro_bias));
        error.fixed_rows_mut::<3>(ACCEL_BIAS).copy_from(&(of.accel_bias - from.accel_bias));
        error
    }

    #[test]
    fn the_structured_covariance_step_matches_a_numerically_differentiated_dense_one() {
        let (belief, start, end) = moving_belief();
        let mut nominal = belief;
        let transition = nominal.integrate(&start, &end, DT, 9.81);
        let mut f = Covariance::zeros();
        for column in 0..STATE_DIMENSION {
            let mut error = ErrorState::zeros();
            error[column] = 1e-5;
            let (mut ahead, mut behind) = (belief, belief);
            ahead.inject(&error);
            behind.inject(&-error);
            ahead.integrate(&start, &end, DT, 9.81);
            behind.integrate(&start, &end, DT, 9.81);
            f.set_column(column, &((difference(&ahead, &behind)) / 2e-5));
        }
        let root = Covariance::from_fn(|i, j| libm::sin((3 * i + 7 * j) as f64));
        let p = root * root.transpose();
        let wanted = f * p * f.transpose();
        let mut got = p;
        transition.apply(&mut got);
        // Left out: how a gyro bias moves the velocity, a dt²/2 = 6e-6, on a P of size 8.
        let worst = (got - wanted).abs().max();
        assert!(worst < 1e-4, "{worst:e}");
        assert!((wanted - p).abs().max() > 1e-2, "the step must move the covariance");
        // What a bias has in common with the state moves with it.
        let cross = ErrorState::from_fn(|i, _| libm::cos(2.0 * i as f64));
        let mut moved = cross;
        transition.advance(&mut moved.data.0[0]);
        assert!((moved - f * cross).abs().max() < 1e-4);
    }

    #[test]
    fn a_free_fall_with_spin_matches_the_closed_form() {
        let mut belief = Belief::new(&InitialState::default());
        belief.v = Vector3::new(1.0, 0.0, 3.0);
        let config = FilterConfig::default();
        let omega = Vector3::new(0.5, -1.0, 2.0);
        for k in 0..=1000 {
            let sample = ImuSample {
                time_ns: k * 1_000_000,
                gyro_rad_s: omega,
                accel_m_s2: Vector3::zeros(),
            };
            belief.propagate(&sample, &config);
        }
        let wanted_p = Vector3::new(1.0, 0.0, 3.0 - 0.5 * 9.81);
        assert!((belief.p - wanted_p).norm() < 1e-12);
        assert!(rotation::log(&(rotation::exp(&omega).inverse() * belief.q)).norm() < 1e-12);
    }

    #[test]
    fn noise_of_the_sensors_alone_grows_as_the_textbook_random_walks() {
        let mut belief = Belief::new(&InitialState::default());
        belief.covariance.fill(0.0);
        let config = FilterConfig {
            gyro_walk_rad_s2_rthz: 1e-12,
            accel_walk_m_s3_rthz: 1e-12,
            ..FilterConfig::default()
        };
        for k in 0..=2000 {
            let sample = ImuSample {
                time_ns: k * 1_000_000,
                gyro_rad_s: Vector3::zeros(),
                accel_m_s2: Vector3::new(0.0, 0.0, 9.81),
            };
            belief.propagate(&sample, &config);
        }
        let (t, a, w) = (2.0, 2e-3, 1.2e-4);
        // Vertical: double integral of white noise; yaw: single integral.
        let cases = [
            (belief.covariance[(2, 2)], a * a * t * t * t / 3.0),
            (belief.covariance[(2, 5)], a * a * t * t / 2.0),
            (belief.covariance[(5, 5)], a * a * t),
            (belief.covariance[(8, 8)], w * w * t),
        ];
        for (got, wanted) in cases {
            assert!((got / wanted - 1.0).abs() < 1e-6, "{got} for {wanted}");
        }
    }

    #[test]
    fn a_gap_holds_the_state_and_opens_the_covariance() {
        let (mut belief, start, _) = moving_belief();
        let before = belief;
        let sample =
            ImuSample { time_ns: 500_000_000, gyro_rad_s: start.gyro, accel_m_s2: start.accel };
        belief.propagate(&sample, &FilterConfig::default());
        assert_eq!((belief.p, belief.v, belief.q), (before.p, before.v, before.q));
        assert!(belief.covariance[(0, 0)] > 1.0 && belief.covariance[(8, 8)] > 0.9);
    }
}
