//! From the end of the walk to an answer in the caller's coordinates: iterative refinement on
//! the working set, then the residuals decide whether `Solved` may be returned.

use super::Goldfarb;
use crate::kkt::Evaluated;
use crate::linear::axpy;
use crate::real::Real;
use crate::solver::QpStatus;

/// The first refinement brings residuals to rounding level; later ones serve hard cases only.
const MAX_REFINEMENTS: usize = 3;
/// Residual, relative to the promised one, that needs no further refinement.
const GOOD_ENOUGH: f64 = 1e-3;
/// No promise makes a residual this close to rounding doubtful.
const MIN_RESIDUAL: f64 = 1e-13;

impl<T: Real> Goldfarb<T> {
    /// Writes solution and multipliers; confirms or withdraws the verdict of the walk.
    pub(super) fn polish(
        &mut self,
        walked: QpStatus,
        f: &[f64],
        bounds: (&[f64], &[f64]),
    ) -> QpStatus {
        self.correct(bounds);
        let mut status = walked;
        if walked == QpStatus::Solved {
            self.evaluate();
            for _ in 0..MAX_REFINEMENTS {
                self.refine(f, bounds);
                self.evaluate();
                let residual = self.residual(f, bounds);
                let kept = residual <= self.tolerance;
                status = if kept { QpStatus::Solved } else { QpStatus::IterationLimit };
                // In an ill-conditioned cost more would let x be 1e4 times as far off.
                self.doubtful = residual > (self.tolerance * GOOD_ENOUGH).max(MIN_RESIDUAL);
                if !self.doubtful {
                    break;
                }
            }
        }
        if !self.x.iter().chain(&self.multipliers).all(|value| value.is_finite()) {
            self.x.fill(0.0);
            self.multipliers.fill(0.0);
            return if status == QpStatus::Solved { QpStatus::IterationLimit } else { status };
        }
        status
    }

    /// x += D L'⁻¹ y and multipliers += their scaled counterparts; signs kept right.
    fn correct(&mut self, (lower, upper): (&[f64], &[f64])) {
        self.scaled.unscale(&mut self.y);
        axpy(T::from(1.0), &self.y[..self.x.len()], &mut self.point);
        for (position, &row) in self.working.rows().iter().enumerate() {
            let multiplier = &mut self.forces[row];
            *multiplier += self.working.multipliers[position] / self.scaled.length[row];
            if lower[row] >= upper[row] {
                self.set[row] = if *multiplier < T::ZERO { -1 } else { 1 };
            } else if (*multiplier < T::ZERO) == (self.set[row] > 0) {
                *multiplier = T::ZERO;
            }
        }
        round(&self.point, self.x.as_mut_slice());
        round(&self.forces, self.multipliers.as_mut_slice());
    }

    /// H x, A' multipliers and A x.
    fn evaluate(&mut self) {
        self.scaled.curved(&self.point, &mut self.scratch[..self.x.len()]);
        self.pull.fill(T::ZERO);
        for &row in self.working.rows() {
            axpy(self.forces[row], self.scaled.row(row), &mut self.pull);
        }
        for row in 0..self.values.len() {
            self.values[row] = self.scaled.value(row, &self.point, self.forces[row]);
        }
    }

    /// One step of iterative refinement: the equality problem of the residuals.
    fn refine(&mut self, f: &[f64], bounds: (&[f64], &[f64])) {
        let (n, dim) = (self.x.len(), self.scaled.dim());
        for (j, entry) in self.y[..n].iter_mut().enumerate() {
            *entry = self.scratch[j] + T::from(f[j]) + self.pull[j];
        }
        self.gradient[..n].copy_from_slice(&self.y[..n]);
        self.scaled.gradient(&mut self.gradient[..dim]);
        let (set, values, length) = (&self.set, &self.values, &self.scaled.length);
        let target = |row: usize| {
            let bound = if set[row] < 0 { bounds.0[row] } else { bounds.1[row] };
            (T::from(bound) - values[row]) / length[row]
        };
        self.working.point(&self.gradient[..dim], target, &mut self.y[..dim]);
        self.correct(bounds);
    }

    /// Of the rounded answer's numbers.
    fn residual(&mut self, f: &[f64], (lower, upper): (&[f64], &[f64])) -> f64 {
        let n = self.x.len();
        self.measured.take(&self.scaled.d, &self.scratch[..n], &self.pull, &self.values);
        let (x, multipliers) = (self.x.as_slice(), self.multipliers.as_slice());
        self.scaled.terms(x, &mut self.measured.terms);
        let Measured { d, curved, pull, values, terms } = &self.measured;
        let (reach, peak) = (&self.scaled.reach, &self.scaled.peak);
        Evaluated { d, reach, peak, curved, pull, values, terms, f, lower, upper, x, multipliers }
            .residuals()
            .worst()
    }
}

/// What residuals are measured on: D, H x, A' multipliers, values of the rows and sizes of their terms.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    d: Vec<f64>,
    curved: Vec<f64>,
    pull: Vec<f64>,
    values: Vec<f64>,
    terms: Vec<f64>,
}

impl Measured {
    pub(super) fn new(n: usize, m: usize) -> Self {
        let [d, curved, pull] = [n; 3].map(|n| vec![0.0; n]);
        Self { d, curved, pull, values: vec![0.0; m], terms: vec![0.0; m] }
    }

    fn take<T: Real>(&mut self, d: &[T], curved: &[T], pull: &[T], values: &[T]) {
        round(d, &mut self.d);
        round(curved, &mut self.curved);
        round(pull, &mut self.pull);
        round(values, &mut self.values);
    }
}

fn round<T: Real>(from: &[T], to: &mut [f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = from.round());
}
