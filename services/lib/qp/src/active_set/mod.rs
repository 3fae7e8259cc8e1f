//! The solver to fly. `structure` finds what the matrices are made of, `blocks` holds the numbers (`block` is one of them),
//! `walk` finds the working set of one block on the `factor` of its Gram matrix, `tableau` that of
//! a smaller one; `explicit` has all tableaux of the smallest ones ready. What that cannot
//! settle beyond doubt goes to the `goldfarb` module, which is slower and gives the verdicts.

mod answer;
mod block;
mod blocks;
mod explicit;
mod factor;
mod front;
mod inverse;
mod kept;
mod polish;
mod structure;
mod tableau;
mod walk;

use core::cmp::Ordering;
use nalgebra::{DMatrix, DVector};

use crate::goldfarb::Goldfarb;
use crate::real::Pair;
use crate::scaled::{check_matrix, check_symmetric};
use crate::solver::{QpError, QpOutcome, QpSolver, QpStatus, check_compliance, check_working_set};
use crate::work::Work;
use answer::Answer;
use blocks::Blocks;
use tableau::Tick;
use walk::Doubt;

/// From g'H⁻¹g above this the squares of the methods overflow.
const MAX_DEPTH: f64 = 1e280;

/// Limits of the active-set solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Changes of the working set per solve and method; `None` takes `10 (n + m) + 50`, and lets an
    /// unfinished solve start once more without its working set. No further row is
    /// begun once it is reached; the last one may add up to `n` changes.
    pub max_iterations: Option<u32>,
    /// Residual ([`crate::KktResiduals::worst`]) up to which an answer is called `Solved`, in
    /// `[1e-12, 1e-2]`.
    pub tolerance: f64,
    /// Multiply-adds per solve, all methods together and nearly, beyond which it ends with
    /// `IterationLimit` and its last iterate; `None` sets no bound. A count and not a time, so that
    /// a solve ends at the same place on every machine.
    pub max_work: Option<u64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { max_iterations: None, tolerance: 1e-9, max_work: None }
    }
}

/// Which method can work with the matrices in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Matrices {
    Missing,
    /// So close to singular that only one of two factorisations found them definite.
    SafeOnly,
    InBlocks,
}

/// The solver to fly: a dual active-set method in the space of the rows, warm-started from its
/// working set.
///
/// Variables that share neither cost nor row are solved for apart, rows with the same normal are
/// one. A solve whose free minimum lies within all bounds ends there. Otherwise it drops the rows
/// of the working set whose multipliers have the wrong sign, and then adds violated rows one by
/// one. Ill-conditioned Hessians have their residuals measured and corrected in every solve.
/// Whatever is doubtful there (dependent rows that matter, infeasible or unusual input, a residual
/// above the promise) is solved again, from the same working set, by an orthogonal factorisation
/// in the space of the variables, a few times slower; it returns `Solved` only after the residuals of
/// the original problem have been measured. What double precision leaves open there (rows parallel
/// up to 1e-8 or less, contradictions by less than rounding could explain) is decided by the same
/// method in pairs of doubles, cold, which is more than an order of magnitude slower again.
///
/// After `IterationLimit` and `Infeasible` the solution is the last iterate, optimal for its
/// working set but outside some row; after `NotFinite`, or if `lower > upper`, it is zero and
/// the working set is kept for the next solve.
#[derive(Debug, Clone)]
pub struct ActiveSet {
    max_iterations: u32,
    max_work: u64,
    tolerance: f64,
    matrices: Matrices,
    /// The safe solver has the matrices in force.
    informed: bool,
    /// The blocks know the working set; multipliers of rows outside it are zero.
    adopted: bool,
    hessian: DMatrix<f64>,
    /// A', `n x m`.
    rows: DMatrix<f64>,
    compliance: Vec<f64>,
    blocks: Blocks,
    safe: Goldfarb<f64>,
    /// The same with twice the digits, for what rounding leaves open there.
    exact: Box<Goldfarb<Pair>>,
    set: Vec<i8>,
    /// The empty set, and whether an unfinished solve may start again from it.
    cold: Vec<i8>,
    retries: bool,
    /// The set that the solve at hand started from.
    start: Vec<i8>,
    /// Rows in it, if adopted.
    active: u32,
    x: DVector<f64>,
    multipliers: DVector<f64>,
    /// Product of each row with the solution, without its compliance.
    values: Vec<f64>,
}

impl ActiveSet {
    /// A solver for `n` variables and `m` rows, holding all memory it will ever use.
    ///
    /// # Errors
    /// `n` of zero or a setting out of its range.
    pub fn new(n: usize, m: usize, settings: Settings) -> Result<Self, QpError> {
        let most = u32::try_from(10 * (n + m) + 50).unwrap_or(u32::MAX);
        Ok(Self {
            max_iterations: settings.max_iterations.unwrap_or(most),
            max_work: settings.max_work.unwrap_or(u64::MAX),
            tolerance: settings.tolerance,
            matrices: Matrices::Missing,
            informed: false,
            adopted: false,
            hessian: DMatrix::zeros(n, n),
            rows: DMatrix::zeros(n, m),
            compliance: vec![0.0; m],
            blocks: Blocks::new(n, m, settings.tolerance),
            safe: Goldfarb::new(n, m, settings)?,
            exact: Box::new(Goldfarb::new(n, m, settings)?),
            set: vec![0; m],
            cold: vec![0; m],
            retries: settings.max_iterations.is_none(),
            start: vec![0; m],
            active: 0,
            x: DVector::zeros(n),
            multipliers: DVector::zeros(m),
            values: vec![0.0; m],
        })
    }

    /// Takes matrices that the safe solver has accepted.
    fn restructure(&mut self) {
        let set = self.blocks.set(&self.hessian, &self.rows, &self.compliance);
        self.matrices = if set.is_ok() { Matrices::InBlocks } else { Matrices::SafeOnly };
        self.adopted = false;
    }

    /// Solves block by block; returns the changes and the size of the working set.
    fn quick(
        &mut self,
        f: &[f64],
        lower: &[f64],
        upper: &[f64],
        work: &Work,
    ) -> Result<(u32, u32), Doubt> {
        let empty = self.blocks.structure.empty_rows.iter().map(|&row| row as usize);
        if !empty.into_iter().all(|row| lower[row] <= 0.0 && 0.0 <= upper[row]) {
            return Err(Doubt);
        }
        if self.blocks.explicit.serves() {
            return self.quicker(f, lower, upper, work);
        }
        self.blocks.release(f);
        // NaN and infinity are not less.
        let depth = self.blocks.front.depth(f);
        if depth.partial_cmp(&MAX_DEPTH) != Some(Ordering::Less) {
            return Err(Doubt);
        }
        let n = self.x.len();
        self.x.as_mut_slice().copy_from_slice(&self.blocks.front.x[..n]);
        if self.adopted && self.active == 0 && self.blocks.front.is_inside(lower, upper) {
            return Ok((0, 0));
        }
        if !self.adopted {
            self.set.fill(0);
            self.multipliers.fill(0.0);
        }
        let tick = Tick { work, f, lower, upper, size: self.blocks.size() };
        let mut answer = Answer {
            x: self.x.as_mut_slice(),
            set: &mut self.set,
            multipliers: self.multipliers.as_mut_slice(),
        };
        let (mut changes, mut active) = (0, 0);
        for index in 0..self.blocks.structure.shapes.len() {
            if !self.blocks.is_free(index, lower, upper) {
                let most = self.max_iterations.saturating_sub(changes);
                changes += self.blocks.walk(index, &tick, most, &mut answer)?;
                active += self.blocks.rows_held(index);
            }
        }
        // The last iterate of a walk that was cut off is whatever it is, but it is a number.
        if work.was_cut() && !self.x.iter().all(|value| value.is_finite()) {
            return Err(Doubt);
        }
        Ok((changes, active))
    }

    /// The same where every block is small.
    fn quicker(
        &mut self,
        f: &[f64],
        lower: &[f64],
        upper: &[f64],
        work: &Work,
    ) -> Result<(u32, u32), Doubt> {
        if !self.adopted {
            self.set.fill(0);
            self.multipliers.fill(0.0);
        }
        let tick = Tick { work, f, lower, upper, size: 0.0 };
        let mut answer = Answer {
            x: self.x.as_mut_slice(),
            set: &mut self.set,
            multipliers: self.multipliers.as_mut_slice(),
        };
        let solved = self.blocks.explicit.solve(&tick, self.max_iterations, &mut answer)?;
        let (changes, active, depth) = solved;
        // NaN and infinity are not less.
        match depth.abs().partial_cmp(&MAX_DEPTH) {
            Some(Ordering::Less) => Ok((changes, active)),
            _ => Err(Doubt),
        }
    }

    /// Has the safe solver do it all.
    fn careful(
        &mut self,
        f: &DVector<f64>,
        lower: &DVector<f64>,
        upper: &DVector<f64>,
        work: &Work,
    ) -> QpOutcome {
        if !self.informed && self.matrices != Matrices::Missing {
            // The blocks have accepted this Hessian by the same measure; rounding aside it passes.
            self.informed = self.safe.set_hessian(&self.hessian).is_ok();
        }
        self.safe.take_over(&self.set);
        let mut outcome = self.safe.solve(f, lower, upper, work);
        // A warm start can lead into rounding that a cold one avoids. Under a bound of the
        // caller's own the next solve goes on from here instead.
        if outcome.status == QpStatus::IterationLimit && self.retries && !work.was_cut() {
            self.safe.take_over(&self.cold);
            let again = self.safe.solve(f, lower, upper, work);
            outcome = QpOutcome { iterations: outcome.iterations + again.iterations, ..again };
        }
        self.adopted = false;
        let unfinished = outcome.status == QpStatus::IterationLimit
            && (self.retries || outcome.iterations < self.max_iterations);
        let wanted = (unfinished || self.safe.is_doubtful()) && !work.was_cut();
        if wanted
            && self.exact.loading() <= work.left()
            && self.exact.inform(&self.hessian, &self.safe)
        {
            let start = if self.retries { &self.cold } else { self.safe.working_set() };
            self.exact.take_over(start);
            let again = self.exact.solve(f, lower, upper, work);
            let iterations = outcome.iterations + again.iterations;
            if outcome.status != QpStatus::Solved || again.status == QpStatus::Solved {
                outcome = QpOutcome { iterations, ..again };
                self.set.copy_from_slice(self.exact.working_set());
                self.x.copy_from(self.exact.solution());
                self.multipliers.copy_from(self.exact.multipliers());
                return outcome;
            }
            outcome.iterations = iterations;
        }
        self.set.copy_from_slice(self.safe.working_set());
        self.x.copy_from(self.safe.solution());
        self.multipliers.copy_from(self.safe.multipliers());
        outcome
    }
}

impl QpSolver for ActiveSet {
    fn set_matrices(&mut self, hessian: &DMatrix<f64>, rows: &DMatrix<f64>) -> Result<(), QpError> {
        if self.matrices != Matrices::Missing
            && rows.shape() == (self.rows.ncols(), self.rows.nrows())
        {
            let pairs = rows.column_iter().zip(self.rows.row_iter());
            if pairs.into_iter().all(|(new, old)| new.iter().eq(old.iter())) {
                self.set_hessian(hessian)?;
                self.blocks.explicit.prepare();
                return Ok(());
            }
        }
        self.safe.set_matrices(hessian, rows)?;
        self.hessian.as_mut_slice().copy_from_slice(hessian.as_slice());
        rows.transpose_to(&mut self.rows);
        self.informed = true;
        let first = self.matrices == Matrices::Missing;
        self.restructure();
        // Rows that have changed once may change every time: tableaux are then made as met.
        if first {
            self.blocks.explicit.prepare();
        }
        Ok(())
    }

    fn set_hessian(&mut self, hessian: &DMatrix<f64>) -> Result<(), QpError> {
        if self.matrices == Matrices::Missing {
            return Err(QpError::NoRows);
        }
        if *hessian == self.hessian {
            return Ok(());
        }
        let n = self.x.len();
        check_matrix("hessian", hessian, n, n)?;
        check_symmetric(hessian)?;
        if self.matrices == Matrices::InBlocks && self.blocks.structure.fits(hessian, &self.rows) {
            self.blocks
                .refactor(hessian)
                .map_err(|(index, pivot)| QpError::NotPositiveDefinite { index, pivot })?;
            self.informed = false;
            self.hessian.as_mut_slice().copy_from_slice(hessian.as_slice());
        } else {
            self.safe.set_hessian(hessian)?;
            self.informed = true;
            self.hessian.as_mut_slice().copy_from_slice(hessian.as_slice());
            self.restructure();
        }
        Ok(())
    }

    fn set_compliance(&mut self, compliance: &[f64]) -> Result<(), QpError> {
        check_compliance(compliance, self.compliance.len())?;
        if self.compliance != compliance {
            self.safe.set_compliance(compliance)?;
            self.compliance.copy_from_slice(compliance);
            if self.matrices != Matrices::Missing {
                self.restructure();
            }
        }
        Ok(())
    }

    fn solve(&mut self, f: &DVector<f64>, lower: &DVector<f64>, upper: &DVector<f64>) -> QpOutcome {
        let m = self.set.len();
        let fits = (f.len(), lower.len(), upper.len()) == (self.x.len(), m, m);
        let work = Work::new(self.max_work);
        if self.matrices == Matrices::InBlocks && fits {
            if !self.adopted {
                self.blocks.adopt(&self.set);
            }
            self.start.copy_from_slice(&self.set);
            let bounds = (lower.as_slice(), upper.as_slice());
            let quick = self.quick(f.as_slice(), bounds.0, bounds.1, &work);
            // The walk measures by the free minimum, which may lie far beyond the solution.
            let quick =
                quick.ok().filter(|_| work.was_cut() || self.keeps_rows(f.as_slice(), bounds));
            if let Some((iterations, active)) = quick {
                (self.adopted, self.active) = (true, active);
                let cut = work.was_cut();
                let status = if cut { QpStatus::IterationLimit } else { QpStatus::Solved };
                return QpOutcome { status, iterations, active };
            }
            self.set.copy_from_slice(&self.start);
        }
        self.careful(f, lower, upper, &work)
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
        self.adopted = false;
        Ok(())
    }

    fn clear(&mut self) {
        self.set.fill(0);
        self.x.fill(0.0);
        self.multipliers.fill(0.0);
        self.adopted = false;
    }
}
