//! One small block: its numbers, and how it reads and shows the rows of the problem.

use super::super::answer::Answer;
use super::super::structure::{Shape, Structure};
use super::super::tableau::Tick;
use super::super::walk::Doubt;
use super::{ABSENT, TALL, Tall, WIDE, Wide, combine, members};

/// One block.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    pub(super) n: usize,
    pub(super) m: usize,
    pub(super) most: usize,
    pub(super) trusted: bool,
    pub(super) variables: [u32; WIDE],
    /// Per variable the row that is the variable itself.
    pub(super) units: [u32; WIDE],
    /// Per merged row the one or two rows of the problem that it stands for.
    pub(super) first: [u32; TALL],
    pub(super) second: [u32; TALL],
    pub(super) hessian: [Wide; WIDE],
    pub(super) inverse: [Wide; WIDE],
    /// The rows, and the same transposed.
    pub(super) normals: [Wide; TALL],
    pub(super) columns: [Tall; WIDE],
    /// √`H_jj` and its inverse.
    pub(super) unit: Wide,
    pub(super) d: Wide,
    pub(super) reach: Tall,
    pub(super) weights: Tall,
    /// First tableau of the block.
    pub(super) at: usize,
    /// The working set, its sides, and the set that the answer last showed.
    pub(super) set: u8,
    pub(super) sides: Tall,
    pub(super) shown: u8,
}

impl Cell {
    pub(super) fn new(structure: &Structure, shape: &Shape, at: usize) -> Self {
        let mut cell = Self {
            n: shape.n,
            m: shape.m,
            most: shape.most,
            trusted: false,
            variables: [ABSENT; WIDE],
            units: [0; WIDE],
            first: [ABSENT; TALL],
            second: [ABSENT; TALL],
            hessian: [[0.0; WIDE]; WIDE],
            inverse: [[0.0; WIDE]; WIDE],
            normals: [[0.0; WIDE]; TALL],
            columns: [[0.0; TALL]; WIDE],
            unit: [0.0; WIDE],
            d: [0.0; WIDE],
            reach: [1.0; TALL],
            weights: [1.0; TALL],
            at,
            set: 0,
            sides: [0.0; TALL],
            shown: 0,
        };
        for (own, &j) in cell.variables.iter_mut().zip(structure.variables(shape)) {
            *own = j;
        }
        for (own, &unit) in cell.units.iter_mut().zip(structure.units(shape)) {
            *own = unit;
        }
        for member in structure.members(shape) {
            let k = member.merged as usize;
            let place = if cell.first[k] == ABSENT { &mut cell.first } else { &mut cell.second };
            place[k] = member.row;
        }
        for k in 0..shape.m {
            for term in structure.normal(shape, k) {
                cell.normals[k][term.variable as usize] = term.coefficient;
                cell.columns[term.variable as usize][k] = term.coefficient;
            }
        }
        cell
    }

    /// H⁻¹ f.
    pub(super) fn free_minimum(&self, f: &Wide) -> Wide {
        let mut x = combine(&self.inverse, f);
        if !self.trusted {
            let curved = combine(&self.hessian, &x);
            let mut rest = [0.0; WIDE];
            for ((rest, f), curved) in rest.iter_mut().zip(f).zip(&curved) {
                *rest = f - curved;
            }
            let step = combine(&self.inverse, &rest);
            for (x, step) in x.iter_mut().zip(&step) {
                *x += step;
            }
        }
        x
    }

    /// True if all rows are within their bounds, which are numbers then.
    pub(super) fn is_inside(&self, tick: &Tick<'_>, values: &Tall) -> bool {
        let holds = |row: u32, value: f64| {
            let bounds = tick.lower.get(row as usize).zip(tick.upper.get(row as usize));
            bounds.is_none_or(|(low, high)| *low <= value && value <= *high)
        };
        let rows = self.first.iter().zip(&self.second).zip(values).take(self.m);
        rows.into_iter().all(|((first, second), value)| {
            holds(*first, *value) && (*second == ABSENT || holds(*second, *value))
        })
    }

    /// The bounds of the merged rows.
    pub(super) fn bounds(&self, tick: &Tick<'_>) -> Result<(Tall, Tall), Doubt> {
        let low = |row: u32| tick.lower.get(row as usize).copied().unwrap_or(f64::NEG_INFINITY);
        let high = |row: u32| tick.upper.get(row as usize).copied().unwrap_or(f64::INFINITY);
        let mut possible = true;
        let lower = core::array::from_fn(|k| {
            let (first, second) = (low(self.first[k]), low(self.second[k]));
            // NaN and what no value satisfies fail here.
            possible &= first < f64::INFINITY;
            possible &= second < f64::INFINITY;
            if second > first { second } else { first }
        });
        let upper = core::array::from_fn(|k| {
            let (first, second) = (high(self.first[k]), high(self.second[k]));
            possible &= first > f64::NEG_INFINITY;
            possible &= second > f64::NEG_INFINITY;
            if second < first { second } else { first }
        });
        for k in 0..TALL {
            let (lower, upper): (&Tall, &Tall) = (&lower, &upper);
            possible &= lower[k] <= upper[k];
        }
        if possible { Ok((lower, upper)) } else { Err(Doubt) }
    }

    pub(super) fn write(&self, x: &Wide, answer: &mut Answer<'_>) {
        for (x, &j) in x.iter().zip(&self.variables) {
            if let Some(target) = answer.x.get_mut(j as usize) {
                *target = *x;
            }
        }
    }

    /// Writes sides and multipliers of the rows that are held or were.
    pub(super) fn show(
        &mut self,
        tick: &Tick<'_>,
        answer: &mut Answer<'_>,
        [lower, upper]: [&Tall; 2],
        pushes: &Tall,
    ) {
        for k in members(self.shown | self.set) {
            let side = self.sides[k];
            let (bounds, bound) =
                if side < 0.0 { (tick.lower, lower[k]) } else { (tick.upper, upper[k]) };
            // Of rows with one normal the first whose bound it is.
            let mut open = side != 0.0;
            let sign = if side < 0.0 { -1 } else { 1 };
            let mut show = |row: usize| {
                let held = open && bounds[row] <= bound && bound <= bounds[row];
                open &= !held;
                answer.set[row] = if held { sign } else { 0 };
                answer.multipliers[row] = if held { pushes[k] } else { 0.0 };
            };
            show(self.first[k] as usize);
            if self.second[k] != ABSENT {
                show(self.second[k] as usize);
            }
        }
        self.shown = self.set;
    }
}
