//! Programs of a few small blocks: every working set has its tableau ready.
//!
//! With W a working set, N the other rows and P the Gram matrix, the tableau of W is the symmetric
//! matrix of (`P_WW`⁻¹) on W, (`P_WW`⁻¹ `P_WN`) between W and N, and what is left of `P_NN` on N. One
//! sum over the working rows gives multipliers and values, row p of it is the way when row p
//! enters, and a change of the set is a change of an index. Tableaux are made when they are first
//! met, from that of the set without its last row: they depend on H and the set, not on the way.

mod cell;
mod correct;
mod tableau;
mod walk;

use super::answer::Answer;
use super::structure::{Shape, Structure};
use super::tableau::Tick;
use super::walk::Doubt;
use cell::Cell;
use tableau::{BLANK, State, Tableau};
use walk::Solve;

/// Lanes of the vectors of variables and of rows of a block.
const WIDE: usize = 4;
const TALL: usize = 8;
/// Rows of the largest block, and tableaux of all blocks together.
const MAX_EXPLICIT_ROWS: usize = 7;
const MAX_SETS: usize = 512;
/// Variables of the largest program.
const MAX_VARIABLES: usize = 16;
/// No such row.
const ABSENT: u32 = u32::MAX;

type Wide = [f64; WIDE];
type Tall = [f64; TALL];

/// The blocks of a program, if all of them are small.
#[derive(Debug, Clone)]
pub(super) struct Explicit {
    cells: Vec<Cell>,
    states: Vec<State>,
    tableaux: Vec<Tableau>,
    tolerance: f64,
}

/// The rows of a mask.
fn members(mut mask: u8) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let next = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (next < TALL).then_some(next)
    })
}

/// M v for a matrix by columns.
fn combine<const LONG: usize>(columns: &[[f64; LONG]], v: &[f64]) -> [f64; LONG] {
    let mut sums = [0.0; LONG];
    for (column, value) in columns.iter().zip(v) {
        for (sum, entry) in sums.iter_mut().zip(column) {
            *sum += entry * value;
        }
    }
    sums
}

impl Explicit {
    pub(super) fn new(n: usize, tolerance: f64) -> Self {
        let (cells, sets) = if n <= MAX_VARIABLES { (n, MAX_SETS) } else { (0, 0) };
        Self {
            cells: Vec::with_capacity(cells),
            states: Vec::with_capacity(sets),
            tableaux: Vec::with_capacity(sets),
            tolerance,
        }
    }

    /// True if the program in force is solved here.
    pub(super) fn serves(&self) -> bool {
        !self.cells.is_empty()
    }

    /// Takes new rows; `refresh` must follow.
    pub(super) fn set_rows(&mut self, structure: &Structure) {
        self.cells.clear();
        self.states.clear();
        let fits = |shape: &Shape| {
            let compliance = &structure.compliance[shape.first_row..][..shape.m];
            let hard = compliance.iter().all(|entry| *entry <= 0.0);
            let mut counts = [0; MAX_EXPLICIT_ROWS];
            for member in structure.members(shape) {
                if let Some(count) = counts.get_mut(member.merged as usize) {
                    *count += 1;
                }
            }
            let paired = counts.iter().all(|count| *count <= 2);
            shape.n <= WIDE && shape.m <= MAX_EXPLICIT_ROWS && paired && hard
        };
        let shapes = &structure.shapes;
        if !shapes.iter().all(fits) || structure.variables.len() > MAX_VARIABLES {
            return;
        }
        if shapes.iter().map(|shape| 1_usize << shape.m).sum::<usize>() > MAX_SETS {
            return;
        }
        let mut at = 0;
        for shape in shapes {
            self.cells.push(Cell::new(structure, shape, at));
            at += 1 << shape.m;
        }
        self.states.resize(at, State::Unmet);
        self.tableaux.resize(at, BLANK);
    }

    /// Takes the Hessian and its inverse of block `index` in padded rows, and √`H_jj` of all
    /// variables of the program.
    pub(super) fn refresh(
        &mut self,
        index: usize,
        matrices: [&[f64]; 2],
        units: &[f64],
        trusted: bool,
    ) {
        let Some(cell) = self.cells.get_mut(index) else { return };
        for (target, source) in [&mut cell.hessian, &mut cell.inverse].into_iter().zip(matrices) {
            for (row, source) in target.iter_mut().zip(source.as_chunks().0) {
                *row = *source;
            }
        }
        let variables = cell.variables.iter().take(cell.n);
        for ((unit, d), &j) in cell.unit.iter_mut().zip(&mut cell.d).zip(variables) {
            *unit = units[j as usize];
            *d = 1.0 / *unit;
        }
        for k in 0..cell.m {
            let (mut sum, mut most) = (0.0, 0.0);
            for (entry, d) in cell.normals[k].iter().zip(&cell.d) {
                let length = entry.abs() * d;
                sum += length;
                most = if length > most { length } else { most };
            }
            (cell.reach[k], cell.weights[k]) = (sum, 1.0 / most);
        }
        cell.trusted = trusted;
        self.states[cell.at..][..1 << cell.m].fill(State::Unmet);
    }

    /// Makes all tableaux now instead of when they are first met.
    pub(super) fn prepare(&mut self) {
        for cell in &self.cells {
            let (states, tableaux) = (&mut self.states[cell.at..], &mut self.tableaux[cell.at..]);
            for set in 0..1_u8 << cell.m {
                if set.count_ones() as usize <= cell.most {
                    cell.meet(set, states, tableaux);
                }
            }
        }
    }

    /// Takes a working set of the whole problem.
    pub(super) fn adopt(&mut self, set: &[i8]) {
        for cell in &mut self.cells {
            let (states, tableaux) = (&mut self.states[cell.at..], &mut self.tableaux[cell.at..]);
            let mut sides = [0.0; TALL];
            for (side, rows) in sides.iter_mut().zip(cell.first.iter().zip(&cell.second)) {
                let held = |row: &u32| set.get(*row as usize).copied().unwrap_or(0);
                *side = f64::from(if held(rows.0) == 0 { held(rows.1) } else { held(rows.0) });
            }
            (cell.set, cell.shown) = (0, 0);
            for (k, side) in sides.iter_mut().enumerate() {
                let next = cell.set | 1 << k;
                if *side != 0.0 && cell.meet(next, states, tableaux) {
                    cell.set = next;
                } else {
                    *side = 0.0;
                }
            }
            cell.sides = sides;
        }
    }

    /// Solves all blocks by at most `most` changes. Returns the changes, the rows in the working
    /// set and f'H⁻¹f.
    pub(super) fn solve(
        &mut self,
        tick: &Tick<'_>,
        most: u32,
        answer: &mut Answer<'_>,
    ) -> Result<(u32, u32, f64), Doubt> {
        let (mut changes, mut active, mut depth) = (0, 0, [0.0; WIDE]);
        for cell in &mut self.cells {
            let f = cell.variables.map(|j| tick.f.get(j as usize).map_or(0.0, |f| -f));
            let x = cell.free_minimum(&f);
            for ((depth, x), f) in depth.iter_mut().zip(&x).zip(&f) {
                *depth += x * f;
            }
            let free = combine(&cell.columns, &x);
            if cell.set | cell.shown == 0 && cell.is_inside(tick, &free) {
                cell.write(&x, answer);
                continue;
            }
            let (lower, upper) = cell.bounds(tick)?;
            let count = 1 << cell.m;
            let mut solve = Solve {
                states: &mut self.states[cell.at..][..count],
                tableaux: &mut self.tableaux[cell.at..][..count],
                cell,
                tolerance: self.tolerance,
                f,
                x,
                free,
                lower,
                upper,
                slack: None,
                mixed: [0.0; TALL],
                changes,
                most,
            };
            solve.walk()?;
            let values = solve.finish()?;
            changes = solve.changes;
            active += solve.cell.set.count_ones();
            let pushes = solve.mixed;
            solve.cell.show(tick, answer, [&lower, &upper], &pushes);
            let x = solve.cell.units.map(|unit| values[unit as usize & (TALL - 1)]);
            solve.cell.write(&x, answer);
        }
        Ok((changes, active, depth.iter().sum()))
    }
}
