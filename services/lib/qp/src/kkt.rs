//! The optimality conditions of a QP, measured on an answer.

use nalgebra::{DMatrix, DVector};

/// How far an answer is from optimal. All four are relative and do not change when variables,
/// rows or the cost are rescaled; NaN in an answer shows as infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KktResiduals {
    /// `H x + f + A' multipliers`, relative to the largest of its terms.
    pub stationarity: f64,
    /// Violation of a row, relative to its bound and the size its terms may have.
    pub primal: f64,
    /// A multiplier that pushes against a bound that is infinite, relative as the next.
    pub dual: f64,
    /// Per row the smaller of relative multiplier and relative slack, the largest of all rows.
    pub complementarity: f64,
}

impl KktResiduals {
    /// The largest of the four.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.stationarity.max(self.primal).max(self.dual).max(self.complementarity)
    }
}

/// Measures the optimality of `x` (`n`) and `multipliers` (`m`, positive at upper, negative at
/// lower) for the problem `hessian` (`n x n`), `rows` (`m x n`), `f`, `lower`, `upper`.
///
/// # Panics
/// If the shapes do not fit together.
#[must_use]
#[expect(clippy::too_many_arguments, reason = "the five parts of a QP and the two of its answer")]
pub fn kkt_residuals(
    hessian: &DMatrix<f64>,
    rows: &DMatrix<f64>,
    f: &DVector<f64>,
    lower: &DVector<f64>,
    upper: &DVector<f64>,
    x: &DVector<f64>,
    multipliers: &DVector<f64>,
) -> KktResiduals {
    let pull = rows.tr_mul(multipliers);
    let curved = hessian * x;
    // Jacobi scaling: d_j = 1/√H_jj makes every variable and every gradient entry comparable.
    let d = hessian.diagonal().map(|h| 1.0 / h.sqrt());
    let (mut residual, mut gradient) = (0.0_f64, f64::MIN_POSITIVE);
    let mut size = 0.0_f64;
    for j in 0..x.len() {
        residual = raise(residual, d[j] * (curved[j] + f[j] + pull[j]).abs());
        gradient = gradient.max(d[j] * (curved[j].abs() + f[j].abs() + pull[j].abs()));
        size = size.max(x[j].abs() / d[j]).max(d[j] * f[j].abs());
    }
    let mut worst = KktResiduals {
        stationarity: residual / gradient,
        primal: 0.0,
        dual: 0.0,
        complementarity: 0.0,
    };
    let values = rows * x;
    for i in 0..values.len() {
        let reach = rows.row(i).iter().zip(&d).map(|(a, d)| a.abs() * d).sum::<f64>();
        let span = |bound: f64| reach * size + bound.abs() + f64::MIN_POSITIVE;
        for (violation, bound) in
            [(lower[i] - values[i], lower[i]), (values[i] - upper[i], upper[i])]
        {
            if bound.is_finite() || violation.is_nan() {
                worst.primal = raise(worst.primal, violation.max(0.0) / span(bound));
            }
        }
        let pressed = if multipliers[i] > 0.0 { upper[i] } else { lower[i] };
        let strength = multipliers[i].abs() * reach / gradient;
        if pressed.is_finite() {
            let slack = (pressed - values[i]).abs() / span(pressed);
            worst.complementarity = raise(worst.complementarity, strength.min(slack));
        } else {
            worst.dual = raise(worst.dual, strength);
        }
    }
    worst
}

/// The larger of two, where NaN counts as infinite.
fn raise(worst: f64, candidate: f64) -> f64 {
    if candidate.is_nan() { f64::INFINITY } else { worst.max(candidate) }
}
