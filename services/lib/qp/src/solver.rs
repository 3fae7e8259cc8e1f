//! What every solver of this crate offers, and the status with which a solve ends.

use nalgebra::{DMatrix, DVector};

/// How a solve ended. A verdict is data: every value is foreseen in flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QpStatus {
    /// The iterate satisfies the optimality conditions to the solver's tolerance.
    Solved,
    /// The iteration bound was reached, or the accuracy promised for `Solved` was not.
    IterationLimit,
    /// No point satisfies all rows (this includes `lower > upper` in one row).
    Infeasible,
    /// NaN in an input, an infinite or unusably large `f`, or no matrices set yet.
    NotFinite,
}

/// Verdict and effort of one solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QpOutcome {
    /// How the solve ended.
    pub status: QpStatus,
    /// Changes of the working set (active-set solver) or sweeps (Hildreth).
    pub iterations: u32,
    /// Rows in the working set at the end.
    pub active: u32,
}

/// A set-up that cannot work. The previous matrices and working set stay in force.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum QpError {
    /// The number of variables was zero.
    #[error("a QP needs at least one variable, got n = 0")]
    NoVariables,
    /// A matrix has another shape than the solver was made for.
    #[error(
        "{what} is {rows} x {columns}, the solver was made for {expected_rows} x {expected_columns}"
    )]
    MatrixShape {
        /// `hessian` or `rows`.
        what: &'static str,
        /// Rows given.
        rows: usize,
        /// Columns given.
        columns: usize,
        /// Rows expected.
        expected_rows: usize,
        /// Columns expected.
        expected_columns: usize,
    },
    /// A matrix entry is NaN or infinite.
    #[error("{what}[{row}, {column}] = {value} is not a finite number")]
    EntryNotFinite {
        /// `hessian` or `rows`.
        what: &'static str,
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The entry.
        value: f64,
    },
    /// The Hessian is not symmetric.
    #[error("hessian[{row}, {column}] = {value} but its mirror is {mirror}; pass a symmetric one")]
    NotSymmetric {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The entry.
        value: f64,
        /// The entry mirrored at the diagonal.
        mirror: f64,
    },
    /// The Hessian has a pivot that is not safely positive.
    #[error(
        "hessian is not positive definite: pivot {index} of the unit-diagonal matrix is {pivot:e}; \
         weight every variable in the cost"
    )]
    NotPositiveDefinite {
        /// Variable at which the factorisation stopped.
        index: usize,
        /// Pivot of the Hessian scaled to unit diagonal (the diagonal entry itself if that is
        /// not positive).
        pivot: f64,
    },
    /// A working set of another length than the number of rows.
    #[error("working set has {got} entries, the solver has {expected} rows")]
    WorkingSetLength {
        /// Entries given.
        got: usize,
        /// Rows of the solver.
        expected: usize,
    },
    /// A working-set entry other than -1, 0, +1.
    #[error("working set entry {row} is {value}; use -1 (lower), 0 (inactive) or +1 (upper)")]
    WorkingSetEntry {
        /// Row of the entry.
        row: usize,
        /// The entry.
        value: i8,
    },
    /// A Hessian was given before the first rows.
    #[error("no rows are set; call set_matrices once before set_hessian")]
    NoRows,
    /// Compliances of another length than the number of rows.
    #[error("compliance has {got} entries, the solver has {expected} rows")]
    ComplianceLength {
        /// Entries given.
        got: usize,
        /// Rows of the solver.
        expected: usize,
    },
    /// A compliance that is negative or not finite.
    #[error("compliance of row {row} is {value:e}; use 0 for a hard row, above 0 for a soft one")]
    ComplianceEntry {
        /// Row of the entry.
        row: usize,
        /// The entry.
        value: f64,
    },
    /// A setting outside its range.
    #[error("setting {name} = {value:e} must lie in {range}")]
    BadSetting {
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The range it must lie in.
        range: &'static str,
    },
}

/// A solver for `min 1/2 x'Hx + f'x` subject to `lower <= A x <= upper`, of one fixed shape:
/// `n` variables, `m` rows.
///
/// Bounds may be infinite, and `lower == upper` makes an equality. No method but a constructor
/// allocates, and none panics.
pub trait QpSolver: core::fmt::Debug + Send {
    /// Takes new matrices: `hessian` `n x n` symmetric positive definite, `rows` `m x n`.
    /// The working set is kept.
    ///
    /// # Errors
    /// Wrong shapes, entries that are not finite, a Hessian that is not symmetric positive
    /// definite. The matrices before the call then stay in force.
    fn set_matrices(&mut self, hessian: &DMatrix<f64>, rows: &DMatrix<f64>) -> Result<(), QpError>;

    /// Takes a new `hessian` (`n x n`) for the rows in force, for a model that changes in every
    /// tick. The working set is kept.
    ///
    /// # Errors
    /// As [`Self::set_matrices`], and if no rows were set before.
    fn set_hessian(&mut self, hessian: &DMatrix<f64>) -> Result<(), QpError>;

    /// Softens rows: row i may miss its bound by `s`, at the cost of `s² / (2 compliance[i])`.
    /// Zero (the default) makes a hard row. A row kept at its bound then satisfies
    /// `aᵢ x - compliance[i] multiplierᵢ = bound`, so soft rows never make a problem infeasible
    /// (`lower > upper` in one row still does). Stays in force with new matrices.
    ///
    /// # Errors
    /// A length other than `m`, an entry that is negative or not finite; the old ones then stay.
    fn set_compliance(&mut self, compliance: &[f64]) -> Result<(), QpError>;

    /// Solves for `f` (`n`) and the bounds (`m` each), in a bounded number of steps, starting
    /// from the current working set.
    ///
    /// The result is a function of the matrices, the arguments and [`Self::working_set`] alone,
    /// to the last bit. Vectors of a wrong length count as `NotFinite`.
    fn solve(&mut self, f: &DVector<f64>, lower: &DVector<f64>, upper: &DVector<f64>) -> QpOutcome;

    /// The last iterate (`n`), always finite; zeros before the first solve and where none exists.
    fn solution(&self) -> &DVector<f64>;

    /// Row multipliers (`m`) with `H x + f + A' multipliers = 0`, soft or hard: positive at an upper bound,
    /// negative at a lower one.
    fn multipliers(&self) -> &DVector<f64>;

    /// Which bound each row (`m`) is held at: -1 lower, +1 upper, 0 none.
    fn working_set(&self) -> &[i8];

    /// Replaces the working set, e.g. by that of a solver this one takes over from.
    ///
    /// # Errors
    /// A wrong length or an entry other than -1, 0, +1; the old set then stays.
    fn set_working_set(&mut self, set: &[i8]) -> Result<(), QpError>;

    /// Forgets working set, solution and multipliers; keeps the matrices.
    fn clear(&mut self);
}

/// Checks compliances before they are taken over.
pub(crate) fn check_compliance(compliance: &[f64], rows: usize) -> Result<(), QpError> {
    if compliance.len() != rows {
        return Err(QpError::ComplianceLength { got: compliance.len(), expected: rows });
    }
    match compliance.iter().position(|c| !c.is_finite() || *c < 0.0) {
        Some(row) => Err(QpError::ComplianceEntry { row, value: compliance[row] }),
        None => Ok(()),
    }
}

/// Checks a working set before it is taken over.
pub(crate) fn check_working_set(set: &[i8], rows: usize) -> Result<(), QpError> {
    if set.len() != rows {
        return Err(QpError::WorkingSetLength { got: set.len(), expected: rows });
    }
    match set.iter().position(|side| !(-1..=1).contains(side)) {
        Some(row) => Err(QpError::WorkingSetEntry { row, value: set[row] }),
        None => Ok(()),
    }
}
