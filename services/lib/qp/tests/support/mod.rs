//! Random problems of known kind, and a reference solver that shares no code with the crate.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
#![allow(dead_code, reason = "each test file uses a part")]

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};
use nalgebra::{DMatrix, DVector};
use qp::{ActiveSet, QpError, QpSolver, Settings};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One QP: `min 1/2 x'Hx + f'x`, `lower <= A x <= upper`.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub(crate) hessian: DMatrix<f64>,
    pub(crate) rows: DMatrix<f64>,
    pub(crate) f: DVector<f64>,
    pub(crate) lower: DVector<f64>,
    pub(crate) upper: DVector<f64>,
}

pub(crate) fn generator(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Uniform in [-1, 1).
pub(crate) fn sample(random: &mut ChaCha8Rng) -> f64 {
    random.random_range(-1.0..1.0)
}

pub(crate) fn matrix(random: &mut ChaCha8Rng, rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| sample(random))
}

pub(crate) fn vector(random: &mut ChaCha8Rng, length: usize) -> DVector<f64> {
    DVector::from_fn(length, |_, _| sample(random))
}

/// A symmetric positive definite matrix with eigenvalues spread evenly in log from 1 to 1/`cond`.
pub(crate) fn hessian(random: &mut ChaCha8Rng, n: usize, cond: f64) -> DMatrix<f64> {
    let basis = matrix(random, n, n).qr().q();
    let last = (n.max(2) - 1) as f64;
    let values = DVector::from_fn(n, |i, _| cond.powf(-(i as f64) / last));
    let h = &basis * DMatrix::from_diagonal(&values) * basis.transpose();
    (&h + h.transpose()) * 0.5
}

/// Feasible by construction: the rows leave room around a random point; a quarter of the bounds
/// is infinite, a tenth of the rows are equalities.
pub(crate) fn feasible(random: &mut ChaCha8Rng, n: usize, m: usize, cond: f64) -> Problem {
    let (hessian, rows) = (hessian(random, n, cond), matrix(random, m, n));
    let inside = &rows * (vector(random, n) * 0.3);
    let (mut lower, mut upper) = (inside.clone(), inside.clone());
    let mut equalities = 0;
    for i in 0..m {
        if equalities < n / 3 && random.random_range(0.0..1.0) < 0.1 {
            equalities += 1;
            continue;
        }
        lower[i] -= if random.random_range(0.0..1.0) < 0.25 { f64::INFINITY } else { gap(random) };
        upper[i] += if random.random_range(0.0..1.0) < 0.25 { f64::INFINITY } else { gap(random) };
    }
    let f = &hessian * (vector(random, n) * 3.0);
    Problem { hessian, rows, f, lower, upper }
}

fn gap(random: &mut ChaCha8Rng) -> f64 {
    random.random_range(0.0..0.5_f64)
}

/// The shape of an incremental MPC: box on the increments, box on their running sums, a dense
/// Hessian of a double integrator's response. `ratio` full-rate steps reach the level bound, so
/// a whole ratio gives exactly tied rows.
pub(crate) fn mpc(random: &mut ChaCha8Rng, moves: usize, ratio: f64) -> Problem {
    let horizon = moves + 12;
    let step = |k: usize| if k == 0 { 0.0 } else { 0.5 * (k * k) as f64 };
    let response = DMatrix::from_fn(horizon, moves, |i, j| step((i + 1).saturating_sub(j)));
    let response = &response / response.norm() * (moves as f64).sqrt();
    let hessian = response.tr_mul(&response) + DMatrix::identity(moves, moves) * 1e-5;
    let rows = DMatrix::from_fn(2 * moves, moves, |i, j| {
        f64::from(u8::from(if i < moves { i == j } else { j <= i - moves }))
    });
    let level = sample(random).clamp(-0.9, 0.9) * ratio;
    let bound = DVector::from_fn(2 * moves, |i, _| if i < moves { 1.0 } else { ratio });
    let shift = DVector::from_fn(2 * moves, |i, _| if i < moves { 0.0 } else { level });
    let f = response.tr_mul(&(vector(random, horizon) + response.column(0) * sample(random)));
    Problem { hessian, rows, f: f * 2.0, lower: -&bound - &shift, upper: bound - shift }
}

impl Problem {
    pub(crate) fn n(&self) -> usize {
        self.f.len()
    }

    pub(crate) fn m(&self) -> usize {
        self.lower.len()
    }

    pub(crate) fn cost(&self, x: &DVector<f64>) -> f64 {
        0.5 * x.dot(&(&self.hessian * x)) + self.f.dot(x)
    }

    /// Appends copies of `count` rows, each scaled, its bounds with it.
    pub(crate) fn with_duplicates(&self, random: &mut ChaCha8Rng, count: usize) -> Self {
        let mut more = self.clone();
        let m = self.m();
        more.rows = more.rows.resize_vertically(m + count, 0.0);
        more.lower = more.lower.resize_vertically(m + count, 0.0);
        more.upper = more.upper.resize_vertically(m + count, 0.0);
        for k in m..m + count {
            let source = random.random_range(0..m);
            let factor = [1.0, -1.0, 3.0, 1e-3][random.random_range(0..4_usize)];
            more.rows.set_row(k, &(self.rows.row(source) * factor));
            let ends = (self.lower[source] * factor, self.upper[source] * factor);
            more.lower[k] = ends.0.min(ends.1);
            more.upper[k] = ends.0.max(ends.1);
        }
        more
    }

    /// The same problem with one more variable per soft row, `s / √compliance`.
    pub(crate) fn with_slacks(&self, compliance: &[f64]) -> Self {
        let mut more = self.clone();
        for (i, c) in compliance.iter().enumerate().filter(|(_, c)| **c > 0.0) {
            let n = more.n();
            more.hessian = more.hessian.resize(n + 1, n + 1, 0.0);
            more.hessian[(n, n)] = 1.0;
            more.rows = more.rows.resize_horizontally(n + 1, 0.0);
            more.rows[(i, n)] = -c.sqrt();
            more.f = more.f.resize_vertically(n + 1, 0.0);
        }
        more
    }

    /// The same problem in other units: variable j times `columns[j]`, row i times `rows[i]`.
    pub(crate) fn rescaled(&self, columns: &DVector<f64>, rows: &DVector<f64>) -> Self {
        let inverse = DMatrix::from_diagonal(&columns.map(|c| 1.0 / c));
        Self {
            hessian: &inverse * &self.hessian * &inverse,
            rows: DMatrix::from_diagonal(rows) * &self.rows * &inverse,
            f: &inverse * &self.f,
            lower: self.lower.component_mul(rows),
            upper: self.upper.component_mul(rows),
        }
    }

    /// An active-set solver with the matrices set.
    pub(crate) fn active_set(&self) -> Result<ActiveSet, QpError> {
        let mut solver = ActiveSet::new(self.n(), self.m(), Settings::default())?;
        solver.set_matrices(&self.hessian, &self.rows)?;
        Ok(solver)
    }

    /// Worst residual of the solver's answer.
    pub(crate) fn residual(&self, solver: &impl QpSolver) -> f64 {
        let (x, multipliers) = (solver.solution(), solver.multipliers());
        let (f, lower, upper) = (&self.f, &self.lower, &self.upper);
        qp::kkt_residuals(&self.hessian, &self.rows, f, lower, upper, x, multipliers).worst()
    }

    /// The answer of an interior-point solver: the point, or `None` if it proves infeasibility.
    pub(crate) fn reference(&self) -> Option<DVector<f64>> {
        let mut sides: Vec<(usize, f64, f64)> = Vec::new();
        let equal = |i: usize| self.lower[i] >= self.upper[i];
        sides.extend((0..self.m()).filter(|&i| equal(i)).map(|i| (i, 1.0, self.upper[i])));
        let equalities = sides.len();
        for i in (0..self.m()).filter(|&i| !equal(i)) {
            sides.push((i, 1.0, self.upper[i]));
            sides.push((i, -1.0, -self.lower[i]));
        }
        sides.retain(|(_, _, bound)| bound.is_finite());
        let a =
            DMatrix::from_fn(sides.len(), self.n(), |k, j| sides[k].1 * self.rows[(sides[k].0, j)]);
        let b: Vec<f64> = sides.iter().map(|side| side.2).collect();
        let cones = [ZeroConeT(equalities), NonnegativeConeT(sides.len() - equalities)];
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: 1e-11,
            tol_gap_rel: 1e-11,
            tol_feas: 1e-11,
            ..DefaultSettings::default()
        };
        let (p, a) = (sparse(&self.hessian.upper_triangle()), sparse(&a));
        let mut solver =
            DefaultSolver::new(&p, self.f.as_slice(), &a, &b, &cones, settings).ok()?;
        solver.solve();
        match solver.solution.status {
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => None,
            _ => Some(DVector::from_vec(solver.solution.x)),
        }
    }
}

fn sparse(matrix: &DMatrix<f64>) -> CscMatrix<f64> {
    let (rows, columns) = matrix.shape();
    let (mut starts, mut index, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in matrix.column_iter() {
        for (i, &value) in column.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            index.push(i);
            values.push(value);
        }
        starts.push(index.len());
    }
    CscMatrix::new(rows, columns, starts, index, values)
}
