//! The walk from working set to working set.
//!
//! y always minimises the cost over the working rows; their multipliers have the right sign.
//! A violated row p enters with a growing multiplier u: y moves along the part of nₚ across
//! the working rows (full step: p reaches its bound and joins), the working multipliers give
//! way by `ratio` (partial step: the first to reach zero leaves). The dual cost grows with every
//! full step, so no working set returns; rounding could break that, hence the iteration bound.

use super::Goldfarb;
use crate::linear::{axpy, dot, norm};
use crate::real::Real;
use crate::solver::QpStatus;
use crate::work::Work;

/// Violation, relative to bound, y and g, up to which a row counts as satisfied: some hundred
/// roundings. Pairs go far below, as g may be 1e4 times what residuals are relative to.
const SATISFIED: f64 = 2e-13;
/// The same after long walks, where rounding may feed a cycle.
const SATISFIED_LATE: f64 = 1e-10;
/// A row this close to the span of others, in roundings, counts as dependent.
const MIN_INDEPENDENCE: f64 = 450.0;
/// A row this far from the span, in roundings, counts as independent.
const MAX_NOISE: f64 = 4.5e6;
/// Rows that meet nowhere within this many times the size of the problem contradict each other if
/// rounding of their entries explains that they meet at all.
const FAR: f64 = 1e4;
/// What a row that depends on others up to rounding of its entries may miss its bound by.
const TRIFLE: f64 = 1e-12;

/// A row to be added: its index, the side it is violated at, the multiplier it has so far.
struct Entering<T> {
    row: usize,
    side: i8,
    multiplier: T,
}

/// Where the next event of an entering row lies.
enum Event<T> {
    /// The row reaches its bound.
    Joins { rest: T },
    /// The working row at `position` loses its multiplier when u grows by `step`.
    Leaves { position: usize, step: T },
    /// The violation is within the noise of a dependent row.
    Excused,
    /// Nothing gives way: no feasible point.
    Blocked,
}

impl<T: Real> Goldfarb<T> {
    /// Walks to the optimal working set; leaves y, multipliers and set of the last one.
    pub(super) fn walk(&mut self, work: &Work) -> (QpStatus, u32) {
        self.rebuild(work);
        self.excused.fill(false);
        let mut iterations = 0;
        let status = loop {
            iterations += self.settle(work);
            let Some((row, side)) = self.most_violated(iterations) else {
                break QpStatus::Solved;
            };
            if iterations >= self.max_iterations || work.runs_out() {
                break QpStatus::IterationLimit;
            }
            if let Err(status) = self.enter(row, side, &mut iterations, work) {
                break status;
            }
        };
        (status, iterations)
    }

    /// Factors the working set, in the order of the rows, without the rows that cannot stay.
    fn rebuild(&mut self, work: &Work) {
        self.working.clear(self.scaled.dim());
        for row in 0..self.set.len() {
            let side = self.set[row];
            if side == 0 {
                continue;
            }
            let usable =
                self.bound(row, side).round().is_finite() && self.scaled.length[row] > T::ZERO;
            work.spend(4 * self.price());
            let usable = usable && !work.runs_out();
            let rest = if usable { self.working.project(self.scaled.normal(row)) } else { T::ZERO };
            if rest.round() > self.dependence() {
                self.working.push(row, rest);
            } else {
                self.set[row] = 0;
            }
        }
    }

    /// Multiply-adds of a pass over the factor.
    fn price(&self) -> usize {
        T::PRODUCTS * self.scaled.dim() * (self.working.rows().len() + 1)
    }

    /// Multiply-adds of a look at all rows.
    fn look(&self) -> usize {
        T::PRODUCTS * self.scaled.dim() * self.set.len()
    }

    /// Moves y to the minimum over the working rows, without those that push the wrong way.
    /// Returns how many were dropped.
    fn settle(&mut self, work: &Work) -> u32 {
        let mut dropped = 0;
        loop {
            self.relocate(None);
            work.spend(2 * self.price() + self.look());
            let largest = self.working.multipliers[..self.working.rows().len()]
                .iter()
                .fold(0.0_f64, |largest, multiplier| largest.max(multiplier.round().abs()));
            let before = dropped;
            for position in (0..self.working.rows().len()).rev() {
                let row = self.working.rows()[position];
                let push = self.working.multipliers[position].round() * f64::from(self.set[row]);
                if !self.is_equality(row) && push < -T::EPSILON * largest {
                    work.spend(2 * self.price());
                    self.drop(position);
                    dropped += 1;
                }
            }
            if dropped == before {
                return dropped;
            }
        }
    }

    /// Recomputes y and the working multipliers from the factor, with the multiplier of an
    /// entering row held.
    fn relocate(&mut self, entering: Option<&Entering<T>>) {
        let dim = self.scaled.dim();
        let scratch = &mut self.scratch[..dim];
        scratch.copy_from_slice(&self.gradient[..dim]);
        if let Some(p) = entering {
            let push = p.multiplier * T::from(f64::from(p.side));
            axpy(push, self.scaled.normal(p.row), scratch);
        }
        let (set, lower, upper) = (&self.set, &self.lower, &self.upper);
        let target = |row: usize| if set[row] < 0 { lower[row] } else { upper[row] };
        self.working.point(scratch, target, &mut self.y[..dim]);
    }

    /// The row outside the working set that y misses by most.
    fn most_violated(&self, iterations: u32) -> Option<(usize, i8)> {
        // Rounding can only cycle where violations are tiny: late walks overlook more of them.
        let patience = 5 * (self.x.len() + self.set.len()).max(25);
        let late = iterations as usize > patience;
        let digits = (T::EPSILON / f64::EPSILON).sqrt() * (T::EPSILON / f64::EPSILON).sqrt().sqrt();
        let satisfied = digits * if late { SATISFIED_LATE } else { SATISFIED };
        let dim = self.scaled.dim();
        let y = &self.y[..dim];
        let size = (norm(y) + norm(&self.gradient[..dim])).round();
        let mut worst = (0.0, None);
        for row in 0..self.set.len() {
            if self.set[row] != 0 || self.excused[row] {
                continue;
            }
            let value = dot(self.scaled.normal(row), y);
            let (below, above) = (self.miss(row, -1, value), self.miss(row, 1, value));
            let (miss, side) = if above > below { (above, 1) } else { (below, -1) };
            let floor = satisfied * (size + self.bound(row, side).round().abs());
            if miss > worst.0 && miss > floor {
                worst = (miss, Some((row, side)));
            }
        }
        worst.1
    }

    /// Brings one violated row in, dropping the rows that must give way. Ends after as many
    /// changes as there are working rows, plus one; a stop on the way would lose what the dual
    /// cost gained, and a solver cut off in every tick might never arrive.
    fn enter(
        &mut self,
        row: usize,
        side: i8,
        iterations: &mut u32,
        work: &Work,
    ) -> Result<(), QpStatus> {
        let mut p = Entering { row, side, multiplier: T::ZERO };
        loop {
            *iterations += 1;
            work.spend(8 * self.price());
            self.relocate(Some(&p));
            match self.next_event(&p) {
                Event::Joins { rest } => {
                    self.working.push(p.row, rest);
                    self.set[p.row] = p.side;
                    self.excused.fill(false);
                    return Ok(());
                }
                Event::Leaves { position, step } => {
                    p.multiplier += step;
                    self.drop(position);
                }
                Event::Excused => {
                    self.excused[p.row] = true;
                    return Ok(());
                }
                Event::Blocked => return Err(QpStatus::Infeasible),
            }
        }
    }

    fn next_event(&mut self, p: &Entering<T>) -> Event<T> {
        let count = self.working.rows().len();
        let rest = self.working.project(self.scaled.normal(p.row));
        let ratio = &self.working.ratio[..count];
        let growth = norm(ratio).round();
        let bound = self.bound(p.row, p.side);
        let dim = self.scaled.dim();
        let (y, gradient) = (&self.y[..dim], &self.gradient[..dim]);
        let side = T::from(f64::from(p.side));
        let miss = side * (dot(self.scaled.normal(p.row), y) - bound);
        let noise = self.scaled.noise * (2.0 + growth);
        let across = rest.round();
        let independent = across > self.dependence().max(noise.min(MAX_NOISE * T::EPSILON));
        let size = (norm(y) + norm(gradient)).round() + bound.round().abs();
        // Bounds that are given as doubles agree no better than to the rounding of those: a miss that nothing can give way
        // to is excused.
        let given = f64::EPSILON * (2.0 + growth) * (norm(y).round() + bound.round().abs());
        if !independent && miss.round() <= (across + noise) * size {
            return Event::Excused;
        }
        let full = if miss > T::ZERO { miss / rest / rest } else { T::ZERO };
        let (event, step) = match self.first_to_leave(p.side, growth) {
            Some((position, step)) if !independent || step < full => {
                (Event::Leaves { position, step }, step)
            }
            _ if independent => (Event::Joins { rest }, full),
            _ if miss.round() <= 4.0 * given => return Event::Excused,
            _ => {
                // A certificate by a margin that no rounding of the rows could make up for.
                self.doubtful = miss.round() <= FAR * (across + noise) * size;
                return Event::Blocked;
            }
        };
        let entries = self.scaled.noise / T::EPSILON * f64::EPSILON * (2.0 + growth);
        if independent && across <= entries {
            if step.round() * across > FAR * size {
                self.doubtful = true;
                return Event::Blocked;
            }
            // Not half-way: what its multiplier has gained would be lost, and walks could cycle.
            let begun = p.multiplier > T::ZERO;
            if !begun && self.is_trifle(p.row, bound.round(), miss.round()) {
                return Event::Excused;
            }
        }
        event
    }

    /// True if residuals, which are relative to x, do not show that the row misses its bound.
    fn is_trifle(&mut self, row: usize, bound: f64, miss: f64) -> bool {
        let dim = self.scaled.dim();
        let x = &mut self.scratch[..dim];
        x.copy_from_slice(&self.y[..dim]);
        self.scaled.unscale(x);
        let entries = x.iter().zip(&self.scaled.d);
        let size = entries.fold(0.0_f64, |size, (x, d)| size.max((*x / *d).round().abs()));
        let length = self.scaled.length[row].round();
        miss * length <= TRIFLE * (self.scaled.reach[row] * size + bound.abs() * length)
    }

    /// The working inequality whose multiplier reaches zero first as u grows; of equals the one
    /// with the larger ratio, which leaves the better-conditioned factor.
    fn first_to_leave(&self, side: i8, growth: f64) -> Option<(usize, T)> {
        let least = self.scaled.noise * growth.max(1.0);
        let mut first: Option<(usize, T, T)> = None;
        for (position, &row) in self.working.rows().iter().enumerate() {
            let sign = T::from(f64::from(self.set[row]));
            let yields = sign * T::from(f64::from(side)) * self.working.ratio[position];
            if self.is_equality(row) || yields.round() <= least {
                continue;
            }
            let multiplier = sign * self.working.multipliers[position];
            let step = if multiplier > T::ZERO { multiplier / yields } else { T::ZERO };
            let sooner =
                first.is_none_or(|(_, best, by)| step < best || (step <= best && yields > by));
            if sooner {
                first = Some((position, step, yields));
            }
        }
        first.map(|(position, step, _)| (position, step))
    }

    fn drop(&mut self, position: usize) {
        let row = self.working.remove(position);
        self.set[row] = 0;
        // What a row depended on may be gone.
        self.excused.fill(false);
    }

    fn bound(&self, row: usize, side: i8) -> T {
        if side < 0 { self.lower[row] } else { self.upper[row] }
    }

    /// By how much `value` lies beyond a bound; a bound may be infinite.
    fn miss(&self, row: usize, side: i8, value: T) -> f64 {
        let bound = self.bound(row, side);
        if bound.round().is_finite() {
            (if side < 0 { bound - value } else { value - bound }).round()
        } else {
            f64::NEG_INFINITY
        }
    }

    fn is_equality(&self, row: usize) -> bool {
        self.lower[row] >= self.upper[row]
    }

    /// Length of the part across the working rows at which a row counts as dependent on them.
    fn dependence(&self) -> f64 {
        (MIN_INDEPENDENCE * T::EPSILON).max(2.0 * self.scaled.noise)
    }
}
