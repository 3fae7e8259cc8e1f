//! The walk of one block from tableau to tableau.

use super::super::walk::{Doubt, NOISE, SATISFIED};
use super::cell::Cell;
use super::tableau::{State, Tableau};
use super::{TALL, Tall, Wide, members};

/// One block in one solve.
pub(super) struct Solve<'a> {
    pub(super) cell: &'a mut Cell,
    pub(super) states: &'a mut [State],
    pub(super) tableaux: &'a mut [Tableau],
    pub(super) tolerance: f64,
    /// -f, the free minimum, and the values of the rows there.
    pub(super) f: Wide,
    pub(super) x: Wide,
    pub(super) free: Tall,
    pub(super) lower: Tall,
    pub(super) upper: Tall,
    /// What a row may miss its bounds by, from when it is first needed.
    pub(super) slack: Option<[Tall; 2]>,
    /// Multipliers of working rows, values of the others.
    pub(super) mixed: Tall,
    pub(super) changes: u32,
    pub(super) most: u32,
}

impl Solve<'_> {
    /// Walks to the optimal working set, starting from the one in force.
    pub(super) fn walk(&mut self) -> Result<(), Doubt> {
        for k in members(self.cell.set) {
            if !self.bound(k).is_finite() {
                self.drop_row(k);
            }
        }
        loop {
            if !self.cell.meet(self.cell.set, self.states, self.tableaux) {
                return Err(Doubt);
            }
            self.evaluate();
            if self.drop_wrong() {
                continue;
            }
            let Some(first) = self.most_violated() else { return Ok(()) };
            let mut row = first;
            loop {
                self.enter(row)?;
                match self.most_violated() {
                    Some(next) => row = next,
                    None => break,
                }
            }
        }
    }

    pub(super) fn bound(&self, k: usize) -> f64 {
        if self.cell.sides[k] < 0.0 { self.lower[k] } else { self.upper[k] }
    }

    pub(super) fn is_equality(&self, k: usize) -> bool {
        self.lower[k] >= self.upper[k]
    }

    pub(super) fn drop_row(&mut self, k: usize) {
        self.cell.set &= !(1 << k);
        self.cell.sides[k] = 0.0;
    }

    /// Multipliers and values of the working set.
    pub(super) fn evaluate(&mut self) {
        let rows = &self.tableaux[usize::from(self.cell.set) & (self.tableaux.len() - 1)].rows;
        let mut sums = [0.0; TALL];
        for k in members(self.cell.set) {
            let miss = self.free[k] - self.bound(k);
            for (sum, entry) in sums.iter_mut().zip(&rows[k]) {
                *sum += miss * entry;
            }
        }
        let rows = self.mixed.iter_mut().zip(&self.free).zip(&sums).zip(&self.cell.sides);
        for (((mixed, free), sum), side) in rows {
            *mixed = if *side == 0.0 { free - sum } else { *sum };
        }
    }

    /// Drops all working rows that push the wrong way; true if there were any.
    pub(super) fn drop_wrong(&mut self) -> bool {
        let mut pushes = [0.0; TALL];
        let mut any = false;
        for (push, (by, side)) in pushes.iter_mut().zip(self.mixed.iter().zip(&self.cell.sides)) {
            *push = by * side;
            any |= *push < 0.0;
        }
        if !any {
            return false;
        }
        let largest = pushes.iter().fold(0.0_f64, |most, push| most.max(push.abs()));
        let before = self.changes;
        for k in members(self.cell.set) {
            if pushes[k] < -f64::EPSILON * largest && !self.is_equality(k) {
                self.drop_row(k);
                self.changes += 1;
            }
        }
        self.changes > before
    }

    /// By what a row may miss its lower bound and its upper one, larger than that of the bound.
    pub(super) fn slack(&mut self) -> &[Tall; 2] {
        let (x, unit) = (&self.x, &self.cell.unit);
        let (reach, lower, upper) = (&self.cell.reach, &self.lower, &self.upper);
        self.slack.get_or_insert_with(|| {
            let size = x.iter().zip(unit).fold(0.0_f64, |most, (x, unit)| most.max(x.abs() * unit));
            let mut slack = [[0.0; TALL]; 2];
            for k in 0..TALL {
                slack[0][k] = SATISFIED * (reach[k] * size + lower[k].abs());
                slack[1][k] = SATISFIED * (reach[k] * size + upper[k].abs());
            }
            slack
        })
    }

    /// The row outside the working set that misses its bound by most, in its unit.
    pub(super) fn most_violated(&mut self) -> Option<usize> {
        let mut any = false;
        for k in 0..TALL {
            let value = self.mixed[k];
            let (below, above) = (value < self.lower[k], value > self.upper[k]);
            let (outside, idle) = (below | above, self.cell.sides[k] == 0.0);
            any |= outside & idle;
        }
        if !any {
            return None;
        }
        let [below, above] = *self.slack();
        // Selections instead of branches: which row it is cannot be foreseen.
        let (mut worst, mut found) = (0.0, TALL);
        for k in 0..TALL {
            let value = self.mixed[k];
            let (under, over) =
                (self.lower[k] - below[k] - value, value - (self.upper[k] + above[k]));
            let miss = if under > over { under } else { over };
            let miss = if self.cell.sides[k] == 0.0 { miss * self.cell.weights[k] } else { 0.0 };
            found = if miss > worst { k } else { found };
            worst = if miss > worst { miss } else { worst };
        }
        (found < TALL).then_some(found)
    }

    /// Brings one violated row in, dropping those that must give way.
    pub(super) fn enter(&mut self, p: usize) -> Result<(), Doubt> {
        let above = self.mixed[p] > self.upper[p];
        let (sign, bound) = if above { (1.0, self.upper[p]) } else { (-1.0, self.lower[p]) };
        let mut multiplier = 0.0;
        loop {
            self.changes += 1;
            if self.changes > self.most {
                return Err(Doubt);
            }
            if !self.cell.meet(self.cell.set, self.states, self.tableaux) {
                return Err(Doubt);
            }
            let tableau = &self.tableaux[usize::from(self.cell.set)];
            let row = tableau.rows[p];
            let independent = tableau.open >> p & 1 == 1;
            let miss = sign * (self.mixed[p] - bound);
            let full = if independent { (miss / row[p]).max(0.0) } else { f64::INFINITY };
            let leaving = self.first_to_leave(&row, sign);
            let step = sign * leaving.map_or(full, |(_, step)| step.min(full));
            if !step.is_finite() {
                return Err(Doubt);
            }
            for (mixed, entry) in self.mixed.iter_mut().zip(&row) {
                *mixed -= step * entry;
            }
            multiplier += step;
            match leaving {
                Some((k, soonest)) if soonest < full => {
                    self.mixed[k] = self.bound(k);
                    self.drop_row(k);
                }
                _ => {
                    self.mixed[p] = multiplier;
                    self.cell.sides[p] = sign;
                    self.cell.set |= 1 << p;
                    return Ok(());
                }
            }
        }
    }

    /// The working inequality whose multiplier reaches zero first when a row pushes; of equals
    /// the one with the larger share.
    pub(super) fn first_to_leave(&self, row: &Tall, sign: f64) -> Option<(usize, f64)> {
        let (mut soonest, mut best, mut found) = (f64::INFINITY, 0.0, TALL);
        for k in members(self.cell.set) {
            let own = self.cell.sides[k];
            let (yields, push) = (own * sign * row[k], own * self.mixed[k]);
            let step = if push > 0.0 { push / yields } else { 0.0 };
            let sooner = step < soonest || (step <= soonest && yields > best);
            let leaves = yields > NOISE && sooner && !self.is_equality(k);
            soonest = if leaves { step } else { soonest };
            best = if leaves { yields } else { best };
            found = if leaves { k } else { found };
        }
        (found < TALL).then_some((found, soonest))
    }
}
