//! From the end of the walk to an answer in the caller's coordinates: iterative refinement on
//! the working set, then the residuals decide whether `Solved` may be said.

use super::Goldfarb;
use crate::kkt::Evaluated;
use crate::linear::axpy;
use crate::solver::QpStatus;

/// The first refinement brings residuals to rounding level; later ones serve hard cases only.
const MOST_REFINEMENTS: usize = 3;
/// Residual, relative to the promised one, that needs no further refinement.
const GOOD_ENOUGH: f64 = 1e-3;

impl Goldfarb {
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
            for _ in 0..MOST_REFINEMENTS {
                self.refine(f, bounds);
                self.evaluate();
                let residual = self.residual(f, bounds);
                let kept = residual <= self.tolerance;
                status = if kept { QpStatus::Solved } else { QpStatus::IterationLimit };
                if residual <= self.tolerance * GOOD_ENOUGH {
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
        axpy(1.0, &self.y[..self.x.len()], self.x.as_mut_slice());
        for (position, &row) in self.working.rows().iter().enumerate() {
            let multiplier = &mut self.multipliers[row];
            *multiplier += self.working.multipliers[position] / self.scaled.length[row];
            if lower[row] >= upper[row] {
                self.set[row] = if *multiplier < 0.0 { -1 } else { 1 };
            } else if self.set[row] > 0 {
                *multiplier = multiplier.max(0.0);
            } else {
                *multiplier = multiplier.min(0.0);
            }
        }
    }

    /// H x, A' multipliers and A x.
    fn evaluate(&mut self) {
        self.scaled.curved(self.x.as_slice(), &mut self.scratch[..self.x.len()]);
        self.pull.fill(0.0);
        for &row in self.working.rows() {
            axpy(self.multipliers[row], self.scaled.row(row), &mut self.pull);
        }
        for row in 0..self.values.len() {
            let multiplier = self.multipliers[row];
            self.values[row] = self.scaled.value(row, self.x.as_slice(), multiplier);
        }
    }

    /// One step of iterative refinement: the equality problem of the residuals.
    fn refine(&mut self, f: &[f64], bounds: (&[f64], &[f64])) {
        let (n, dim) = (self.x.len(), self.scaled.dim());
        for (j, entry) in self.y[..n].iter_mut().enumerate() {
            *entry = self.scratch[j] + f[j] + self.pull[j];
        }
        self.scaled.gradient(&self.y[..n], &mut self.gradient[..dim]);
        let (set, values, length) = (&self.set, &self.values, &self.scaled.length);
        let target = |row: usize| {
            let bound = if set[row] < 0 { bounds.0[row] } else { bounds.1[row] };
            (bound - values[row]) / length[row]
        };
        self.working.point(&self.gradient[..dim], target, &mut self.y[..dim]);
        self.correct(bounds);
    }

    fn residual(&self, f: &[f64], (lower, upper): (&[f64], &[f64])) -> f64 {
        let (x, multipliers) = (self.x.as_slice(), self.multipliers.as_slice());
        let (curved, pull, values) = (&self.scratch[..x.len()], &self.pull, &self.values);
        let (d, reach, peak) = (&self.scaled.d, &self.scaled.reach, &self.scaled.peak);
        Evaluated { d, reach, peak, curved, pull, values, f, lower, upper, x, multipliers }
            .residuals()
            .worst()
    }
}
