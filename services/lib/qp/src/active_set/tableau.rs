//! The walk of a small block, on the rows of a principal-pivot tableau.
//!
//! With K = P + C, P the Gram matrix and C the compliance, the tableau holds for every working row
//! j the numbers (`K_WW`⁻¹)ⱼᵢ for working rows i and (`K_WW`⁻¹ `K_W:`)ⱼᵢ for the others. One sum over
//! the working rows then gives multipliers and values, row p brings `K_p:` less its shares, and a
//! row comes or goes with one operation on each of the others: no triangular solve, no order.
//! A tableau depends on the way to it, so the result is taken from one built anew from P, the rows
//! in their order; it serves the next solve if that starts from the same set.

use super::blocks::Memory;
use super::structure::{Shape, Structure, index};
use super::walk::{Doubt, NOISE, SATISFIED, WEAK};
use crate::work::Work;

/// The largest block: rows, units included, and lanes.
pub(super) const MAX_ROWS: usize = 16;

/// What a solve is about, for the whole problem.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tick<'a> {
    /// What large blocks may still take.
    pub(super) work: &'a Work,
    pub(super) f: &'a [f64],
    pub(super) lower: &'a [f64],
    pub(super) upper: &'a [f64],
    /// The free minimum, the largest entry in its unit.
    pub(super) size: f64,
}

/// A solve of one small block with `M` lanes.
pub(super) struct Small<'a, const M: usize> {
    pub(super) structure: &'a Structure,
    pub(super) shape: &'a Shape,
    pub(super) memory: &'a mut Memory,
    /// H⁻¹ by padded rows.
    pub(super) inverse: &'a [f64],
    /// Columns of P as far as they are known.
    pub(super) gram: &'a mut [[f64; M]],
    pub(super) known: &'a mut [bool],
    pub(super) tableau: &'a mut [[f64; M]],
    pub(super) order: &'a mut [u32],
    pub(super) sides: &'a mut [i8; M],
    pub(super) reach: &'a [f64; M],
    /// What a violation counts.
    pub(super) weights: &'a [f64; M],
    pub(super) compliance: &'a [f64],
    /// Values at the free minimum.
    pub(super) free: [f64; M],
    pub(super) lower: [f64; M],
    pub(super) upper: [f64; M],
    /// The bounds widened by what counts as satisfied.
    pub(super) low: [f64; M],
    pub(super) high: [f64; M],
    /// Values of all rows less compliance times multiplier, multipliers of the working ones.
    pub(super) values: [f64; M],
    pub(super) multipliers: [f64; M],
    /// `K_p:` less its shares, for the row that was last projected.
    pub(super) across: [f64; M],
    pub(super) changes: u32,
    pub(super) most: u32,
}

/// target -= share * source.
fn reduce<const M: usize>(target: &mut [f64; M], share: f64, source: &[f64; M]) {
    for (target, source) in target.iter_mut().zip(source) {
        *target -= share * source;
    }
}

impl<const M: usize> Small<'_, M> {
    /// Walks to the optimal working set, starting from the one in force.
    pub(super) fn walk(&mut self, tick: &Tick<'_>) -> Result<(), Doubt> {
        self.gather(tick)?;
        if self.memory.clean < self.memory.count {
            self.rebuild();
        }
        self.release_unbounded();
        loop {
            self.evaluate();
            if self.drop_wrong() {
                continue;
            }
            if let Some(first) = self.most_violated() {
                let mut row = first;
                loop {
                    self.enter(row)?;
                    match self.most_violated() {
                        Some(next) => row = next,
                        None => break,
                    }
                }
            } else if self.memory.clean == self.memory.count {
                break;
            }
            if self.memory.clean != self.memory.count {
                self.rebuild();
            }
            if self.changes > self.most {
                return Err(Doubt);
            }
        }
        self.finish();
        Ok(())
    }

    /// Collects the bounds of the merged rows, and the same widened by the tolerance.
    fn gather(&mut self, tick: &Tick<'_>) -> Result<(), Doubt> {
        let mut possible = true;
        for member in self.structure.members(self.shape) {
            let (k, row) = (member.merged as usize, member.row as usize);
            let (low, high) = (tick.lower[row], tick.upper[row]);
            // NaN and what no value satisfies fail here.
            possible &= low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY;
            self.lower[k] = if low > self.lower[k] { low } else { self.lower[k] };
            self.upper[k] = if high < self.upper[k] { high } else { self.upper[k] };
        }
        for k in 0..M {
            let (low, high) = (self.lower[k], self.upper[k]);
            let reach = self.reach[k] * tick.size;
            possible &= low <= high;
            // Infinite bounds stay infinite.
            self.low[k] = low - SATISFIED * (reach + low.abs());
            self.high[k] = high + SATISFIED * (reach + high.abs());
        }
        if possible { Ok(()) } else { Err(Doubt) }
    }

    fn bound(&self, k: usize) -> f64 {
        if self.sides[k] < 0 { self.lower[k] } else { self.upper[k] }
    }

    fn is_equality(&self, k: usize) -> bool {
        self.lower[k] >= self.upper[k]
    }

    /// Builds the tableau of the rows that have a side, without those that depend on others.
    fn rebuild(&mut self) {
        self.memory.count = 0;
        for k in 0..self.shape.m {
            if self.sides[k] != 0 {
                match self.project(k) {
                    Some(pivot) => self.push(k, pivot),
                    None => self.sides[k] = 0,
                }
            }
        }
        self.memory.clean = self.memory.count;
    }

    /// Drops working rows whose bound has gone.
    fn release_unbounded(&mut self) {
        for position in (0..self.memory.count).rev() {
            let k = self.order[position] as usize;
            if !self.bound(k).is_finite() {
                self.remove(position);
            }
        }
    }

    /// Splits row `p` along the working rows into `across`. Returns the pivot, or `None` if the
    /// row depends on the working ones or there is no room.
    fn project(&mut self, p: usize) -> Option<f64> {
        self.need(p);
        let gram = &self.gram[p];
        self.across = *gram;
        let mut growth = 1.0;
        let count = self.memory.count;
        let rows = &self.tableau;
        for (row, &k) in rows.iter().zip(self.order.iter().take(self.memory.count)) {
            reduce(&mut self.across, gram[k as usize], row);
            growth += row[p].abs();
        }
        for &k in self.order.iter().take(self.memory.count) {
            // They stay at their bounds.
            self.across[k as usize] = 0.0;
        }
        let softness = self.compliance[p];
        let pivot = self.across[p] + softness;
        let own = gram[p] + softness;
        let independent = pivot > NOISE * own * growth * growth;
        (independent && count < self.shape.most).then_some(pivot)
    }

    /// Takes in the row last projected.
    fn push(&mut self, p: usize, pivot: f64) {
        let count = self.memory.count;
        let inverse = 1.0 / pivot;
        let mut new = self.across.map(|entry| entry * inverse);
        let rows = &mut self.tableau;
        let (rows, rest) = rows.split_at_mut(count);
        for (row, &k) in rows.iter().zip(self.order.iter()) {
            new[k as usize] = -row[p] * inverse;
        }
        new[p] = inverse;
        for row in rows {
            let share = row[p];
            row[p] = 0.0;
            reduce(row, share, &new);
        }
        rest[0] = new;
        self.order[count] = index(p);
        self.memory.count = count + 1;
    }

    /// Takes out the working row at `position`.
    fn remove(&mut self, position: usize) {
        let count = self.memory.count;
        let l = self.order[position] as usize;
        let rows = &mut self.tableau;
        let inverse = 1.0 / rows[position][l];
        let mut gone = rows[position].map(|entry| entry * inverse);
        gone[l] = inverse;
        rows.copy_within(position + 1..count, position);
        for row in &mut rows[..count - 1] {
            let share = row[l];
            row[l] = 0.0;
            reduce(row, share, &gone);
        }
        self.order.copy_within(position + 1..count, position);
        self.sides[l] = 0;
        self.multipliers[l] = 0.0;
        self.memory.count = count - 1;
        // Never equal to the count again until the tableau is rebuilt.
        self.memory.clean = usize::MAX;
    }

    /// Multipliers and values of the working set.
    fn evaluate(&mut self) {
        let mut sum = [0.0; M];
        let rows = &self.tableau;
        for (row, &k) in rows.iter().zip(self.order.iter().take(self.memory.count)) {
            let k = k as usize;
            reduce(&mut sum, self.bound(k) - self.free[k], row);
        }
        for ((value, free), sum) in self.values.iter_mut().zip(self.free.iter()).zip(&sum) {
            *value = free - sum;
        }
        for position in 0..self.memory.count {
            let k = self.order[position] as usize;
            self.values[k] = self.bound(k);
        }
        self.multipliers = sum;
    }

    /// Drops all working rows that push the wrong way; true if there were any.
    fn drop_wrong(&mut self) -> bool {
        let count = self.memory.count;
        let mut largest = 0.0_f64;
        for &k in self.order.iter().take(self.memory.count) {
            let size = self.multipliers[k as usize].abs();
            largest = if size > largest { size } else { largest };
        }
        let mut dropped = false;
        for position in (0..count).rev() {
            let k = self.order[position] as usize;
            let push = self.multipliers[k] * f64::from(self.sides[k]);
            if push < -f64::EPSILON * largest && !self.is_equality(k) {
                self.remove(position);
                self.changes += 1;
                dropped = true;
            }
        }
        dropped
    }

    /// The row outside the working set that misses its bound by most, in its unit.
    fn most_violated(&self) -> Option<usize> {
        let mut misses = [0.0; M];
        let mut any = false;
        for (k, miss) in misses.iter_mut().enumerate() {
            let value = self.values[k];
            let (below, above) = (self.low[k] - value, value - self.high[k]);
            *miss = if below > above { below } else { above };
            // Working rows stay at their bounds, within the tolerance.
            any |= *miss > 0.0;
        }
        if !any {
            return None;
        }
        // Selections instead of branches: which row it is cannot be foreseen.
        let (mut worst, mut found) = (0.0, M);
        for (k, miss) in misses.iter().enumerate() {
            let relative = miss * self.weights[k];
            found = if relative > worst { k } else { found };
            worst = if relative > worst { relative } else { worst };
        }
        (found < M).then_some(found)
    }

    /// Brings one violated row in, dropping those that must give way.
    fn enter(&mut self, p: usize) -> Result<(), Doubt> {
        let above = self.values[p] > self.high[p];
        let (side, bound) = if above { (1, self.upper[p]) } else { (-1, self.lower[p]) };
        let sign = f64::from(side);
        let softness = self.compliance[p];
        let mut multiplier = 0.0;
        loop {
            self.changes += 1;
            if self.changes > self.most {
                return Err(Doubt);
            }
            let pivot = self.project(p);
            let miss = sign * (self.values[p] - softness * multiplier - bound);
            let full = pivot.map_or(f64::INFINITY, |pivot| (miss / pivot).max(0.0));
            let leaving = self.first_to_leave(p, sign);
            let step = sign * leaving.map_or(full, |(_, step)| step.min(full));
            if !step.is_finite() {
                return Err(Doubt);
            }
            let rows = &self.tableau;
            for (row, &k) in rows.iter().zip(self.order.iter().take(self.memory.count)) {
                self.multipliers[k as usize] -= step * row[p];
            }
            let across = self.across;
            reduce(&mut self.values, step, &across);
            multiplier += step;
            match (leaving, pivot) {
                (Some((position, soonest)), _) if soonest < full => self.remove(position),
                (_, Some(pivot)) => {
                    self.multipliers[p] = multiplier;
                    self.sides[p] = side;
                    // Behind the others of a tableau built anew it is where it would be built.
                    let before = &self.order[..self.memory.count];
                    let last = before.last().is_none_or(|&last| (last as usize) < p);
                    let anew = self.memory.clean == self.memory.count && last;
                    self.push(p, pivot);
                    self.memory.clean = if anew { self.memory.count } else { usize::MAX };
                    return Ok(());
                }
                _ => return Err(Doubt),
            }
        }
    }

    /// The working inequality whose multiplier reaches zero first when row `p` pushes; of equals
    /// the one with the larger share.
    fn first_to_leave(&self, p: usize, sign: f64) -> Option<(usize, f64)> {
        let (mut soonest, mut best, mut found) = (f64::INFINITY, 0.0, usize::MAX);
        let working = self.tableau.iter().zip(self.order.iter()).take(self.memory.count);
        for (position, (row, &k)) in working.enumerate() {
            let k = k as usize;
            let own = f64::from(self.sides[k]);
            let yields = own * sign * row[p];
            let push = own * self.multipliers[k];
            let step = if push > 0.0 { push / yields } else { 0.0 };
            let sooner = step < soonest || (step <= soonest && yields > best);
            let leaves = yields > NOISE && sooner && !self.is_equality(k);
            soonest = if leaves { step } else { soonest };
            best = if leaves { yields } else { best };
            found = if leaves { position } else { found };
        }
        (found < usize::MAX).then_some((found, soonest))
    }

    /// True if a working row almost depends on the others.
    pub(super) fn is_weak(&self) -> bool {
        let working = self.tableau.iter().zip(self.order.iter()).take(self.memory.count);
        working.fold(false, |weak, (row, &k)| {
            let k = k as usize;
            weak || WEAK * row[k] * (self.gram[k][k] + self.compliance[k]) > 1.0
        })
    }

    /// Makes sure that column `p` of the Gram matrix is there.
    fn need(&mut self, p: usize) {
        if self.known[p] {
            return;
        }
        self.known[p] = true;
        let mut image = [0.0; M];
        let image = &mut image[..self.shape.wide.min(M)];
        for term in self.structure.normal(self.shape, p) {
            let source = self.inverse[term.variable as usize * self.shape.wide..].iter();
            for (entry, source) in image.iter_mut().zip(source) {
                *entry += term.coefficient * source;
            }
        }
        self.gram[p] = [0.0; M];
        self.structure.values(self.shape, image, &mut self.gram[p]);
    }

    /// Brings values and multipliers of the working rows to what they are without rounding.
    fn finish(&mut self) {
        for position in 0..self.memory.count {
            let k = self.order[position] as usize;
            let multiplier = self.multipliers[k];
            if self.is_equality(k) {
                self.sides[k] = if multiplier < 0.0 { -1 } else { 1 };
            }
            let wrong = multiplier * f64::from(self.sides[k]) < 0.0;
            self.multipliers[k] = if wrong { 0.0 } else { multiplier };
            self.values[k] = self.bound(k) + self.compliance[k] * self.multipliers[k];
        }
    }
}
