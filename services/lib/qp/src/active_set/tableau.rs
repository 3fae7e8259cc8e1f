//! The walk of a small block, on the rows of a principal-pivot tableau.
//!
//! With K = P + C, P the Gram matrix and C the compliance, the tableau holds for every working row
//! j the numbers (`K_WW`⁻¹)ⱼᵢ for working rows i and (`K_WW`⁻¹ `K_W:`)ⱼᵢ for the others. One sum over
//! the working rows then gives multipliers and values, row p brings `K_p:` less its shares, and a
//! row comes or goes with one operation on each of the others: no triangular solve, no order.
//! A tableau depends on the way to it, so the result is taken from one built anew from P, the rows
//! in their order; it serves the next solve if that starts from the same set.

use super::blocks::Block;
use super::structure::Shape;
use super::walk::{Doubt, NOISE, SATISFIED};

/// The largest block: rows, units included, and lanes.
pub(super) const MOST_ROWS: usize = 16;

/// A solve of one small block with `M` lanes.
struct Small<'b, 'a, const M: usize> {
    block: &'b mut Block<'a>,
    lower: [f64; M],
    upper: [f64; M],
    /// The bounds widened by what counts as satisfied.
    low: [f64; M],
    high: [f64; M],
    /// Values of all rows less compliance times multiplier, multipliers of the working ones.
    values: [f64; M],
    multipliers: [f64; M],
    /// `K_p:` less its shares, for the row that was last projected.
    across: [f64; M],
    changes: u32,
    most: u32,
}

/// Walks a block of at most [`MOST_ROWS`] rows, as [`Block::walk`] does.
pub(super) fn walk_small(
    block: &mut Block<'_>,
    lower: &[f64],
    upper: &[f64],
    most: u32,
) -> Result<u32, Doubt> {
    match block.shape.tall {
        4 => Small::<4>::new(block, most).walk(lower, upper),
        8 => Small::<8>::new(block, most).walk(lower, upper),
        12 => Small::<12>::new(block, most).walk(lower, upper),
        _ => Small::<MOST_ROWS>::new(block, most).walk(lower, upper),
    }
}

/// target -= share * source.
fn reduce<const M: usize>(target: &mut [f64; M], share: f64, source: &[f64; M]) {
    for (target, source) in target.iter_mut().zip(source) {
        *target -= share * source;
    }
}

impl<'b, 'a, const M: usize> Small<'b, 'a, M> {
    fn new(block: &'b mut Block<'a>, most: u32) -> Self {
        Self {
            block,
            lower: [f64::NEG_INFINITY; M],
            upper: [f64::INFINITY; M],
            low: [0.0; M],
            high: [0.0; M],
            values: [0.0; M],
            multipliers: [0.0; M],
            across: [0.0; M],
            changes: 0,
            most,
        }
    }

    fn walk(&mut self, lower: &[f64], upper: &[f64]) -> Result<u32, Doubt> {
        self.block.measure();
        self.gather(lower, upper)?;
        if *self.block.factor.clean < *self.block.factor.count {
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
            } else if *self.block.factor.clean == *self.block.factor.count {
                break;
            }
            self.rebuild();
            if self.changes > self.most {
                return Err(Doubt);
            }
        }
        self.hand_over()?;
        Ok(self.changes)
    }

    /// Collects the bounds of the merged rows, and the same widened by the tolerance.
    fn gather(&mut self, lower: &[f64], upper: &[f64]) -> Result<(), Doubt> {
        let mut possible = true;
        for member in self.block.structure.members(&self.block.shape) {
            let (k, row) = (member.merged as usize, member.row as usize);
            let (low, high) = (lower[row], upper[row]);
            // NaN and what no value satisfies fail here.
            possible &= low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY;
            self.lower[k] = if low > self.lower[k] { low } else { self.lower[k] };
            self.upper[k] = if high < self.upper[k] { high } else { self.upper[k] };
        }
        let size = self.block.size();
        for k in 0..M {
            let (low, high) = (self.lower[k], self.upper[k]);
            let reach = self.block.reach[k] * size;
            possible &= low <= high;
            // Infinite bounds stay infinite.
            self.low[k] = low - SATISFIED * (reach + low.abs());
            self.high[k] = high + SATISFIED * (reach + high.abs());
        }
        if possible { Ok(()) } else { Err(Doubt) }
    }

    fn bound(&self, k: usize) -> f64 {
        if self.block.sides[k] < 0 { self.lower[k] } else { self.upper[k] }
    }

    fn is_equality(&self, k: usize) -> bool {
        self.lower[k] >= self.upper[k]
    }

    /// Builds the tableau of the rows that have a side, without those that depend on others.
    fn rebuild(&mut self) {
        *self.block.factor.count = 0;
        for k in 0..self.block.shape.m {
            if self.block.sides[k] != 0 {
                match self.project(k) {
                    Some(pivot) => self.push(k, pivot),
                    None => self.block.sides[k] = 0,
                }
            }
        }
        *self.block.factor.clean = *self.block.factor.count;
    }

    /// Drops working rows whose bound has gone.
    fn release_unbounded(&mut self) {
        for position in (0..*self.block.factor.count).rev() {
            let k = self.block.factor.order[position] as usize;
            if !self.bound(k).is_finite() {
                self.remove(position);
            }
        }
    }

    /// Splits row `p` along the working rows into `across`. Returns the pivot, or `None` if the
    /// row depends on the working ones or there is no room.
    fn project(&mut self, p: usize) -> Option<f64> {
        self.block.need(p);
        let Some(gram) = self.block.gram[p * M..].first_chunk::<M>() else { return None };
        self.across = *gram;
        let mut growth = 1.0;
        let count = *self.block.factor.count;
        let (rows, _) = self.block.tableau.as_chunks::<M>();
        for (row, &k) in rows.iter().zip(self.block.factor.rows()) {
            reduce(&mut self.across, gram[k as usize], row);
            growth += row[p].abs();
        }
        for &k in self.block.factor.rows() {
            // They stay at their bounds.
            self.across[k as usize] = 0.0;
        }
        let softness = self.block.compliance[p];
        let pivot = self.across[p] + softness;
        let own = gram[p] + softness;
        let independent = pivot > NOISE * own * growth * growth;
        (independent && count < self.block.factor.most).then_some(pivot)
    }

    /// Takes in the row last projected.
    fn push(&mut self, p: usize, pivot: f64) {
        let count = *self.block.factor.count;
        let inverse = 1.0 / pivot;
        let mut new = self.across.map(|entry| entry * inverse);
        let (rows, _) = self.block.tableau.as_chunks_mut::<M>();
        let (rows, rest) = rows.split_at_mut(count);
        for (row, &k) in rows.iter().zip(self.block.factor.order.iter()) {
            new[k as usize] = -row[p] * inverse;
        }
        new[p] = inverse;
        for row in rows {
            let share = row[p];
            row[p] = 0.0;
            reduce(row, share, &new);
        }
        rest[0] = new;
        // Fits: a small block has at most 16 rows.
        self.block.factor.order[count] = p as u32;
        *self.block.factor.count = count + 1;
    }

    /// Takes out the working row at `position`.
    fn remove(&mut self, position: usize) {
        let count = *self.block.factor.count;
        let l = self.block.factor.order[position] as usize;
        let (rows, _) = self.block.tableau.as_chunks_mut::<M>();
        let inverse = 1.0 / rows[position][l];
        let mut gone = rows[position].map(|entry| entry * inverse);
        gone[l] = inverse;
        rows.copy_within(position + 1..count, position);
        for row in &mut rows[..count - 1] {
            let share = row[l];
            row[l] = 0.0;
            reduce(row, share, &gone);
        }
        self.block.factor.order.copy_within(position + 1..count, position);
        self.block.sides[l] = 0;
        self.multipliers[l] = 0.0;
        *self.block.factor.count = count - 1;
        // Never equal to the count again until the tableau is rebuilt.
        *self.block.factor.clean = usize::MAX;
    }

    /// Multipliers and values of the working set.
    fn evaluate(&mut self) {
        let mut sum = [0.0; M];
        let (rows, _) = self.block.tableau.as_chunks::<M>();
        for (row, &k) in rows.iter().zip(self.block.factor.rows()) {
            let k = k as usize;
            reduce(&mut sum, self.bound(k) - self.block.free[k], row);
        }
        for ((value, free), sum) in self.values.iter_mut().zip(self.block.free.iter()).zip(&sum) {
            *value = free - sum;
        }
        for position in 0..*self.block.factor.count {
            let k = self.block.factor.order[position] as usize;
            self.values[k] = self.bound(k);
        }
        self.multipliers = sum;
    }

    /// Drops all working rows that push the wrong way; true if there were any.
    fn drop_wrong(&mut self) -> bool {
        let count = *self.block.factor.count;
        let mut largest = 0.0_f64;
        for &k in self.block.factor.rows() {
            largest = largest.max(self.multipliers[k as usize].abs());
        }
        let mut dropped = false;
        for position in (0..count).rev() {
            let k = self.block.factor.order[position] as usize;
            let push = self.multipliers[k] * f64::from(self.block.sides[k]);
            if push < -f64::EPSILON * largest && !self.is_equality(k) {
                self.remove(position);
                self.changes += 1;
                dropped = true;
            }
        }
        dropped
    }

    /// The row outside the working set that misses its bound by most, for its length.
    fn most_violated(&self) -> Option<usize> {
        let mut misses = [0.0; M];
        for k in 0..M {
            let value = self.values[k];
            let (below, above) = (self.low[k] - value, value - self.high[k]);
            misses[k] = if below > above { below } else { above };
        }
        let mut worst = (0.0, None);
        for (k, side) in self.block.sides.iter().enumerate() {
            if misses[k] > 0.0 && *side == 0 && misses[k] > worst.0 * self.block.reach[k] {
                worst = (misses[k] / self.block.reach[k], Some(k));
            }
        }
        worst.1
    }

    /// Brings one violated row in, dropping those that must give way.
    fn enter(&mut self, p: usize) -> Result<(), Doubt> {
        let above = self.values[p] > self.high[p];
        let (side, bound) = if above { (1, self.upper[p]) } else { (-1, self.lower[p]) };
        let sign = f64::from(side);
        let softness = self.block.compliance[p];
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
            let (rows, _) = self.block.tableau.as_chunks::<M>();
            for (row, &k) in rows.iter().zip(self.block.factor.rows()) {
                self.multipliers[k as usize] -= step * row[p];
            }
            let across = self.across;
            reduce(&mut self.values, step, &across);
            multiplier += step;
            match (leaving, pivot) {
                (Some((position, soonest)), _) if soonest < full => self.remove(position),
                (_, Some(pivot)) => {
                    self.multipliers[p] = multiplier;
                    self.block.sides[p] = side;
                    self.push(p, pivot);
                    *self.block.factor.clean = usize::MAX;
                    return Ok(());
                }
                _ => return Err(Doubt),
            }
        }
    }

    /// The working inequality whose multiplier reaches zero first when row `p` pushes; of equals
    /// the one with the larger share.
    fn first_to_leave(&self, p: usize, sign: f64) -> Option<(usize, f64)> {
        let mut first: Option<(usize, f64, f64)> = None;
        let (rows, _) = self.block.tableau.as_chunks::<M>();
        for (position, (row, &k)) in rows.iter().zip(self.block.factor.rows()).enumerate() {
            let k = k as usize;
            let own = f64::from(self.block.sides[k]);
            let yields = own * sign * row[p];
            if yields <= NOISE || self.is_equality(k) {
                continue;
            }
            let step = (own * self.multipliers[k]).max(0.0) / yields;
            let sooner =
                first.is_none_or(|(_, best, by)| step < best || (step <= best && yields > by));
            if sooner {
                first = Some((position, step, yields));
            }
        }
        first.map(|(position, step, _)| (position, step))
    }

    /// Writes bounds, values and multipliers to the block and has it finish.
    fn hand_over(&mut self) -> Result<(), Doubt> {
        let Shape { m, .. } = self.block.shape;
        self.block.lower[..m].copy_from_slice(&self.lower[..m]);
        self.block.upper[..m].copy_from_slice(&self.upper[..m]);
        self.block.values[..m].copy_from_slice(&self.values[..m]);
        for position in 0..*self.block.factor.count {
            let k = self.block.factor.order[position] as usize;
            self.block.multipliers[position] = self.multipliers[k];
        }
        if !self.block.trusted {
            self.block.low[..m].copy_from_slice(&self.low[..m]);
            self.block.high[..m].copy_from_slice(&self.high[..m]);
            self.block.polish()?;
        }
        self.block.finish();
        Ok(())
    }
}
