//! Dual active-set method after Goldfarb and Idnani (1983), warm-started.
//!
//! `scaled` changes coordinates, `working` holds the factor of the working rows, `dual` walks
//! from working set to working set, `polish` turns the end point into a certified answer.

mod dual;
mod polish;
mod working;

use nalgebra::{DMatrix, DVector};

use crate::active_set::Settings;
use crate::scaled::ScaledProblem;
use crate::solver::{QpError, QpOutcome, QpStatus};
use working::WorkingFactor;

/// The safe method: an orthogonal factorisation in the space of the variables.
///
/// A solve rebuilds its factor from the working set, drops the rows whose multipliers have the
/// wrong sign, and then adds violated rows one by one. `Solved` is said only after the residuals
/// of the original problem have been measured. Dependent rows (duplicates, ties) never stand in
/// the factor together.
#[derive(Debug, Clone)]
pub(crate) struct Goldfarb {
    tolerance: f64,
    max_iterations: u32,
    scaled: ScaledProblem,
    working: WorkingFactor,
    /// Bounds in scaled coordinates; infinite for zero rows.
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// g, then y and two vectors of scratch, for up to n + m entries.
    gradient: Vec<f64>,
    y: Vec<f64>,
    scratch: Vec<f64>,
    pull: Vec<f64>,
    /// Scratch per row: its value at x.
    values: Vec<f64>,
    /// Rows that miss their bound by no more than their dependence on working rows explains.
    excused: Vec<bool>,
    set: Vec<i8>,
    x: DVector<f64>,
    multipliers: DVector<f64>,
}

impl Goldfarb {
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
            lower: vec![0.0; m],
            upper: vec![0.0; m],
            gradient: vec![0.0; n + m],
            y: vec![0.0; n + m],
            scratch: vec![0.0; n + m],
            pull: vec![0.0; n],
            values: vec![0.0; m],
            excused: vec![false; m],
            set: vec![0; m],
            x: DVector::zeros(n),
            multipliers: DVector::zeros(m),
        })
    }

    /// Checks and scales the inputs; says how the solve ends if it ends here.
    fn load(&mut self, f: &[f64], lower: &[f64], upper: &[f64]) -> Result<(), QpStatus> {
        let dim = self.scaled.dim();
        self.scaled.check(f, lower, upper, &mut self.gradient[..dim])?;
        for (i, &length) in self.scaled.length.iter().enumerate() {
            (self.lower[i], self.upper[i]) = if length > 0.0 {
                (lower[i] / length, upper[i] / length)
            } else {
                (f64::NEG_INFINITY, f64::INFINITY)
            };
        }
        Ok(())
    }

    fn outcome(&self, status: QpStatus, iterations: u32) -> QpOutcome {
        let active = self.set.iter().fold(0, |count, &side| count + u32::from(side != 0));
        QpOutcome { status, iterations, active }
    }
}

impl Goldfarb {
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

    pub(crate) fn solve(
        &mut self,
        f: &DVector<f64>,
        lower: &DVector<f64>,
        upper: &DVector<f64>,
    ) -> QpOutcome {
        self.x.fill(0.0);
        self.multipliers.fill(0.0);
        if let Err(status) = self.load(f.as_slice(), lower.as_slice(), upper.as_slice()) {
            return self.outcome(status, 0);
        }
        let (walked, iterations) = self.walk();
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

    /// Starts the next solve from `set` (`m`, sides -1, 0, +1).
    pub(crate) fn take_over(&mut self, set: &[i8]) {
        self.set.copy_from_slice(set);
    }
}
