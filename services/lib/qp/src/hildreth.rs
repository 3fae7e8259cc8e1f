//! Hildreth's dual coordinate ascent, the method of the paper (Wang, *Model Predictive Control
//! System Design and Implementation Using MATLAB*, 2009, section 2.4.4).

use nalgebra::{DMatrix, DVector};

use crate::kkt::Evaluated;
use crate::linear::{axpy, dot, norm};
use crate::scaled::ScaledProblem;
use crate::solver::{QpError, QpOutcome, QpSolver, QpStatus, check_working_set};

/// Residual up to which the sweeps count as having solved the problem.
const SOLVED: f64 = 1e-9;

/// When Hildreth's sweeps end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HildrethSettings {
    /// Sweeps over all rows, at least 1.
    pub max_sweeps: u32,
    /// Change of the row values within a sweep, relative to the cost's own length, below which
    /// the sweeps end, in `[0, 1e-2]`.
    pub tolerance: f64,
}

impl HildrethSettings {
    /// The textbook's 38 sweeps, whatever accuracy they reach: with tight bounds that can be a
    /// point far outside them. For comparison with the paper, not for flight.
    #[must_use]
    pub const fn textbook() -> Self {
        Self { max_sweeps: 38, tolerance: 1e-8 }
    }

    /// Sweeps until the answer stops moving; thousands of them are common.
    #[must_use]
    pub const fn converged() -> Self {
        Self { max_sweeps: 1_000_000, tolerance: 1e-13 }
    }
}

/// The dual coordinate ascent of the paper.
///
/// One sweep visits the rows in order and sets each multiplier to its best value with the
/// others held. A two-sided row is one coordinate; pass one-sided rows for the textbook's exact
/// sequence. It always starts cold: the working set is an output (the signs of the
/// multipliers), a set handed over changes nothing. The status shows whether the sweeps were
/// enough: `Solved` means residuals below 1e-9, anything else is `IterationLimit` with the point
/// reached as solution. Contradictory rows are not recognised (the multipliers grow until the
/// sweeps end), except `lower > upper` in one row.
#[derive(Debug, Clone)]
pub struct Hildreth {
    settings: HildrethSettings,
    scaled: ScaledProblem,
    gradient: Vec<f64>,
    y: Vec<f64>,
    curved: Vec<f64>,
    pull: Vec<f64>,
    values: Vec<f64>,
    terms: Vec<f64>,
    set: Vec<i8>,
    x: DVector<f64>,
    multipliers: DVector<f64>,
}

impl Hildreth {
    /// A solver for `n` variables and `m` rows, holding all memory it will ever use.
    ///
    /// # Errors
    /// `n` of zero or a setting out of its range.
    pub fn new(n: usize, m: usize, settings: HildrethSettings) -> Result<Self, QpError> {
        if n == 0 {
            return Err(QpError::NoVariables);
        }
        if !(0.0..=1e-2).contains(&settings.tolerance) {
            let (name, range) = ("tolerance", "[0, 1e-2]");
            return Err(QpError::BadSetting { name, value: settings.tolerance, range });
        }
        if settings.max_sweeps == 0 {
            let (name, range) = ("max_sweeps", "[1, 4294967295]");
            return Err(QpError::BadSetting { name, value: 0.0, range });
        }
        Ok(Self {
            settings,
            scaled: ScaledProblem::new(n, m),
            gradient: vec![0.0; n + m],
            y: vec![0.0; n + m],
            curved: vec![0.0; n],
            pull: vec![0.0; n],
            values: vec![0.0; m],
            terms: vec![0.0; m],
            set: vec![0; m],
            x: DVector::zeros(n),
            multipliers: DVector::zeros(m),
        })
    }

    /// One sweep over the scaled rows, y = -g - N multipliers; returns the largest change.
    fn sweep(&mut self, lower: &[f64], upper: &[f64]) -> f64 {
        let mut largest = 0.0_f64;
        let y = &mut self.y[..self.scaled.dim()];
        for row in 0..self.set.len() {
            let length = self.scaled.length[row];
            let normal = self.scaled.normal(row);
            let multiplier = &mut self.multipliers[row];
            // The row's value without its own multiplier; unit normals make its pivot one.
            let free = dot(normal, y) + *multiplier;
            let held = if length > 0.0 {
                free - (upper[row] / length).min(free.max(lower[row] / length))
            } else {
                0.0
            };
            let change = held - *multiplier;
            axpy(-change, normal, y);
            *multiplier = held;
            largest = largest.max(change.abs());
        }
        largest
    }

    fn finish(&mut self, f: &[f64], lower: &[f64], upper: &[f64]) -> QpStatus {
        self.scaled.unscale(&mut self.y);
        let y = &self.y[..self.x.len()];
        self.x.as_mut_slice().copy_from_slice(y);
        self.pull.fill(0.0);
        for row in 0..self.set.len() {
            if self.scaled.length[row] > 0.0 {
                self.multipliers[row] /= self.scaled.length[row];
            }
            axpy(self.multipliers[row], self.scaled.row(row), &mut self.pull);
            self.values[row] = self.scaled.value(row, y, self.multipliers[row]);
        }
        if !self.x.iter().chain(&self.multipliers).all(|value| value.is_finite()) {
            self.x.fill(0.0);
            self.multipliers.fill(0.0);
            return QpStatus::IterationLimit;
        }
        self.scaled.curved(y, &mut self.curved);
        self.scaled.terms(y, &mut self.terms);
        let residuals = Evaluated {
            d: &self.scaled.d,
            reach: &self.scaled.reach,
            peak: &self.scaled.peak,
            curved: &self.curved,
            pull: &self.pull,
            values: &self.values,
            terms: &self.terms,
            f,
            lower,
            upper,
            x: self.x.as_slice(),
            multipliers: self.multipliers.as_slice(),
        }
        .residuals();
        if residuals.worst() <= SOLVED { QpStatus::Solved } else { QpStatus::IterationLimit }
    }

    fn outcome(&mut self, status: QpStatus, iterations: u32) -> QpOutcome {
        for (side, &multiplier) in self.set.iter_mut().zip(&self.multipliers) {
            *side = i8::from(multiplier > 0.0) - i8::from(multiplier < 0.0);
        }
        let active = self.set.iter().fold(0, |count, &side| count + u32::from(side != 0));
        QpOutcome { status, iterations, active }
    }
}

impl QpSolver for Hildreth {
    fn set_matrices(&mut self, hessian: &DMatrix<f64>, rows: &DMatrix<f64>) -> Result<(), QpError> {
        self.scaled.set(hessian, rows)
    }

    fn set_hessian(&mut self, hessian: &DMatrix<f64>) -> Result<(), QpError> {
        self.scaled.set_hessian(hessian)
    }

    fn set_compliance(&mut self, compliance: &[f64]) -> Result<(), QpError> {
        self.scaled.set_compliance(compliance)
    }

    fn solve(&mut self, f: &DVector<f64>, lower: &DVector<f64>, upper: &DVector<f64>) -> QpOutcome {
        let (f, lower, upper) = (f.as_slice(), lower.as_slice(), upper.as_slice());
        self.x.fill(0.0);
        self.multipliers.fill(0.0);
        let dim = self.scaled.dim();
        if let Err(status) = self.scaled.check(f, lower, upper, &mut self.gradient[..dim]) {
            return self.outcome(status, 0);
        }
        self.y[..dim].iter_mut().zip(&self.gradient).for_each(|(y, g)| *y = -g);
        let mut sweeps = 0;
        while sweeps < self.settings.max_sweeps {
            sweeps += 1;
            let change = self.sweep(lower, upper);
            if change
                <= self.settings.tolerance * (norm(&self.y[..dim]) + norm(&self.gradient[..dim]))
            {
                break;
            }
        }
        let status = self.finish(f, lower, upper);
        self.outcome(status, sweeps)
    }

    fn solution(&self) -> &DVector<f64> {
        &self.x
    }

    fn multipliers(&self) -> &DVector<f64> {
        &self.multipliers
    }

    fn working_set(&self) -> &[i8] {
        &self.set
    }

    fn set_working_set(&mut self, set: &[i8]) -> Result<(), QpError> {
        check_working_set(set, self.set.len())?;
        self.set.copy_from_slice(set);
        Ok(())
    }

    fn clear(&mut self) {
        self.set.fill(0);
        self.x.fill(0.0);
        self.multipliers.fill(0.0);
    }
}
