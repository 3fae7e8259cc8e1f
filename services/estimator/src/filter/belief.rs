//! Belief at one instant: nominal state, error covariance, last inertial sample.

use nalgebra::{UnitQuaternion, Vector3};

use super::bias::{Bias, SCALARS};
use super::config::{FilterConfig, InitialState};
use super::error_state::{
    ACCEL_BIAS, ATTITUDE, Covariance, ErrorState, GYRO_BIAS, POSITION, STATE_DIMENSION, VELOCITY,
    symmetrize,
};
use super::rotation;

/// One inertial reading, as measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Inertial {
    pub(super) gyro: Vector3<f64>,
    pub(super) accel: Vector3<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Belief {
    pub(super) time_ns: u64,
    pub(super) p: Vector3<f64>,
    pub(super) v: Vector3<f64>,
    pub(super) q: UnitQuaternion<f64>,
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) accel_bias: Vector3<f64>,
    pub(super) covariance: Covariance,
    /// Of each sensor of one number, see [`Scalar::index`](super::Scalar).
    pub(super) biases: [Bias; SCALARS],
    /// Reading at `time_ns`; none before the first sample.
    pub(super) inertial: Option<Inertial>,
}

impl Belief {
    pub(super) fn new(initial: &InitialState) -> Self {
        let mut belief = Self {
            time_ns: initial.time_ns,
            p: initial.position_w,
            v: initial.velocity_w,
            q: initial.q_wb,
            gyro_bias: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
            covariance: Covariance::zeros(),
            biases: [Bias::none(); SCALARS],
            inertial: None,
        };
        belief.open(&[
            (POSITION, initial.position_sigma_m),
            (VELOCITY, initial.velocity_sigma_m_s),
            (ATTITUDE, initial.attitude_sigma_rad),
            (GYRO_BIAS, initial.gyro_bias_sigma_rad_s),
            (ACCEL_BIAS, initial.accel_bias_sigma_m_s2),
        ]);
        belief
    }

    /// Adds independent errors of the given 1σ to blocks of the covariance.
    pub(super) fn open(&mut self, blocks: &[(usize, f64)]) {
        for &(block, sigma) in blocks {
            for i in block..block + 3 {
                self.covariance[(i, i)] += sigma * sigma;
            }
        }
    }

    /// Re-opens the whole covariance; `level` doubles what the gate sees, so that the gate cannot
    /// stay shut however far off the state is.
    pub(super) fn reopen(&mut self, config: &FilterConfig, level: u32) {
        let scale = f64::from(1_u32 << level.min(MAX_REOPEN_LEVEL));
        let sigmas = &config.reopen;
        self.open(&[
            (POSITION, sigmas.position_m * scale),
            (VELOCITY, sigmas.velocity_m_s * scale),
            (ATTITUDE, (sigmas.attitude_rad * scale).min(1.0)),
            (GYRO_BIAS, sigmas.gyro_bias_rad_s),
            (ACCEL_BIAS, sigmas.accel_bias_m_s2),
        ]);
    }

    /// Adds the estimated error to the nominal state and re-centres the error (Solà section 6.3).
    pub(super) fn inject(&mut self, error: &ErrorState) {
        let theta: Vector3<f64> = error.fixed_rows::<3>(ATTITUDE).into_owned();
        self.p += error.fixed_rows::<3>(POSITION);
        self.v += error.fixed_rows::<3>(VELOCITY);
        self.q = rotation::compose(&self.q, &rotation::exp(&theta));
        self.gyro_bias += error.fixed_rows::<3>(GYRO_BIAS);
        self.accel_bias += error.fixed_rows::<3>(ACCEL_BIAS);
        self.recentre(&theta);
    }

    /// P ← G P Gᵀ with G = I except `G_θθ` = I − [½ δθ]× (Solà eq. 285–287).
    fn recentre(&mut self, theta: &Vector3<f64>) {
        let half = theta * 0.5;
        for _ in 0..2 {
            // One pass forms P Gᵀ on the columns; transposed, the second gives G P Gᵀ.
            for row in 0..STATE_DIMENSION {
                let x: Vector3<f64> = self.covariance.fixed_view::<1, 3>(row, ATTITUDE).transpose();
                let turned = x - half.cross(&x);
                self.covariance.fixed_view_mut::<1, 3>(row, ATTITUDE).tr_copy_from(&turned);
            }
            self.covariance.transpose_mut();
        }
        symmetrize(&mut self.covariance);
        for bias in self.biases.iter_mut().filter(|bias| bias.is_known) {
            let x: Vector3<f64> = bias.cross.fixed_rows::<3>(ATTITUDE).into_owned();
            bias.cross.fixed_rows_mut::<3>(ATTITUDE).copy_from(&(x - half.cross(&x)));
        }
    }
}

/// Doubling 2 cm this often gives more than a kilometre.
const MAX_REOPEN_LEVEL: u32 = 16;

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::{Matrix3, SMatrix};

    use super::*;

    /// Error states and one bias.
    pub(in super::super) const BORDERED: usize = STATE_DIMENSION + 1;

    /// A belief whose errors all have something in common.
    pub(in super::super) fn spread_belief() -> Belief {
        let mut belief = Belief::new(&InitialState::default());
        let root = Covariance::from_fn(|i, j| 0.01 * libm::sin((3 * i + 7 * j + i * j) as f64));
        belief.covariance += root * root.transpose();
        belief.p = Vector3::new(0.3, -0.2, 1.4);
        belief.q = rotation::exp(&Vector3::new(0.2, -0.1, 2.0));
        belief
    }

    impl Belief {
        /// Gives a sensor a bias that has something in common with all error states, and returns the covariance of both.
        pub(in super::super) fn border(
            &mut self,
            place: usize,
            value: f64,
        ) -> SMatrix<f64, BORDERED, BORDERED> {
            let cross = ErrorState::from_fn(|i, _| 1e-3 * libm::cos(i as f64));
            let variance = 0.04;
            self.biases[place] = Bias { is_known: true, value, variance, cross };
            let mut p = SMatrix::<f64, BORDERED, BORDERED>::zeros();
            p.fixed_view_mut::<STATE_DIMENSION, STATE_DIMENSION>(0, 0).copy_from(&self.covariance);
            p.fixed_view_mut::<STATE_DIMENSION, 1>(0, STATE_DIMENSION).copy_from(&cross);
            p.fixed_view_mut::<1, STATE_DIMENSION>(STATE_DIMENSION, 0)
                .copy_from(&cross.transpose());
            p[(STATE_DIMENSION, STATE_DIMENSION)] = variance;
            p
        }
    }

    #[test]
    fn recentring_equals_the_dense_product() {
        let mut belief = Belief::new(&InitialState::default());
        let root = Covariance::from_fn(|i, j| libm::sin((3 * i + 7 * j) as f64));
        belief.covariance = root * root.transpose();
        let theta = Vector3::new(0.02, -0.05, 0.03);
        let mut g = Covariance::identity();
        let block = Matrix3::identity() - (theta * 0.5).cross_matrix();
        g.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE).copy_from(&block);
        let wanted = g * belief.covariance * g.transpose();
        belief.recentre(&theta);
        assert!((belief.covariance - wanted).norm() < 1e-12 * wanted.norm());
    }

    #[test]
    fn a_higher_level_opens_further_but_never_beyond_a_radian_of_attitude() {
        let config = FilterConfig::default();
        let mut belief = Belief::new(&InitialState::default());
        belief.reopen(&config, 12);
        assert!(belief.covariance[(0, 0)] > 80.0 * 80.0);
        assert!(belief.covariance[(ATTITUDE, ATTITUDE)] < 1.01);
    }
}
