//! Measurement model of a pose fix: `y = (p + n_p, q ⊗ Exp(n_θ))`.

use nalgebra::{Matrix6, SMatrix, Vector6};

use super::belief::Belief;
use super::config::FilterConfig;
use super::error_state::{ATTITUDE, Covariance, ErrorState, POSITION, STATE_DIMENSION, symmetrize};
use super::rotation;
use super::sample::{PoseFixSample, Verdict};

/// A fix's quaternion must be this close to unit length.
const UNIT_TOLERANCE: f64 = 1e-3;

type Gain = SMatrix<f64, STATE_DIMENSION, 6>;

/// The innovation of a fix against a belief, ready to be judged and applied.
pub(super) struct Innovation {
    residual: Vector6<f64>,
    noise: Vector6<f64>,
    cholesky: nalgebra::Cholesky<f64, nalgebra::Const<6>>,
    /// z = L⁻¹ r, S = L Lᵀ.
    pub(super) whitened: Vector6<f64>,
}

/// Looks at the values alone: `None` if they are usable.
pub(super) fn refusal(fix: &PoseFixSample, config: &FilterConfig) -> Option<Verdict> {
    let length = fix.q_wb.coords.norm();
    let finite = fix.position_w.iter().all(|x| x.is_finite());
    if !finite || !length.is_finite() || (length - 1.0).abs() > UNIT_TOLERANCE {
        return Some(Verdict::NotFinite);
    }
    let inside = fix.position_w.iter().all(|x| x.abs() <= config.fix_range_m);
    (!inside).then_some(Verdict::OutOfRange)
}

/// `r = (y_p − p, Log(q⁻¹ ⊗ y_q))`, `H = [I at δp; I at δθ]`, `S = H P Hᵀ + s R` with the scale s that the
/// fixes have shown. `None` if S is not positive definite.
pub(super) fn innovation(
    belief: &Belief,
    fix: &PoseFixSample,
    config: &FilterConfig,
    noise_scale: f64,
) -> Option<Innovation> {
    let measured = rotation::compose(&belief.q.inverse(), &fix.q_wb);
    let mut residual = Vector6::zeros();
    residual.fixed_rows_mut::<3>(0).copy_from(&(fix.position_w - belief.p));
    residual.fixed_rows_mut::<3>(3).copy_from(&rotation::log(&measured));
    let position = config.fix_position_sigma_m * config.fix_position_sigma_m;
    let attitude = config.fix_attitude_sigma_rad * config.fix_attitude_sigma_rad;
    let noise =
        Vector6::new(position, position, position, attitude, attitude, attitude) * noise_scale;
    let seen = columns_seen(&belief.covariance);
    let mut s = Matrix6::from_diagonal(&noise);
    for (row, state) in OBSERVED.iter().enumerate() {
        for column in 0..6 {
            s[(row, column)] += seen[(*state, column)];
        }
    }
    let cholesky = s.cholesky()?;
    let whitened = cholesky.l_dirty().solve_lower_triangular(&residual)?;
    Some(Innovation { residual, noise, cholesky, whitened })
}

/// Rows of the error state that a fix sees.
const OBSERVED: [usize; 6] =
    [POSITION, POSITION + 1, POSITION + 2, ATTITUDE, ATTITUDE + 1, ATTITUDE + 2];

/// P Hᵀ.
fn columns_seen(covariance: &Covariance) -> Gain {
    let mut seen = Gain::zeros();
    for (column, state) in OBSERVED.iter().enumerate() {
        seen.set_column(column, &covariance.column(*state));
    }
    seen
}

impl Innovation {
    /// K = P Hᵀ S⁻¹, δx = K r, P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ: the Joseph form stays positive
    /// after a re-opening, when P is far larger than R.
    pub(super) fn apply(&self, belief: &mut Belief) {
        let seen = columns_seen(&belief.covariance);
        let gain: Gain = self.cholesky.solve(&seen.transpose()).transpose();
        let error: ErrorState = gain * self.residual;
        let left = belief.covariance - gain * seen.transpose();
        let noisy = gain * Matrix6::from_diagonal(&self.noise);
        belief.covariance =
            left - columns_seen(&left) * gain.transpose() + noisy * gain.transpose();
        symmetrize(&mut belief.covariance);
        // A fix does not see the biases of other sensors, but what they have in common with the state.
        for bias in belief.biases.iter_mut().filter(|bias| bias.is_known) {
            let seen = Vector6::from_fn(|row, _| bias.cross[OBSERVED[row]]);
            let gain_own = self.cholesky.solve(&seen);
            bias.value += gain_own.dot(&self.residual);
            bias.variance = (bias.variance - gain_own.dot(&seen)).max(0.0);
            bias.cross -= gain * seen;
        }
        belief.inject(&error);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::super::belief::tests::spread_belief;
    use super::*;

    /// P⁺ = (P⁻¹ + Hᵀ R⁻¹ H)⁻¹ and δx = P⁺ Hᵀ R⁻¹ r, another route to the same answer.
    fn by_information<const N: usize>(
        prior: &SMatrix<f64, N, N>,
        innovation: &Innovation,
    ) -> (SMatrix<f64, N, N>, SMatrix<f64, N, 1>) {
        let mut information = prior.try_inverse().unwrap();
        let mut right = SMatrix::<f64, N, 1>::zeros();
        for (row, state) in OBSERVED.iter().enumerate() {
            information[(*state, *state)] += 1.0 / innovation.noise[row];
            right[*state] = innovation.residual[row] / innovation.noise[row];
        }
        let posterior = information.try_inverse().unwrap();
        (posterior, posterior * right)
    }

    #[test]
    fn the_update_matches_the_information_form() {
        let mut belief = spread_belief();
        let prior = belief;
        let config = FilterConfig::default();
        let turn = Vector3::new(1e-9, -2e-9, 1e-9);
        let fix = PoseFixSample {
            captured_ns: 0,
            position_w: prior.p + Vector3::new(0.01, -0.02, 0.005),
            q_wb: rotation::compose(&belief.q, &rotation::exp(&turn)),
        };
        let innovation = innovation(&belief, &fix, &config, 1.0).unwrap();
        let (wanted, error) = by_information(&prior.covariance, &innovation);
        innovation.apply(&mut belief);
        // The reset after the injection turns the attitude block by about half the correction.
        let bound =
            1e-6 * wanted.norm() + 2.0 * error.fixed_rows::<3>(ATTITUDE).norm() * wanted.norm();
        assert!((belief.covariance - wanted).norm() < bound);
        assert!((belief.p - prior.p - error.fixed_rows::<3>(0)).norm() < 1e-9);
        assert!((belief.v - error.fixed_rows::<3>(3)).norm() < 1e-9);
        assert!((belief.gyro_bias - error.fixed_rows::<3>(9)).norm() < 1e-9);
    }

    #[test]
    fn what_a_bias_has_in_common_with_the_state_is_corrected_as_in_the_information_form() {
        let mut belief = spread_belief();
        let p = belief.border(0, 0.3);
        let config = FilterConfig::default();
        let position_w = belief.p + Vector3::new(0.01, -0.02, 0.005);
        let fix = PoseFixSample { captured_ns: 0, position_w, q_wb: belief.q };
        let innovation = innovation(&belief, &fix, &config, 1.0).unwrap();
        let (wanted, error) = by_information(&p, &innovation);
        innovation.apply(&mut belief);
        let turned = error.fixed_rows::<3>(ATTITUDE).norm();
        let bound = (1e-9 + 2.0 * turned) * wanted.norm();
        let bias = belief.biases[0];
        let column = wanted.fixed_view::<STATE_DIMENSION, 1>(0, STATE_DIMENSION);
        assert!((bias.cross - column).norm() < bound, "{}", (bias.cross - column).norm());
        assert!((bias.variance - wanted[(STATE_DIMENSION, STATE_DIMENSION)]).abs() < bound);
        assert!((bias.value - 0.3 - error[STATE_DIMENSION]).abs() < 1e-9);
    }

    #[test]
    fn values_that_no_tracker_can_mean_are_refused() {
        let config = FilterConfig::default();
        let good = PoseFixSample {
            captured_ns: 0,
            position_w: Vector3::zeros(),
            q_wb: UnitQuaternion::identity(),
        };
        assert_eq!(refusal(&good, &config), None);
        let nan = PoseFixSample { position_w: Vector3::new(0.0, f64::NAN, 0.0), ..good };
        assert_eq!(refusal(&nan, &config), Some(Verdict::NotFinite));
        let far = PoseFixSample { position_w: Vector3::new(0.0, 2e4, 0.0), ..good };
        assert_eq!(refusal(&far, &config), Some(Verdict::OutOfRange));
        let zero = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(0.0, 0.0, 0.0, 0.0));
        let flat = PoseFixSample { q_wb: zero, ..good };
        assert_eq!(refusal(&flat, &config), Some(Verdict::NotFinite));
    }
}
