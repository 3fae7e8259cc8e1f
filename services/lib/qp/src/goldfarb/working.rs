//! The factor of the working rows: N = [n₁ n₂ ..] = Q R, Q with orthonormal columns, R upper
//! triangular; rows come by Gram-Schmidt with reorthogonalisation and go by Givens rotations
//! (Daniel, Gragg, Kaufman and Stewart, 1976).

use nalgebra::DMatrix;

use crate::linear::{axpy, column_mut, dot, norm, solve_upper, solve_upper_transposed};
use crate::real::Real;

#[derive(Debug, Clone)]
pub(super) struct WorkingFactor<T> {
    /// Columns of Q, `dim` entries each.
    q: Vec<T>,
    dim: usize,
    most: usize,
    r: DMatrix<T>,
    /// The rows of the problem in the order of the columns of N.
    rows: Vec<usize>,
    /// Result of `project`: n = Q along + across.
    along: Vec<T>,
    across: Vec<T>,
    /// n = N r + across: how working multipliers give way to one of n.
    pub(super) ratio: Vec<T>,
    /// Multipliers of the working rows at the last `point`.
    pub(super) multipliers: Vec<T>,
    targets: Vec<T>,
}

impl<T: Real> WorkingFactor<T> {
    pub(super) fn new(n: usize, m: usize) -> Self {
        // With soft rows all rows may stand in the factor.
        let most = m;
        Self {
            q: vec![T::ZERO; (n + m) * most],
            dim: n,
            most: n.min(m),
            r: DMatrix::from_element(most, most, T::ZERO),
            rows: Vec::with_capacity(most),
            along: vec![T::ZERO; most],
            across: vec![T::ZERO; n + m],
            ratio: vec![T::ZERO; most],
            multipliers: vec![T::ZERO; most],
            targets: vec![T::ZERO; most],
        }
    }

    pub(super) fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// Forgets all rows; the next ones have `dim` entries.
    pub(super) fn clear(&mut self, dim: usize) {
        self.rows.clear();
        self.dim = dim;
        self.most = dim.min(self.multipliers.len());
    }

    /// Splits `normal` into its part along the working rows and the rest; returns the length of
    /// the rest, zero when no further row fits.
    pub(super) fn project(&mut self, normal: &[T]) -> T {
        let count = self.rows.len();
        let across = &mut self.across[..self.dim];
        across.copy_from_slice(normal);
        self.along[..count].fill(T::ZERO);
        // The second pass removes what rounding left of the first ("twice is enough").
        for _ in 0..2 {
            for k in 0..count {
                let direction = &self.q[k * self.dim..][..self.dim];
                let share = dot(direction, across);
                axpy(-share, direction, across);
                self.along[k] += share;
            }
        }
        self.ratio[..count].copy_from_slice(&self.along[..count]);
        solve_upper(&self.r, &mut self.ratio[..count]);
        if count == self.most { T::ZERO } else { norm(&self.across[..self.dim]) }
    }

    /// Appends the row last projected, whose `rest` must be positive.
    pub(super) fn push(&mut self, row: usize, rest: T) {
        let k = self.rows.len();
        let direction = &mut self.q[k * self.dim..][..self.dim];
        for (entry, across) in direction.iter_mut().zip(&self.across) {
            *entry = *across / rest;
        }
        let last = column_mut(&mut self.r, k);
        last[..k].copy_from_slice(&self.along[..k]);
        last[k] = rest;
        self.rows.push(row);
    }

    /// Takes out the row at `position` of `rows`, and returns it.
    pub(super) fn remove(&mut self, position: usize) -> usize {
        let row = self.rows.remove(position);
        let count = self.rows.len();
        for j in position..count {
            for i in 0..=j + 1 {
                self.r[(i, j)] = self.r[(i, j + 1)];
            }
        }
        for j in position..count {
            let (a, b) = (self.r[(j, j)], self.r[(j + 1, j)]);
            let h = (a * a + b * b).sqrt();
            let (cos, sin) = (a / h, b / h);
            for l in j..count {
                let (up, down) = (self.r[(j, l)], self.r[(j + 1, l)]);
                self.r[(j, l)] = cos * up + sin * down;
                self.r[(j + 1, l)] = cos * down - sin * up;
            }
            let (left, right) = self.q[j * self.dim..][..2 * self.dim].split_at_mut(self.dim);
            for (left, right) in left.iter_mut().zip(right) {
                (*left, *right) = (cos * *left + sin * *right, cos * *right - sin * *left);
            }
        }
        row
    }

    /// The minimum of 1/2 |y|² + g'y with every working row at its `target`. Writes y and
    /// `multipliers`: y = -g - N multipliers.
    pub(super) fn point(&mut self, g: &[T], target: impl Fn(usize) -> T, y: &mut [T]) {
        let count = self.rows.len();
        for (entry, &row) in self.targets.iter_mut().zip(&self.rows) {
            *entry = target(row);
        }
        let targets = &mut self.targets[..count];
        solve_upper_transposed(&self.r, targets);
        y.iter_mut().zip(g).for_each(|(y, g)| *y = -*g);
        for (k, target) in targets.iter().enumerate() {
            // One column after the other, each on what is left: error-free to first order.
            let direction = &self.q[k * self.dim..][..self.dim];
            let excess = dot(direction, y) - *target;
            axpy(-excess, direction, y);
            self.multipliers[k] = excess;
        }
        solve_upper(&self.r, &mut self.multipliers[..count]);
    }
}
