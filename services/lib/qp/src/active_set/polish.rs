//! From the end of a walk to an answer whose residuals have been measured and corrected, for
//! blocks whose Hessian leaves products with its inverse too few digits.

use super::block::Block;
use super::inverse::times;
use super::tableau::MAX_ROWS;
use super::walk::Doubt;

/// Residuals below this need no correction.
pub(super) const EXACT: f64 = 1e-11;
/// Corrections of an answer whose residual is measured.
pub(super) const MAX_CORRECTIONS: usize = 4;

impl Block<'_> {
    /// Measures the residuals of the walk's end in the original problem and corrects them.
    pub(super) fn polish(&mut self) -> Result<(), Doubt> {
        let (n, wide, count) = (self.shape.n, self.shape.wide, *self.factor.count);
        for (x, &unit) in self.x.iter_mut().zip(self.structure.units(&self.shape)) {
            *x = self.values[unit as usize];
        }
        let tall = self.shape.tall;
        let small = tall <= MAX_ROWS;
        let mut left = f64::INFINITY;
        for _ in 0..MAX_CORRECTIONS {
            left = self.residual();
            if left <= EXACT.min(1e-2 * self.tolerance) || left.is_nan() {
                break;
            }
            // The equality problem of the residuals: rest in scratch 2, misses in `direction`.
            let [step, change, rest, image] = &mut self.scratch;
            let (step, rest) = (&mut step[..wide], &mut rest[..wide]);
            times(self.inverse, &rest[..n], step);
            self.structure.values(&self.shape, step, image);
            for (change, &row) in change.iter_mut().zip(self.factor.rows()) {
                *change = self.direction[row as usize] - image[row as usize];
            }
            if small {
                solve_small(self.tableau, tall, self.factor.rows(), &mut change[..count]);
            } else {
                self.factor.solve(&mut change[..count]);
            }
            for (position, &row) in self.factor.rows().iter().enumerate() {
                self.multipliers[position] += change[position];
                for term in self.structure.normal(&self.shape, row as usize) {
                    rest[term.variable as usize] += term.coefficient * change[position];
                }
            }
            times(self.inverse, &rest[..n], step);
            for (x, step) in self.x.iter_mut().zip(step.iter()).take(n) {
                *x -= step;
            }
        }
        self.structure.values(&self.shape, self.x, self.values);
        let largest = self.multipliers[..count].iter().fold(0.0_f64, |most, by| most.max(by.abs()));
        let signs = self.factor.rows().iter().zip(self.multipliers.iter()).all(|(&row, by)| {
            by * f64::from(self.sides[row as usize]) >= -EXACT * largest
                || self.is_equality(row as usize)
        });
        let settled = left <= 0.05 * self.tolerance && signs && self.most_violated().is_none();
        if settled && self.keeps_bounds() { Ok(()) } else { Err(Doubt) }
    }

    /// True if the other rows keep their bounds by the measure of the residuals: the free minimum,
    /// which the walk measures by, may lie far beyond the solution.
    fn keeps_bounds(&self) -> bool {
        let x = self.x.iter().zip(self.d.iter().zip(self.f.iter())).take(self.shape.n);
        let size = x.fold(0.0_f64, |size, (x, (d, f))| size.max(x.abs() / d).max(d * f.abs()));
        (0..self.shape.m).all(|k| {
            let (lower, upper, value) = (self.lower[k], self.upper[k], self.values[k]);
            let room = |bound: f64| 1e-2 * self.tolerance * (self.reach[k] * size + bound.abs());
            let kept = lower - value <= room(lower) && value - upper <= room(upper);
            kept || self.sides[k] != 0
        })
    }

    /// The largest relative residual; leaves those of the cost in scratch 2, of the working rows
    /// in `direction`.
    fn residual(&mut self) -> f64 {
        let (n, wide) = (self.shape.n, self.shape.wide);
        let [pull, _, rest, _] = &mut self.scratch;
        let (pull, rest) = (&mut pull[..wide], &mut rest[..wide]);
        pull.fill(0.0);
        for (&row, multiplier) in self.factor.rows().iter().zip(self.multipliers.iter()) {
            for term in self.structure.normal(&self.shape, row as usize) {
                pull[term.variable as usize] += term.coefficient * multiplier;
            }
        }
        times(self.hessian, &self.x[..n], rest);
        let (mut terms, mut size, mut worst) = (f64::MIN_POSITIVE, 0.0_f64, 0.0_f64);
        for j in 0..n {
            let (d, f, curved) = (self.d[j], self.f[j], rest[j]);
            terms = terms.max(d * (curved.abs() + f.abs() + pull[j].abs()));
            size = size.max(self.x[j].abs() / d).max(d * f.abs());
            rest[j] = curved - f + pull[j];
            worst = worst.max(d * rest[j].abs());
        }
        worst /= terms;
        self.structure.values(&self.shape, self.x, self.direction);
        for (&row, multiplier) in self.factor.rows().iter().zip(self.multipliers.iter()) {
            let k = row as usize;
            let bound = if self.sides[k] < 0 { self.lower[k] } else { self.upper[k] };
            let miss = self.direction[k] - self.compliance[k] * multiplier - bound;
            self.direction[k] = miss;
            worst = worst.max(miss.abs() / (self.reach[k] * size + bound.abs()));
        }
        worst
    }
}

/// b <- `K_WW`⁻¹ b, from the tableau of a small block.
fn solve_small(tableau: &[f64], tall: usize, working: &[u32], b: &mut [f64]) {
    let mut sums = [0.0; MAX_ROWS];
    for (row, b) in tableau.chunks_exact(tall).zip(b.iter()) {
        for (sum, &k) in sums.iter_mut().zip(working) {
            *sum += row[k as usize] * b;
        }
    }
    for (b, sum) in b.iter_mut().zip(&sums) {
        *b = *sum;
    }
}
