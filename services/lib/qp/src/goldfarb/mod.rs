//! Dual active-set method after Goldfarb and Idnani (1983), warm-started.
//!
//! `scaled` changes coordinates, `working` holds the factor of the working rows, `dual` walks
//! from working set to working set, `polish` turns the end point into a certified answer.

mod dual;
mod polish;
mod working;

use nalgebra::{DMatrix, DVector};

use crate::active_set::Settings;
use crate::real::Real;
use crate::scaled::ScaledProblem;
use crate::solver::{QpError, QpOutcome, QpStatus};
use crate::work::Work;
use polish::Measured;
use working::WorkingFactor;

/// The safe method: an orthogonal factorisation in the space of the variables.
///
/// A solve rebuilds its factor from the working set, drops the rows whose multipliers have the
/// wrong sign, and then adds violated rows one by one. `Solved` is returned only after the residuals
/// of the original problem have been measured. Dependent rows (duplicates, ties) never stand in
/// the factor together.
#[derive(Debug, Clone)]
pub(crate) struct Goldfarb<T> {
    tolerance: f64,
    max_iterations: u32,
    scaled: ScaledProblem<T>,
    working: WorkingFactor<T>,
    /// Bounds in scaled coordinates; infinite for zero rows.
    lower: Vec<T>,
    upper: Vec<T>,
    /// g, then y and two vectors of scratch, for up to n + m entries.
    gradient: Vec<T>,
    y: Vec<T>,
    scratch: Vec<T>,
    pull: Vec<T>,
    /// Scratch per row: its value at x.
    values: Vec<T>,
    /// x and multipliers in full.
    point: Vec<T>,
    forces: Vec<T>,
    measured: Measured,
    /// Rows that miss their bound by no more than their dependence on working rows explains.
    excused: Vec<bool>,
    /// Rounding decided about a dependent row, or left residuals.
    doubtful: bool,
    set: Vec<i8>,
    x: DVector<f64>,
    multipliers: DVector<f64>,
}

impl<T: Real> Goldfarb<T> {
    /// A solver for `n` variables and `m` rows, holding all memory it will ever use.
    ///
    /// # Errors
    /// `n` of zero or a setting out of its range.
    pub(crate) fn new(n: usize, m: usize, settings: Settings) -> Result<Self, QpError> {
        if n == 0 {
            return Err(QpError::NoVariables);
        }
        if !(1e-12..=1e-2).contains(&settings.tolerance) {
            let (name, range) = ("tolerance", "[1e-12, 1e-2]");
            return Err(QpError::BadSetting { name, value: settings.tolerance, range });
        }
        if settings.max_iterations == Some(0) {
            let (name, range) = ("max_iterations", "[1, 4294967295]");
            return Err(QpError::BadSetting { name, value: 0.0, range });
        }
        let most = u32::try_from(10 * (n + m) + 50).unwrap_or(u32::MAX);
        Ok(Self {
            tolerance: settings.tolerance,
            max_iterations: settings.max_iterations.unwrap_or(most),
            scaled: ScaledProblem::new(n, m),
            working: WorkingFactor::new(n, m),
            lower: vec![T::ZERO; m],
            upper: vec![T::ZERO; m],
            gradient: vec![T::ZERO; n + m],
            y: vec![T::ZERO; n + m],
            scratch: vec![T::ZERO; n + m],
            pull: vec![T::ZERO; n],
            values: vec![T::ZERO; m],
            point: vec![T::ZERO; n],
            forces: vec![T::ZERO; m],
            measured: Measured::new(n, m),
            excused: vec![false; m],
            doubtful: false,
            set: vec![0; m],
            x: DVector::zeros(n),
            multipliers: DVector::zeros(m),
        })
    }

    /// Checks and scales the inputs; returns how the solve ends if it ends here.
    fn load(&mut self, f: &[f64], lower: &[f64], upper: &[f64]) -> Result<(), QpStatus> {
        let dim = self.scaled.dim();
        self.scaled.check(f, lower, upper, &mut self.gradient[..dim])?;
        for (i, &length) in self.scaled.length.iter().enumerate() {
            (self.lower[i], self.upper[i]) = if length > T::ZERO {
                (scaled_bound(lower[i], length), scaled_bound(upper[i], length))
            } else {
                (T::from(f64::NEG_INFINITY), T::from(f64::INFINITY))
            };
        }
        Ok(())
    }

    fn outcome(&self, status: QpStatus, iterations: u32) -> QpOutcome {
        let active = self.set.iter().fold(0, |count, &side| count + u32::from(side != 0));
        QpOutcome { status, iterations, active }
    }
}

impl Goldfarb<f64> {
    pub(crate) fn set_matrices(
        &mut self,
        hessian: &DMatrix<f64>,
        rows: &DMatrix<f64>,
    ) -> Result<(), QpError> {
        self.scaled.set(hessian, rows)
    }

    pub(crate) fn set_hessian(&mut self, hessian: &DMatrix<f64>) -> Result<(), QpError> {
        self.scaled.set_hessian(hessian)
    }

    pub(crate) fn set_compliance(&mut self, compliance: &[f64]) -> Result<(), QpError> {
        self.scaled.set_compliance(compliance)
    }
}

impl<T: Real> Goldfarb<T> {
    pub(crate) fn solve(
        &mut self,
        f: &DVector<f64>,
        lower: &DVector<f64>,
        upper: &DVector<f64>,
        work: &Work,
    ) -> QpOutcome {
        self.doubtful = false;
        self.point.fill(T::ZERO);
        self.forces.fill(T::ZERO);
        self.x.fill(0.0);
        self.multipliers.fill(0.0);
        if let Err(status) = self.load(f.as_slice(), lower.as_slice(), upper.as_slice()) {
            return self.outcome(status, 0);
        }
        let (walked, iterations) = self.walk(work);
        let status = self.polish(walked, f.as_slice(), (lower.as_slice(), upper.as_slice()));
        self.outcome(status, iterations)
    }

    pub(crate) fn solution(&self) -> &DVector<f64> {
        &self.x
    }

    pub(crate) fn multipliers(&self) -> &DVector<f64> {
        &self.multipliers
    }

    pub(crate) fn working_set(&self) -> &[i8] {
        &self.set
    }

    /// Multiply-adds of [`Self::inform`], nearly.
    pub(crate) fn loading(&self) -> u64 {
        let (n, m) = (self.x.len() as u64, self.set.len() as u64);
        T::PRODUCTS as u64 * n * n * (n / 6 + m / 2)
    }

    /// Takes the problem of the other method.
    pub(crate) fn inform(&mut self, hessian: &DMatrix<f64>, other: &Goldfarb<f64>) -> bool {
        self.scaled.take_over(hessian, &other.scaled)
    }

    /// True if the last solve left its verdict to more digits.
    pub(crate) fn is_doubtful(&self) -> bool {
        self.doubtful
    }

    /// Starts the next solve from `set` (`m`, sides -1, 0, +1).
    pub(crate) fn take_over(&mut self, set: &[i8]) {
        self.set.copy_from_slice(set);
    }
}

/// A bound per length of its row; pairs know no infinity but that of their `f64`.
fn scaled_bound<T: Real>(bound: f64, length: T) -> T {
    if bound.is_finite() { T::from(bound) / length } else { T::from(bound) }
}
