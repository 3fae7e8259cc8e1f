//! The problem in coordinates where its Hessian is the identity and its rows have length one.
//!
//! With D = diag(H)^-1/2, D H D = L L' and x = D L'⁻¹ y the cost is 1/2 |y|² + g'y, g = L⁻¹ D f,
//! and row i reads nᵢ'y with nᵢ = L⁻¹ D aᵢ / sᵢ, sᵢ = |L⁻¹ D aᵢ|.
//!
//! A soft row of compliance cᵢ is a hard one with a variable of its own, tᵢ = √cᵢ multiplierᵢ: the
//! cost grows by 1/2 tᵢ², the row reads aᵢ'x - √cᵢ tᵢ. With any soft row y has `n + m` entries.

use nalgebra::DMatrix;

use crate::linear::{cholesky, column, dot, norm, solve_lower, solve_lower_transposed, times};
use crate::real::Real;
use crate::solver::{QpError, QpStatus, check_compliance};

/// Entries may differ from their mirror by this much of √(`H_ii` `H_jj`): rounding of a product.
const SYMMETRY: f64 = 1e-8;

/// Above this the squares of the methods overflow.
const MAX_GRADIENT: f64 = 1e140;

#[derive(Debug, Clone)]
pub(crate) struct ScaledProblem<T = f64> {
    /// False until the first matrices were accepted.
    ready: bool,
    /// H, `n x n`.
    hessian: DMatrix<f64>,
    /// A', `n x m`: one column per row of the problem.
    rows: DMatrix<f64>,
    /// The diagonal of D.
    pub(crate) d: Vec<T>,
    /// L, and the memory for the next one: a refused Hessian leaves this one in force.
    factor: DMatrix<T>,
    spare: DMatrix<T>,
    /// Compliance per row, zero for a hard one.
    pub(crate) compliance: Vec<f64>,
    /// Entries of y: `n`, or `n + m` with soft rows.
    dim: usize,
    /// Unit normals nᵢ, `dim` entries each; zero for a zero row.
    normals: Vec<T>,
    /// sᵢ; zero for a zero row.
    pub(crate) length: Vec<T>,
    /// Sum and maximum of |aᵢⱼ| dⱼ per row.
    pub(crate) reach: Vec<f64>,
    pub(crate) peak: Vec<f64>,
    /// Relative rounding noise of the normals: below it two rows count as dependent.
    pub(crate) noise: f64,
}

impl<T: Real> ScaledProblem<T> {
    pub(crate) fn new(n: usize, m: usize) -> Self {
        Self {
            ready: false,
            hessian: DMatrix::zeros(n, n),
            rows: DMatrix::zeros(n, m),
            d: vec![T::from(1.0); n],
            factor: DMatrix::from_element(n, n, T::ZERO),
            spare: DMatrix::from_element(n, n, T::ZERO),
            compliance: vec![0.0; m],
            dim: n,
            normals: vec![T::ZERO; (n + m) * m],
            length: vec![T::ZERO; m],
            reach: vec![0.0; m],
            peak: vec![0.0; m],
            noise: 0.0,
        }
    }

    pub(crate) fn set(&mut self, h: &DMatrix<f64>, a: &DMatrix<f64>) -> Result<(), QpError> {
        let (n, m) = self.rows.shape();
        check_matrix("rows", a, m, n)?;
        self.factorise(h)?;
        for i in 0..m {
            for j in 0..n {
                self.rows[(j, i)] = a[(i, j)];
            }
        }
        self.ready = true;
        self.set_normals();
        Ok(())
    }

    /// Takes the problem that another one holds, as that one has checked it.
    pub(crate) fn take_over(&mut self, hessian: &DMatrix<f64>, other: &ScaledProblem) -> bool {
        self.rows.copy_from(&other.rows);
        self.compliance.copy_from_slice(&other.compliance);
        self.dim = other.dim;
        self.ready = other.ready && self.factorise(hessian).is_ok();
        if self.ready {
            self.set_normals();
        }
        self.ready
    }

    pub(crate) fn set_hessian(&mut self, h: &DMatrix<f64>) -> Result<(), QpError> {
        if !self.ready {
            return Err(QpError::NoRows);
        }
        self.factorise(h)?;
        self.set_normals();
        Ok(())
    }

    pub(crate) fn set_compliance(&mut self, compliance: &[f64]) -> Result<(), QpError> {
        check_compliance(compliance, self.compliance.len())?;
        self.compliance.copy_from_slice(compliance);
        let (n, m) = self.rows.shape();
        let soft = compliance.iter().any(|c| *c > 0.0);
        self.dim = if soft { n + m } else { n };
        if self.ready {
            self.set_normals();
        }
        Ok(())
    }

    /// Entries of y and of the unit normals.
    pub(crate) fn dim(&self) -> usize {
        self.dim
    }

    /// Checks H and computes D and L; on refusal the old ones stay.
    fn factorise(&mut self, h: &DMatrix<f64>) -> Result<(), QpError> {
        let n = self.d.len();
        check_matrix("hessian", h, n, n)?;
        check_symmetric(h)?;
        for j in 0..n {
            for i in 0..n {
                let [own, row, column] = [(i, j), (i, i), (j, j)].map(|at| T::from(h[at]));
                self.spare[(i, j)] = own / row.sqrt() / column.sqrt();
            }
        }
        // Below the rounding of n subtractions a pivot proves nothing about definiteness.
        cholesky(&mut self.spare, 4.0 * n as f64 * T::EPSILON)
            .map_err(|(index, pivot)| QpError::NotPositiveDefinite { index, pivot })?;
        core::mem::swap(&mut self.factor, &mut self.spare);
        self.hessian.copy_from(h);
        for j in 0..n {
            self.d[j] = T::from(1.0) / T::from(h[(j, j)]).sqrt();
        }
        let least = (0..n).map(|j| self.factor[(j, j)].round()).fold(1.0, f64::min);
        self.noise = 8.0 * T::EPSILON / least;
        Ok(())
    }

    fn set_normals(&mut self) {
        for i in 0..self.length.len() {
            self.set_normal(i);
        }
    }

    fn set_normal(&mut self, i: usize) {
        let whole = &mut self.normals[i * self.dim..][..self.dim];
        whole.fill(T::ZERO);
        let softness = T::from(self.compliance[i]).sqrt();
        let (normal, slack) = whole.split_at_mut(self.d.len());
        for ((entry, a), d) in normal.iter_mut().zip(column(&self.rows, i)).zip(&self.d) {
            *entry = T::from(*a) * *d;
        }
        self.reach[i] = normal.iter().map(|entry| entry.abs().round()).sum();
        // Two steps, so that rows of 1e-200 do not vanish in their square.
        let largest =
            normal.iter().fold(0.0_f64, |largest, entry| largest.max(entry.abs().round()));
        self.peak[i] = largest;
        if largest < f64::MIN_POSITIVE {
            normal.fill(T::ZERO);
            self.length[i] = softness;
            if softness > T::ZERO {
                slack[i] = T::from(-1.0);
            }
            return;
        }
        let largest = T::from(largest);
        for entry in normal.iter_mut() {
            *entry /= largest;
        }
        solve_lower(&self.factor, normal);
        let across = softness / largest;
        let length = norm(normal).hypot(across);
        for entry in normal.iter_mut() {
            *entry /= length;
        }
        if softness > T::ZERO {
            slack[i] = -across / length;
        }
        self.length[i] = length * largest;
    }

    pub(crate) fn normal(&self, i: usize) -> &[T] {
        &self.normals[i * self.dim..][..self.dim]
    }

    /// Checks the vectors of a solve and writes g; returns how the solve ends if it ends here.
    pub(crate) fn check(
        &self,
        f: &[f64],
        lower: &[f64],
        upper: &[f64],
        g: &mut [T],
    ) -> Result<(), QpStatus> {
        let (n, m) = self.rows.shape();
        let shapes = (f.len(), lower.len(), upper.len()) == (n, m, m);
        let numbers = lower.iter().chain(upper).all(|bound| !bound.is_nan());
        if !self.ready || !shapes || !numbers {
            return Err(QpStatus::NotFinite);
        }
        let (free, _) = g.split_at_mut(n);
        free.iter_mut().zip(f).for_each(|(g, f)| *g = T::from(*f));
        self.gradient(g);
        // `all` of a comparison refuses NaN as well.
        if !g.iter().all(|g| g.round().abs() < MAX_GRADIENT) {
            return Err(QpStatus::NotFinite);
        }
        let feasible = (0..m).all(|i| {
            let (low, high) = (lower[i], upper[i]);
            let possible = low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY;
            possible && (self.length[i] > T::ZERO || (low <= 0.0 && 0.0 <= high))
        });
        if feasible { Ok(()) } else { Err(QpStatus::Infeasible) }
    }

    /// g = L⁻¹ D f in place of f, zero for the variables of soft rows.
    pub(crate) fn gradient(&self, g: &mut [T]) {
        let (g, slack) = g.split_at_mut(self.d.len());
        slack.fill(T::ZERO);
        for (g, d) in g.iter_mut().zip(&self.d) {
            *g *= *d;
        }
        solve_lower(&self.factor, g);
    }

    /// x = D L'⁻¹ y, in place, in the first `n` entries.
    pub(crate) fn unscale(&self, y: &mut [T]) {
        let y = &mut y[..self.d.len()];
        solve_lower_transposed(&self.factor, y);
        y.iter_mut().zip(&self.d).for_each(|(x, d)| *x *= *d);
    }

    /// H x.
    pub(crate) fn curved(&self, x: &[T], out: &mut [T]) {
        times(&self.hessian, x, out);
    }

    /// aᵢ'x - cᵢ multiplier: what a row compares with its bounds.
    pub(crate) fn value(&self, i: usize, x: &[T], multiplier: T) -> T {
        dot(self.row(i), x) - T::from(self.compliance[i]) * multiplier
    }

    /// |A| |x|.
    pub(crate) fn terms(&self, x: &[f64], out: &mut [f64]) {
        for (i, terms) in out.iter_mut().enumerate() {
            let pairs = self.row(i).iter().zip(x);
            *terms = pairs.map(|(a, x)| (a * x).abs()).sum();
        }
    }

    /// Row i of A.
    pub(crate) fn row(&self, i: usize) -> &[f64] {
        column(&self.rows, i)
    }
}

pub(crate) fn check_matrix(
    what: &'static str,
    matrix: &DMatrix<f64>,
    expected_rows: usize,
    expected_columns: usize,
) -> Result<(), QpError> {
    let (rows, columns) = matrix.shape();
    if (rows, columns) != (expected_rows, expected_columns) {
        return Err(QpError::MatrixShape { what, rows, columns, expected_rows, expected_columns });
    }
    // No early end: without branches several entries go at once.
    let finite = matrix.as_slice().iter().fold(true, |finite, entry| {
        let own = entry.is_finite();
        finite & own
    });
    if finite {
        return Ok(());
    }
    match matrix.iter().position(|value| !value.is_finite()) {
        Some(at) => {
            let (row, column) = (at % rows, at / rows);
            Err(QpError::EntryNotFinite { what, row, column, value: matrix[(row, column)] })
        }
        None => Ok(()),
    }
}

pub(crate) fn check_symmetric(h: &DMatrix<f64>) -> Result<(), QpError> {
    let n = h.ncols();
    let mut exact = true;
    for j in 0..n {
        let rest = h.as_slice()[j * n..].iter().skip(j);
        let mirrored = h.as_slice()[j * n..].iter().skip(j).step_by(n.max(1));
        for (entry, mirror) in rest.take(n - j).zip(mirrored) {
            let own = entry.to_bits() == mirror.to_bits();
            exact &= own;
        }
        exact &= h[(j, j)] >= f64::MIN_POSITIVE;
    }
    if exact {
        return Ok(());
    }
    for j in 0..n {
        let pivot = h[(j, j)];
        // Below the smallest normal number its inverse root times itself is no longer one.
        if pivot < f64::MIN_POSITIVE {
            return Err(QpError::NotPositiveDefinite { index: j, pivot });
        }
        for i in 0..j {
            let (value, mirror) = (h[(i, j)], h[(j, i)]);
            if (value - mirror).abs() > SYMMETRY * h[(i, i)].sqrt() * pivot.sqrt() {
                return Err(QpError::NotSymmetric { row: i, column: j, value, mirror });
            }
        }
    }
    Ok(())
}
