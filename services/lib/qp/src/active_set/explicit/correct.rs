//! From the end of a walk to what it is without rounding.

use super::super::polish::{EXACT, MAX_CORRECTIONS};
use super::super::walk::Doubt;
use super::cell::Cell;
use super::tableau::State;
use super::walk::Solve;
use super::{TALL, Tall, WIDE, Wide, combine, members};

/// What an answer leaves: of the cost's gradient, of the working rows, and the largest of these
/// relative to the numbers they come from.
struct Residuals {
    rest: Wide,
    misses: Tall,
    worst: f64,
    /// The largest number that variables come from, each in its unit.
    size: f64,
}

impl Cell {
    fn residuals(&self, f: &Wide, x: &Wide, pushes: &Tall, bounds: &Tall) -> Residuals {
        let pull = combine(&self.normals, pushes);
        let curved = combine(&self.hessian, x);
        let values = combine(&self.columns, x);
        let (mut terms, mut size, mut worst) = (f64::MIN_POSITIVE, 0.0_f64, 0.0_f64);
        let mut rest = [0.0; WIDE];
        for j in 0..WIDE {
            let (d, f) = (self.d[j], f[j]);
            terms = terms.max(d * (curved[j].abs() + f.abs() + pull[j].abs()));
            size = size.max(x[j].abs() * self.unit[j]).max(d * f.abs());
            rest[j] = curved[j] - f + pull[j];
            worst = worst.max(d * rest[j].abs());
        }
        worst /= terms;
        let mut misses = [0.0; TALL];
        for k in members(self.set) {
            misses[k] = values[k] - bounds[k];
            worst = worst.max(misses[k].abs() / (self.reach[k] * size + bounds[k].abs()));
        }
        Residuals { rest, misses, worst, size }
    }
}

impl Solve<'_> {
    /// Brings the walk's end to what it is without rounding; returns the values of all rows.
    pub(super) fn finish(&mut self) -> Result<Tall, Doubt> {
        let set = usize::from(self.cell.set) & (self.states.len() - 1);
        let mut values = self.mixed;
        if !self.cell.trusted {
            self.correct(&mut values)?;
        } else if self.states[set] == State::Weak {
            return Err(Doubt);
        }
        for k in members(self.cell.set) {
            let multiplier = self.mixed[k];
            if self.is_equality(k) {
                self.cell.sides[k] = if multiplier < 0.0 { -1.0 } else { 1.0 };
            }
            let wrong = multiplier * self.cell.sides[k] < 0.0;
            self.mixed[k] = if wrong { 0.0 } else { multiplier };
            values[k] = self.bound(k);
        }
        Ok(values)
    }

    /// Measures the residuals of the walk's end and corrects them.
    pub(super) fn correct(&mut self, values: &mut Tall) -> Result<(), Doubt> {
        let mut held = [false; TALL];
        let (mut pushes, mut bounds, mut x) = ([0.0; TALL], [0.0; TALL], [0.0; WIDE]);
        for k in members(self.cell.set) {
            held[k] = true;
            bounds[k] = self.bound(k);
            (pushes[k], values[k]) = (self.mixed[k], bounds[k]);
        }
        for (x, &unit) in x.iter_mut().zip(&self.cell.units).take(self.cell.n) {
            *x = values[unit as usize & (TALL - 1)];
        }
        let tableau = &self.tableaux[usize::from(self.cell.set)].rows;
        let cell = &*self.cell;
        let (mut left, mut reached) = (f64::INFINITY, 0.0);
        for _ in 0..MAX_CORRECTIONS {
            let Residuals { mut rest, misses, worst, size } =
                cell.residuals(&self.f, &x, &pushes, &bounds);
            (left, reached) = (worst, size);
            if left <= EXACT.min(1e-2 * self.tolerance) || left.is_nan() {
                break;
            }
            // The equality problem of the residuals.
            let image = combine(&cell.columns, &combine(&cell.inverse, &rest));
            let mut change = [0.0; TALL];
            for k in members(cell.set) {
                let share = misses[k] - image[k];
                for (change, entry) in change.iter_mut().zip(&tableau[k]) {
                    *change += share * entry;
                }
            }
            for k in 0..TALL {
                change[k] = if held[k] { change[k] } else { 0.0 };
                pushes[k] += change[k];
            }
            let pull = combine(&cell.normals, &change);
            for (rest, pull) in rest.iter_mut().zip(&pull) {
                *rest += pull;
            }
            let step = combine(&cell.inverse, &rest);
            for (x, step) in x.iter_mut().zip(&step) {
                *x -= step;
            }
        }
        *values = combine(&cell.columns, &x);
        let largest = pushes.iter().fold(0.0_f64, |most, by| most.max(by.abs()));
        let signs = members(self.cell.set)
            .all(|k| pushes[k] * self.cell.sides[k] >= -EXACT * largest || self.is_equality(k));
        for k in 0..TALL {
            self.mixed[k] = if held[k] { pushes[k] } else { values[k] };
        }
        // The free minimum, which the walk measures by, may lie far beyond the solution.
        let part = 1e-2 * self.tolerance;
        let kept = (0..TALL).all(|k| {
            let (low, high, reach) = (self.lower[k], self.upper[k], self.cell.reach[k] * reached);
            let under = low - values[k] <= part * (reach + low.abs());
            held[k] || (under && values[k] - high <= part * (reach + high.abs()))
        });
        let settled =
            left <= 0.05 * self.tolerance && signs && kept && self.most_violated().is_none();
        if settled { Ok(()) } else { Err(Doubt) }
    }
}
