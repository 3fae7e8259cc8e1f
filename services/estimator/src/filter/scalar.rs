//! Measurements of one number, such as a height: what they have in common, and the table of their models.
//!
//! A model may have a bias, which walks. It stands beside the fifteen error states, with its variance and its covariance
//! with them, so that without such a sensor nothing is computed and nothing changes. One sensor may have one: two would
//! need their covariance with each other too.

use nalgebra::SMatrix;

use super::barometer::BarometerModel;
use super::belief::Belief;
use super::bias::SCALARS;
use super::config::FilterConfig;
use super::error_state::{STATE_DIMENSION, symmetrize};
use super::measurement::{MeasurementModel, Predicted};
use super::range_finder::RangeFinderModel;
use super::sample::Verdict;

/// Declares the sensors of one number: `Name: path of its configuration, Model;`, one a line.
macro_rules! scalars {
    ($($(#[doc = $doc:literal])+ $name:ident: $($field:ident).+, $model:ident;)+) => {
        /// A sensor of one number.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Scalar {
            $($(#[doc = $doc])+ $name,)+
        }

        impl Scalar {
            /// All of them, each at its [`index`](Self::index).
            pub(super) const ALL: [Self; SCALARS] = [$(Self::$name),+];

            /// Its model under a configuration.
            pub(super) fn model(self, config: &FilterConfig) -> &dyn MeasurementModel {
                match self {
                    $(Self::$name => {
                        let model: &$model = &config.$($field).+;
                        model
                    })+
                }
            }
        }
    };
}

scalars! {
    /// Height by air pressure \[m\].
    Barometer: barometer, BarometerModel;
    /// Distance to the ground along the body's -z axis \[m\].
    RangeFinder: range_finder, RangeFinderModel;
}

impl Scalar {
    /// Place among [`ALL`](Self::ALL).
    pub(super) fn index(self) -> usize {
        self as usize
    }

    /// The one at this place.
    pub(super) fn at(index: usize) -> Option<Self> {
        Self::ALL.get(index).copied()
    }
}

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    /// It counts at the instant of the first inertial sample from then on \[ns\].
    pub(super) time_ns: u64,
    pub(super) of: Scalar,
    pub(super) value: f64,
}

type Row = SMatrix<f64, 1, STATE_DIMENSION>;

/// Judges a reading by the belief, and corrects the belief with one that passes the gate.
///
/// With y = h(x) + b + n, the gain over error states and bias is K = P Hᵀ / S, and P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ:
/// the Joseph form stays positive after a re-opening, when P is far larger than R.
pub(super) fn correct(belief: &mut Belief, reading: &Reading, config: &FilterConfig) -> Verdict {
    let model = reading.of.model(config);
    let Some(Predicted { value, by_error: h }) = model.predict(&belief.p, &belief.q) else {
        return Verdict::OutOfRange;
    };
    let place = reading.of.index();
    let own_model = model.bias();
    if let Some(own_model) = own_model {
        belief.biases[place].begin(own_model.initial_sigma);
    }
    // 1 if the reading has a bias.
    let hb = if own_model.is_some() { 1.0 } else { 0.0 };
    let own = belief.biases[place];
    let noise = model.sigma() * model.sigma();
    // Columns P Hᵀ of the error states and of the bias.
    let seen = belief.covariance * h + own.cross * hb;
    let seen_own = (h.dot(&own.cross) + own.variance * hb) * hb;
    let spread = h.dot(&seen) + seen_own + noise;
    if !(spread.is_finite() && spread > 0.0) {
        return Verdict::Numerical;
    }
    let residual = reading.value - value - own.value * hb;
    if residual * residual > model.gate() * spread {
        return Verdict::Gated;
    }
    let (gain, gain_own) = (seen / spread, seen_own / spread);
    for (index, other) in belief.biases.iter_mut().enumerate() {
        if index != place {
            other.correct(h.dot(&other.cross), spread, residual, &gain);
        }
    }
    // I − K H from the left, then from the right.
    let seen_row: Row = seen.transpose();
    let left = belief.covariance - gain * seen_row;
    let left_cross = own.cross - gain * seen_own;
    let left_row = own.cross - seen * gain_own;
    let left_own = own.variance - gain_own * seen_own;
    let rest = left * h + left_cross * hb;
    let rest_own = h.dot(&left_row) + left_own * hb;
    let gain_row: Row = gain.transpose();
    belief.covariance = left - rest * gain_row + gain * (gain_row * noise);
    symmetrize(&mut belief.covariance);
    if own_model.is_some() {
        let bias = &mut belief.biases[place];
        bias.cross = left_cross - rest * gain_own + gain * (noise * gain_own);
        let variance = left_own - rest_own * gain_own + gain_own * gain_own * noise;
        bias.variance = variance.max(0.0);
        bias.value += gain_own * residual;
    }
    belief.inject(&(gain * residual));
    Verdict::Accepted
}

#[cfg(test)]
mod tests {
    use super::super::belief::tests::{BORDERED, spread_belief};
    use super::super::error_state::{ATTITUDE, ErrorState};
    use super::*;
    use nalgebra::SVector;

    #[test]
    fn the_derivative_of_every_model_is_that_of_its_prediction() {
        let config = FilterConfig::default();
        for of in Scalar::ALL {
            let (belief, model) = (spread_belief(), of.model(&config));
            let claimed = model.predict(&belief.p, &belief.q).unwrap().by_error;
            for state in 0..STATE_DIMENSION {
                let mut error = ErrorState::zeros();
                error[state] = 1e-6;
                let (mut ahead, mut behind) = (belief, belief);
                ahead.inject(&error);
                behind.inject(&-error);
                let [ahead, behind] =
                    [ahead, behind].map(|b| model.predict(&b.p, &b.q).unwrap().value);
                let slope = (ahead - behind) / 2e-6;
                assert!((slope - claimed[state]).abs() < 1e-6, "{of:?}, {state}: {slope}");
            }
        }
    }

    #[test]
    fn a_correction_with_a_bias_matches_the_information_form() {
        let config = FilterConfig::default();
        let mut belief = spread_belief();
        let of = Scalar::Barometer;
        let p = belief.border(of.index(), 0.2);
        let prior = belief;
        let model = of.model(&config);
        let predicted = model.predict(&prior.p, &prior.q).unwrap();
        let mut h = SVector::<f64, BORDERED>::zeros();
        h.fixed_rows_mut::<STATE_DIMENSION>(0).copy_from(&predicted.by_error);
        h[STATE_DIMENSION] = 1.0;
        let reading = Reading { time_ns: 0, of, value: predicted.value + 0.2 + 0.05 };
        // P⁺ = (P⁻¹ + Hᵀ R⁻¹ H)⁻¹, δx = P⁺ Hᵀ R⁻¹ r, another route to the same answer.
        let noise = model.sigma() * model.sigma();
        let wanted = (p.try_inverse().unwrap() + h * h.transpose() / noise).try_inverse().unwrap();
        let error = wanted * h * (0.05 / noise);
        assert_eq!(correct(&mut belief, &reading, &config), Verdict::Accepted);
        let turned = error.fixed_rows::<3>(ATTITUDE).norm();
        // The reset after the injection turns the attitude block by about half the correction.
        let bound = (1e-9 + 2.0 * turned) * wanted.norm();
        let got = wanted.fixed_view::<STATE_DIMENSION, STATE_DIMENSION>(0, 0);
        assert!((belief.covariance - got).norm() < bound);
        let bias = belief.biases[of.index()];
        let got = wanted.fixed_view::<STATE_DIMENSION, 1>(0, STATE_DIMENSION);
        assert!((bias.cross - got).norm() < bound);
        assert!((bias.variance - wanted[(STATE_DIMENSION, STATE_DIMENSION)]).abs() < bound);
        assert!((bias.value - 0.2 - error[STATE_DIMENSION]).abs() < 1e-12);
        assert!((belief.p - prior.p - error.fixed_rows::<3>(0)).norm() < 1e-12);
    }

    #[test]
    fn a_reading_beyond_the_gate_changes_nothing() {
        let config = FilterConfig::default();
        let mut belief = spread_belief();
        let reading = Reading { time_ns: 0, of: Scalar::RangeFinder, value: 3.0 };
        let before = belief;
        assert_eq!(correct(&mut belief, &reading, &config), Verdict::Gated);
        assert_eq!(belief, before);
    }

    #[test]
    fn one_sensor_at_most_has_a_bias() {
        let config = FilterConfig::default();
        let biased = Scalar::ALL.iter().filter(|of| of.model(&config).bias().is_some());
        assert!(biased.count() <= 1, "their covariance with each other is not kept");
    }
}
