//! The optimality conditions of a QP, measured on an answer.

use nalgebra::{DMatrix, DVector};

/// How far an answer is from optimal. All four are relative and do not change when variables,
/// rows or the cost are rescaled; NaN in an answer shows as infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KktResiduals {
    /// `H x + f + A' multipliers`, relative to the largest of its terms, a term of the last
    /// being one entry of one row times its multiplier.
    pub stationarity: f64,
    /// Violation of a row, relative to its bound and the sizes of its terms.
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
    let hard = DVector::zeros(rows.nrows());
    soft_kkt_residuals(hessian, rows, hard.as_slice(), f, lower, upper, x, multipliers)
}

/// As [`kkt_residuals`], with rows of the given `compliance` (`m`, zero for a hard row): a row is
/// judged at `aᵢ x - compliance[i] multiplierᵢ`.
///
/// # Panics
/// If the shapes do not fit together.
#[must_use]
#[expect(clippy::too_many_arguments, reason = "the six parts of a QP and the two of its answer")]
pub fn soft_kkt_residuals(
    hessian: &DMatrix<f64>,
    rows: &DMatrix<f64>,
    compliance: &[f64],
    f: &DVector<f64>,
    lower: &DVector<f64>,
    upper: &DVector<f64>,
    x: &DVector<f64>,
    multipliers: &DVector<f64>,
) -> KktResiduals {
    let given = DVector::from_iterator(
        rows.nrows(),
        compliance.iter().zip(multipliers).map(|(c, multiplier)| c * multiplier),
    );
    let d = hessian.diagonal().map(|h| 1.0 / h.sqrt());
    Evaluated {
        d: d.as_slice(),
        reach: (rows.abs() * &d).as_slice(),
        peak: DVector::from_fn(rows.nrows(), |i, _| {
            rows.row(i).transpose().component_mul(&d).amax()
        })
        .as_slice(),
        curved: (hessian * x).as_slice(),
        pull: rows.tr_mul(multipliers).as_slice(),
        values: (rows * x - given).as_slice(),
        terms: (rows.abs() * x.abs()).as_slice(),
        f: f.as_slice(),
        lower: lower.as_slice(),
        upper: upper.as_slice(),
        x: x.as_slice(),
        multipliers: multipliers.as_slice(),
    }
    .residuals()
}

/// A problem and an answer with the products that the residuals need.
pub(crate) struct Evaluated<'a> {
    /// 1/√`H_jj`: the Jacobi scaling that makes variables, and gradient entries, comparable.
    pub(crate) d: &'a [f64],
    /// |A| d.
    pub(crate) reach: &'a [f64],
    /// The largest |aᵢⱼ| dⱼ of each row.
    pub(crate) peak: &'a [f64],
    /// H x.
    pub(crate) curved: &'a [f64],
    /// A' multipliers.
    pub(crate) pull: &'a [f64],
    /// A x, less compliance times multiplier.
    pub(crate) values: &'a [f64],
    /// |A| |x|.
    pub(crate) terms: &'a [f64],
    pub(crate) f: &'a [f64],
    pub(crate) lower: &'a [f64],
    pub(crate) upper: &'a [f64],
    pub(crate) x: &'a [f64],
    pub(crate) multipliers: &'a [f64],
}

impl Evaluated<'_> {
    pub(crate) fn residuals(&self) -> KktResiduals {
        let (mut residual, mut gradient) = (0.0_f64, f64::MIN_POSITIVE);
        let mut size = Size::default();
        for (j, d) in self.d.iter().enumerate() {
            let (curved, f, pull) = (self.curved[j], self.f[j], self.pull[j]);
            residual = raise(residual, d * (curved + f + pull).abs());
            gradient = gradient.max(d * (curved.abs() + f.abs() + pull.abs()));
            size.take(self.x[j], f, *d);
        }
        let strongest = self.peak.iter().zip(self.multipliers).map(|(peak, by)| peak * by.abs());
        let terms = strongest.fold(gradient, f64::max);
        let mut worst = KktResiduals {
            stationarity: residual / terms,
            primal: 0.0,
            dual: 0.0,
            complementarity: 0.0,
        };
        for i in 0..self.values.len() {
            self.judge_row(i, size, gradient, &mut worst);
        }
        worst
    }

    fn judge_row(&self, i: usize, size: Size, gradient: f64, worst: &mut KktResiduals) {
        let (value, multiplier, reach) = (self.values[i], self.multipliers[i], self.reach[i]);
        let (lower, upper) = (self.lower[i], self.upper[i]);
        let span = |bound: f64| size.span(bound, self.terms[i], reach);
        for (miss, bound) in [(lower - value, lower), (value - upper, upper)] {
            // An infinite bound is missed by -∞ unless it excludes every value.
            let relative = if bound.is_finite() { miss / span(bound) } else { miss };
            worst.primal = raise(worst.primal, relative);
        }
        let pressed = if multiplier > 0.0 { upper } else { lower };
        let strength = multiplier.abs() * reach / gradient;
        if pressed.is_finite() {
            // A row that is held by a weak multiplier may lie off its bound by the rounding of the
            // largest variable: what is small here is small beside the whole answer.
            let slack = (pressed - value).abs() / (span(pressed) + reach * size.x);
            worst.complementarity = raise(worst.complementarity, strength.min(slack));
        } else {
            worst.dual = raise(worst.dual, strength);
        }
    }
}

/// Sizes of an answer and of the way to it, each in the unit of its variable.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Size {
    x: f64,
    f: f64,
}

impl Size {
    /// Takes a variable with its cost and 1/√`H_jj`.
    pub(crate) fn take(&mut self, x: f64, f: f64, d: f64) {
        self.x = self.x.max(x.abs() / d);
        self.f = self.f.max(d * f.abs());
    }

    /// What a row's violation is relative to: bound and terms of the row. Where both are zero, the
    /// rounding of the largest variable counts, and that of a double's square on the way.
    pub(crate) fn span(self, bound: f64, terms: f64, reach: f64) -> f64 {
        let rounding = reach * (1e-6 * self.x + 1e-13 * self.f);
        bound.abs() + terms + rounding + f64::MIN_POSITIVE
    }
}

/// The larger of two, where NaN counts as infinite.
fn raise(worst: f64, candidate: f64) -> f64 {
    if candidate.is_nan() { f64::INFINITY } else { worst.max(candidate) }
}
