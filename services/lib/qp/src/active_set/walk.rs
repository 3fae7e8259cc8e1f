//! The walk of one block from working set to working set, in the space of its rows.
//!
//! With P = M H⁻¹ M', M the rows and r⁰ their values at the free minimum, working rows W at bounds
//! b have multipliers λ from (`P_WW` + C) λ = `r⁰_W` - b, C their compliance, and all values are
//! r = r⁰ - `P_:W` λ. A violated row p enters with a growing multiplier, the working ones give way
//! (Goldfarb and Idnani, 1983): the dual cost grows with every full step, so no working set
//! returns. Whatever rounding could make doubtful is left to the slower, safer method.

use super::block::Block;
use super::tableau::Tick;
use crate::linear::axpy;
use crate::work::Work;

/// Violation, relative to bound and size of the problem, up to which a row counts as satisfied.
pub(super) const SATISFIED: f64 = 2e-13;
/// Rounding of a pivot, relative to the numbers it was computed from.
pub(super) const NOISE: f64 = 64.0 * f64::EPSILON;
/// Pivots of this share of their row leave too few digits where residuals are not measured.
pub(super) const WEAK: f64 = 1e-5;

/// The safer method must decide.
#[derive(Debug)]
pub(super) struct Doubt;

impl Block<'_> {
    /// Walks to the optimal working set, starting from the one in force; at most `most` changes.
    /// Returns their number.
    pub(super) fn walk(&mut self, tick: &Tick<'_>, most: u32) -> Result<u32, Doubt> {
        self.measure();
        self.gather(tick)?;
        self.rebuild(tick.work);
        let mut changes = 0;
        'walk: loop {
            self.evaluate();
            tick.work.spend(*self.factor.count * (*self.factor.count + self.shape.tall));
            let dropped = self.drop_wrong();
            changes += dropped;
            if dropped > 0 {
                continue;
            }
            let Some(mut row) = self.most_violated() else { break };
            loop {
                if tick.work.runs_out() {
                    break 'walk;
                }
                self.enter(row, &mut changes, most, tick.work)?;
                match self.most_violated() {
                    Some(next) => row = next,
                    None => break,
                }
            }
        }
        if tick.work.was_cut() {
            // The iterate serves as it is.
        } else if !self.trusted {
            self.polish()?;
        } else if self.is_weak() {
            return Err(Doubt);
        }
        self.finish();
        Ok(changes)
    }

    /// Collects the bounds of the merged rows, and the same widened by the tolerance.
    fn gather(&mut self, tick: &Tick<'_>) -> Result<(), Doubt> {
        self.lower.fill(f64::NEG_INFINITY);
        self.upper.fill(f64::INFINITY);
        for member in self.structure.members(&self.shape) {
            let (k, row) = (member.merged as usize, member.row as usize);
            let (low, high) = (tick.lower[row], tick.upper[row]);
            // NaN and what no value satisfies fail here.
            let possible = low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY;
            if !possible {
                return Err(Doubt);
            }
            self.lower[k] = low.max(self.lower[k]);
            self.upper[k] = high.min(self.upper[k]);
        }
        let size = tick.size;
        let bounds = self.lower.iter().zip(self.upper.iter());
        let widened = self.low.iter_mut().zip(self.high.iter_mut()).zip(self.reach.iter());
        for (((low, high), reach), (lower, upper)) in widened.zip(bounds) {
            *low = lower - SATISFIED * (reach * size + lower.abs());
            *high = upper + SATISFIED * (reach * size + upper.abs());
        }
        if self.lower.iter().zip(self.upper.iter()).all(|(low, high)| low <= high) {
            Ok(())
        } else {
            Err(Doubt)
        }
    }

    /// The bound that a working row is held at.
    fn bound(&self, row: usize) -> f64 {
        if self.sides[row] < 0 { self.lower[row] } else { self.upper[row] }
    }

    pub(super) fn is_equality(&self, row: usize) -> bool {
        self.lower[row] >= self.upper[row]
    }

    /// Brings the factor to the order of the rows, without rows that cannot stay.
    fn rebuild(&mut self, work: &Work) {
        let (first, last) = self.factor.settle();
        let mut unusable = 0;
        work.spend((0..first).map(|count| self.price(count)).sum());
        for position in first..last {
            let row = self.factor.order[position];
            let k = row as usize;
            work.spend(self.price(*self.factor.count));
            let pivot = if work.runs_out() { None } else { self.project(k) };
            let stays = *self.factor.count < self.factor.most && pivot.is_some();
            match pivot {
                Some(pivot) if stays => {
                    let count = *self.factor.count;
                    self.factor.push(row, pivot, &self.scratch[0][..count]);
                }
                _ => self.sides[k] = 0,
            }
        }
        // The clean part may hold rows whose bound has gone.
        for position in (0..*self.factor.count).rev() {
            let k = self.factor.order[position] as usize;
            if !self.bound(k).is_finite() {
                self.remove(position);
                unusable += 1;
            }
        }
        if unusable > 0 {
            self.rebuild(work);
        }
    }

    /// Multiply-adds of a row's projection on `count` working rows, its column of the Gram matrix
    /// included.
    fn price(&self, count: usize) -> usize {
        // Rows share most of their entries with their neighbours.
        count * count + self.shape.n * (self.shape.n + self.shape.tall) / 4
    }

    /// Splits row `k` along the working rows: scratch 0 is for the factor, scratch 1 the shares.
    /// Returns the pivot, or `None` if the row depends on the working ones.
    fn project(&mut self, k: usize) -> Option<f64> {
        self.need(k);
        let count = *self.factor.count;
        let gram = &self.gram[k * self.shape.tall..][..self.shape.tall];
        let own = gram[k] + self.compliance[k];
        let [y, ratio, ..] = &mut self.scratch;
        for (y, &row) in y.iter_mut().zip(self.factor.rows()) {
            *y = gram[row as usize];
        }
        let pivot = self.factor.project(own, &mut y[..count], &mut ratio[..count]);
        let growth = 1.0 + ratio[..count].iter().map(|r| r.abs()).sum::<f64>();
        (pivot > NOISE * own * growth * growth).then_some(pivot)
    }

    /// Multipliers and values of the working set, from the factor.
    fn evaluate(&mut self) {
        let count = *self.factor.count;
        for (position, &row) in self.factor.rows().iter().enumerate() {
            let k = row as usize;
            let bound = if self.sides[k] < 0 { self.lower[k] } else { self.upper[k] };
            self.multipliers[position] = self.free[k] - bound;
        }
        self.factor.solve(&mut self.multipliers[..count]);
        self.values.copy_from_slice(self.free);
        let tall = self.shape.tall;
        for (&row, multiplier) in self.factor.rows().iter().zip(self.multipliers.iter()) {
            axpy(-multiplier, &self.gram[(row as usize) * tall..][..tall], self.values);
        }
    }

    /// Drops all working rows that push the wrong way.
    fn drop_wrong(&mut self) -> u32 {
        let count = *self.factor.count;
        let multipliers = &self.multipliers[..count];
        let largest = multipliers.iter().fold(0.0_f64, |largest, by| largest.max(by.abs()));
        let mut dropped = 0;
        for position in (0..count).rev() {
            let row = self.factor.order[position] as usize;
            let push = self.multipliers[position] * f64::from(self.sides[row]);
            if push < -f64::EPSILON * largest && !self.is_equality(row) {
                self.remove(position);
                dropped += 1;
            }
        }
        dropped
    }

    fn remove(&mut self, position: usize) {
        let row = self.factor.order[position] as usize;
        self.sides[row] = 0;
        let count = *self.factor.count;
        self.multipliers.copy_within(position + 1..count, position);
        let [w, beta, ..] = &mut self.scratch;
        self.factor.remove(position, w, beta);
    }

    /// The row outside the working set that misses its bound by most, in its unit.
    pub(super) fn most_violated(&self) -> Option<usize> {
        let (mut worst, mut found) = (0.0, None);
        let bounds = self.low.iter().zip(self.high.iter());
        let rows = self.values.iter().zip(self.weights.iter()).zip(bounds).zip(self.sides.iter());
        for (k, (((value, weight), (low, high)), side)) in rows.enumerate() {
            let (below, above) = (low - value, value - high);
            let miss = weight * if below > above { below } else { above };
            if miss > worst && *side == 0 {
                (worst, found) = (miss, Some(k));
            }
        }
        found
    }

    /// Brings one violated row in, dropping those that must give way.
    fn enter(
        &mut self,
        row: usize,
        changes: &mut u32,
        most: u32,
        work: &Work,
    ) -> Result<(), Doubt> {
        let above = self.values[row] > self.high[row];
        let (side, bound) = if above { (1, self.upper[row]) } else { (-1, self.lower[row]) };
        let sign = f64::from(side);
        let mut multiplier = 0.0;
        loop {
            *changes += 1;
            if *changes > most {
                return Err(Doubt);
            }
            let pivot = self.project(row);
            let count = *self.factor.count;
            work.spend(self.price(count) + (count + 2) * self.shape.tall);
            let value = self.values[row] - self.compliance[row] * multiplier;
            let full = match pivot {
                Some(pivot) if count < self.factor.most => {
                    (sign * (value - bound) / pivot).max(0.0)
                }
                _ => f64::INFINITY,
            };
            let leaving = self.first_to_leave(sign);
            let step = leaving.map_or(full, |(_, step)| step.min(full));
            if !step.is_finite() {
                return Err(Doubt);
            }
            self.advance(row, sign * step);
            multiplier += sign * step;
            match (leaving, pivot) {
                (Some((position, soonest)), _) if soonest < full => self.remove(position),
                (_, Some(pivot)) => {
                    self.multipliers[count] = multiplier;
                    self.sides[row] = side;
                    let row = u32::try_from(row).map_err(|_| Doubt)?;
                    self.factor.push(row, pivot, &self.scratch[0][..count]);
                    return Ok(());
                }
                _ => return Err(Doubt),
            }
        }
    }

    /// The working inequality whose multiplier reaches zero first; of equals the one with the
    /// larger share, which leaves the better-conditioned factor.
    fn first_to_leave(&self, sign: f64) -> Option<(usize, f64)> {
        let mut first: Option<(usize, f64, f64)> = None;
        for (position, &row) in self.factor.rows().iter().enumerate() {
            let row = row as usize;
            let own = f64::from(self.sides[row]);
            let yields = own * sign * self.scratch[1][position];
            if yields <= NOISE || self.is_equality(row) {
                continue;
            }
            let step = (own * self.multipliers[position]).max(0.0) / yields;
            let sooner =
                first.is_none_or(|(_, best, by)| step < best || (step <= best && yields > by));
            if sooner {
                first = Some((position, step, yields));
            }
        }
        first.map(|(position, step, _)| (position, step))
    }

    /// Moves values and multipliers for `step` more of the entering row's multiplier.
    fn advance(&mut self, row: usize, step: f64) {
        let count = *self.factor.count;
        let tall = self.shape.tall;
        axpy(-step, &self.gram[row * tall..][..tall], self.values);
        for position in 0..count {
            let share = step * self.scratch[1][position];
            self.multipliers[position] -= share;
            let other = self.factor.order[position] as usize;
            axpy(share, &self.gram[other * tall..][..tall], self.values);
        }
    }

    /// True if a working row almost depends on those before it.
    fn is_weak(&self) -> bool {
        let pivots = self.factor.rows().iter().zip(self.factor.d.iter());
        pivots.fold(false, |weak, (&row, pivot)| {
            let k = row as usize;
            let own = self.gram[k * self.shape.tall + k] + self.compliance[k];
            weak || *pivot < WEAK * own
        })
    }

    /// Writes the solution.
    pub(super) fn finish(&mut self) {
        for (position, &row) in self.factor.rows().iter().enumerate() {
            let k = row as usize;
            let multiplier = self.multipliers[position];
            if self.is_equality(k) {
                self.sides[k] = if multiplier < 0.0 { -1 } else { 1 };
            }
            let bound = if self.sides[k] < 0 { self.lower[k] } else { self.upper[k] };
            let pressed = if self.sides[k] > 0 { multiplier.max(0.0) } else { multiplier.min(0.0) };
            self.multipliers[position] = pressed;
            self.values[k] = bound + self.compliance[k] * pressed;
        }
        for (x, &unit) in self.x.iter_mut().zip(self.structure.units(&self.shape)) {
            *x = self.values[unit as usize];
        }
    }
}
