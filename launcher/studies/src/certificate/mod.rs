//! Offline: the largest number of working-set changes that `qp::ActiveSet` can need on a
//! program whose data are affine in a few parameters, over a box of them.
//!
//! Every decision of the walk (which row is violated most, which multiplier reaches zero first,
//! which ones push the wrong way) compares affine functions of the parameters. So all its paths
//! are enumerated as a tree, each with the polytope of parameters that take it; an empty polytope
//! ends a branch. This is exact for the walk in exact arithmetic with rows satisfied to
//! [`MARGIN`]; where a comparison is closer than rounding both ways are followed. Rows are hard, and
//! the blocks of a separable program are certified one by one: their changes add up.

mod lp;
mod region;
mod tree;

use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;

use region::Line;
use tree::{Enumeration, Outcome};

/// Violation, relative to what a row can reach in the box, from which a row counts as violated.
pub const MARGIN: f64 = 1e-7;

/// A number that is affine in the parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Affine {
    /// Per parameter.
    pub slope: DVector<f64>,
    /// Where all parameters are zero.
    pub constant: f64,
}

/// One row; no two of a program may have the same direction, all bounds on it belong to one.
#[derive(Debug, Clone, PartialEq)]
pub struct ParametricRow {
    /// aᵢ, `n`.
    pub normal: DVector<f64>,
    /// Lower bounds; the largest holds.
    pub lower: Vec<Affine>,
    /// Upper bounds; the smallest holds.
    pub upper: Vec<Affine>,
}

/// `min 1/2 x'Hx + f'x`, `lower <= A x <= upper`, over a box of the parameters that f and bounds
/// depend on. It must have a solution everywhere in the box.
#[derive(Debug, Clone, PartialEq)]
pub struct ParametricQp {
    /// H, `n x n`.
    pub hessian: DMatrix<f64>,
    /// f, `n`.
    pub f: Vec<Affine>,
    pub rows: Vec<ParametricRow>,
    /// One corner of the box and the opposite one, each as long as the parameters are many.
    pub from: DVector<f64>,
    /// The other corner.
    pub to: DVector<f64>,
}

/// Working sets that a solve may start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// The empty one.
    Cold,
    /// Any that is optimal somewhere in the box, and the empty one: whatever was solved before.
    Warm,
}

/// What holds everywhere in the box.
#[derive(Debug, Clone, PartialEq)]
pub struct Certificate {
    /// Most changes of the working set in a solve.
    pub changes: u32,
    /// Parameters of a solve that needs so many.
    pub at: DVector<f64>,
    /// The working set that it starts from, one side per row.
    pub from: Vec<i8>,
    /// Working sets that were started from.
    pub starts: usize,
    /// Paths that some parameters take from these, which is what the enumeration costs.
    pub paths: u64,
}

/// Why there is no certificate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CertificateError {
    /// A length that does not fit `hessian` or the parameters.
    #[error("{what} has length {got}, expected {expected}")]
    Length {
        /// What was measured.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length that fits.
        expected: usize,
    },
    /// The Hessian is not positive definite.
    #[error("the hessian is not positive definite; weight every variable in the cost")]
    NotPositiveDefinite,
    /// A number that is not finite; leave out a bound that is none.
    #[error("{what} holds a number that is not finite; leave out a bound that does not exist")]
    NotFinite {
        /// Where.
        what: &'static str,
    },
    /// Two rows with the same direction.
    #[error("rows {first} and {second} are parallel; give them as one row with several bounds")]
    ParallelRows {
        /// One of them.
        first: usize,
        /// The other.
        second: usize,
    },
    /// A corner of the box where no point satisfies the rows.
    #[error("there is no solution at the parameters {at:?}; make the box smaller")]
    Infeasible {
        /// Parameters there.
        at: Vec<f64>,
    },
    /// More paths than allowed.
    #[error("more than {most} paths; allow more, or make the box or the program smaller")]
    TooManyPaths {
        /// What was allowed.
        most: u64,
    },
}

impl ParametricQp {
    /// Enumerates all paths of the walk, at most `most_paths`.
    ///
    /// # Errors
    /// Data that do not fit together, a program without solution somewhere, too many paths.
    pub fn certify(&self, start: Start, most_paths: u64) -> Result<Certificate, CertificateError> {
        self.check()?;
        let program = self.in_unit_box()?;
        let mut all = Enumeration::new(&program, most_paths);
        let mut done = BTreeSet::new();
        let mut next = Some(vec![0; self.rows.len()]);
        while let Some(set) = next {
            all.follow(&set).map_err(|end| self.error(&end))?;
            done.insert(set);
            // Warm starts may end in further sets where several are optimal at once.
            next = all.sets.difference(&done).next().filter(|_| start == Start::Warm).cloned();
        }
        let (changes, at, from) = all.worst;
        let at = DVector::from_vec(self.parameters(&at));
        Ok(Certificate { changes, at, from, starts: done.len(), paths: all.paths })
    }

    fn error(&self, end: &Outcome) -> CertificateError {
        match end {
            Outcome::TooManyPaths(most) => CertificateError::TooManyPaths { most: *most },
            Outcome::Infeasible(unit) => CertificateError::Infeasible { at: self.parameters(unit) },
        }
    }

    /// From the unit box.
    fn parameters(&self, unit: &[f64]) -> Vec<f64> {
        unit.iter().enumerate().map(|(i, t)| self.middle(i) + t * self.half(i)).collect()
    }

    fn middle(&self, parameter: usize) -> f64 {
        0.5 * (self.from[parameter] + self.to[parameter])
    }

    fn half(&self, parameter: usize) -> f64 {
        0.5 * (self.to[parameter] - self.from[parameter]).abs()
    }

    fn check(&self) -> Result<(), CertificateError> {
        let (n, d) = (self.hessian.nrows(), self.from.len());
        let length = |what, got, expected| {
            if got == expected {
                Ok(())
            } else {
                Err(CertificateError::Length { what, got, expected })
            }
        };
        let finite = |what, values: &[f64]| {
            if values.iter().all(|value| value.is_finite()) {
                Ok(())
            } else {
                Err(CertificateError::NotFinite { what })
            }
        };
        length("hessian", self.hessian.ncols(), n)?;
        length("f", self.f.len(), n)?;
        length("to", self.to.len(), d)?;
        // The linear programs add one variable.
        length("from (at most)", d, d.min(lp::WIDEST - 1))?;
        finite("hessian", self.hessian.as_slice())?;
        finite("the box", self.from.as_slice())?;
        finite("the box", self.to.as_slice())?;
        let bounds = self.rows.iter().flat_map(|row| row.lower.iter().chain(&row.upper));
        for value in self.f.iter().chain(bounds) {
            length("slope", value.slope.len(), d)?;
            finite("f or a bound", value.slope.as_slice())?;
            finite("f or a bound", &[value.constant])?;
        }
        for row in &self.rows {
            length("normal", row.normal.len(), n)?;
            finite("normal", row.normal.as_slice())?;
        }
        Ok(())
    }

    /// The same with parameters in [-1, 1], and what the walk needs of the matrices.
    fn in_unit_box(&self) -> Result<tree::Program, CertificateError> {
        let (n, m) = (self.hessian.nrows(), self.rows.len());
        let factor = self.hessian.clone().cholesky();
        let inverse = factor.ok_or(CertificateError::NotPositiveDefinite)?.inverse();
        let d: Vec<f64> = self.hessian.diagonal().iter().map(|h| 1.0 / h.sqrt()).collect();
        let normals = DMatrix::from_fn(m, n, |i, j| self.rows[i].normal[j]);
        let gram = &normals * &inverse * normals.transpose();
        for first in 0..m {
            for second in 0..first {
                let (own, other) = (gram[(first, first)], gram[(second, second)]);
                if own * other - gram[(first, second)] * gram[(first, second)]
                    <= 1e-10 * own * other
                {
                    return Err(CertificateError::ParallelRows { first: second, second: first });
                }
            }
        }
        let slopes: Vec<Line> = self.f.iter().map(|f| self.line(f)).collect();
        let image = -(&normals * &inverse);
        let free = (0..m).map(|i| {
            let zero = Line::zero(self.from.len());
            (0..n).fold(zero, |sum, j| sum.plus(image[(i, j)], &slopes[j]))
        });
        let lines = |values: &Vec<Affine>| values.iter().map(|v| self.line(v)).collect();
        let unit = |i: usize| (0..n).map(|j| (normals[(i, j)] * d[j]).abs()).fold(0.0, f64::max);
        Ok(tree::Program {
            parameters: self.from.len(),
            most: n,
            free: free.collect(),
            lower: self.rows.iter().map(|row| lines(&row.lower)).collect(),
            upper: self.rows.iter().map(|row| lines(&row.upper)).collect(),
            unit: (0..m).map(unit).collect(),
            gram,
        })
    }

    fn line(&self, value: &Affine) -> Line {
        let mut line = Line::zero(self.from.len());
        line.constant = value.constant;
        for (i, slope) in value.slope.iter().enumerate() {
            line.slope[i] = slope * self.half(i);
            line.constant += slope * self.middle(i);
        }
        line
    }
}
