//! The memory of all blocks, and what they share.

use nalgebra::DMatrix;

use super::explicit::Explicit;
use super::front::Front;
use super::inverse::{invert, times};
use super::structure::{LANES, Structure, padded};
use super::tableau::MAX_ROWS;
use crate::linear::column;

/// Up to this product of a diagonal entry of H and of its inverse, products with the inverse are
/// accurate enough; above it they are corrected by their residuals.
const TRUSTED: f64 = 1e4;
/// Residuals that they have without correction.
const EASY: f64 = 1e-10;

/// What the walk remembers of a block.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Memory {
    /// Rows in the working set, and how many of them have a factor that a rebuild would give.
    pub(super) count: usize,
    pub(super) clean: usize,
    /// Row lengths are known for the Hessian in force.
    pub(super) measured: bool,
    /// Products with the inverse are accurate without correction.
    pub(super) trusted: bool,
}

/// All blocks: vectors lie one block behind the other, as the shapes describe.
#[derive(Debug, Clone)]
pub(super) struct Blocks {
    pub(super) tolerance: f64,
    pub(super) structure: Structure,
    pub(super) front: Front,
    pub(super) explicit: Explicit,
    /// Every product with the inverse is accurate without correction.
    pub(super) all_trusted: bool,
    pub(super) memory: Vec<Memory>,
    /// H and its inverse by padded rows; the memory of the next inverse and of its making.
    pub(super) hessian: Vec<f64>,
    pub(super) inverse: Vec<f64>,
    pub(super) spare: Vec<f64>,
    pub(super) work: Vec<f64>,
    pub(super) spare_trust: Vec<bool>,
    /// Columns of M H⁻¹ M', as far as they were needed.
    pub(super) gram: Vec<f64>,
    pub(super) known: Vec<bool>,
    /// √`H_jj` of all variables.
    pub(super) units: Vec<f64>,
    /// Per variable 1/√`H_jj`; per row its length in these units.
    pub(super) d: Vec<f64>,
    pub(super) reach: Vec<f64>,
    /// Inverse of each row's largest coefficient in these units: what its violation counts.
    pub(super) weights: Vec<f64>,
    pub(super) f: Vec<f64>,
    pub(super) x: Vec<f64>,
    /// Values of all rows without working rows, and with them.
    pub(super) free: Vec<f64>,
    pub(super) values: Vec<f64>,
    pub(super) lower: Vec<f64>,
    pub(super) upper: Vec<f64>,
    pub(super) tableau: Vec<f64>,
    pub(super) sides: Vec<i8>,
    pub(super) order: Vec<u32>,
    pub(super) multipliers: Vec<f64>,
    pub(super) l: Vec<f64>,
    pub(super) pivots: Vec<f64>,
    pub(super) inverse_pivots: Vec<f64>,
    /// For one block at a time: bounds widened by the tolerance, and scratch.
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
    pub(super) direction: Vec<f64>,
    pub(super) scratch: [Vec<f64>; 4],
}

impl Blocks {
    pub(super) fn new(n: usize, m: usize, tolerance: f64) -> Self {
        let wide = padded(n) + (LANES - 1) * n;
        let tall = padded(m + n) + (LANES - 1) * n;
        let all = m + n;
        Self {
            tolerance,
            structure: Structure::new(n, m),
            front: Front::new(n, m),
            explicit: Explicit::new(n, tolerance),
            all_trusted: false,
            memory: Vec::with_capacity(n),
            hessian: vec![0.0; wide * n],
            inverse: vec![0.0; wide * n],
            spare: vec![0.0; wide * n],
            work: vec![0.0; wide * n],
            spare_trust: Vec::with_capacity(n),
            gram: vec![0.0; tall * all],
            known: vec![false; all],
            units: vec![0.0; n],
            d: vec![0.0; wide],
            reach: vec![0.0; tall],
            weights: vec![0.0; tall],
            f: vec![0.0; wide],
            x: vec![0.0; wide],
            free: vec![0.0; tall],
            values: vec![0.0; tall],
            lower: vec![0.0; tall],
            upper: vec![0.0; tall],
            tableau: vec![0.0; m * MAX_ROWS],
            sides: vec![0; tall],
            order: vec![0; m],
            multipliers: vec![0.0; m],
            l: vec![0.0; m * m],
            pivots: vec![0.0; m],
            inverse_pivots: vec![0.0; m],
            low: vec![0.0; tall],
            high: vec![0.0; tall],
            direction: vec![0.0; tall],
            scratch: core::array::from_fn(|_| vec![0.0; tall]),
        }
    }

    /// Takes new matrices that are known to be valid.
    pub(super) fn set(
        &mut self,
        h: &DMatrix<f64>,
        rows: &DMatrix<f64>,
        compliance: &[f64],
    ) -> Result<(), (usize, f64)> {
        self.structure.analyse(h, rows, compliance);
        self.front.set_rows(&self.structure, rows);
        self.explicit.set_rows(&self.structure);
        self.memory.clear();
        self.memory.resize(self.structure.shapes.len(), Memory::default());
        self.refactor(h)
    }

    /// Takes a new Hessian with the blocks in force; on refusal, with the variable and the ratio
    /// of its pivot, the old one stays.
    pub(super) fn refactor(&mut self, h: &DMatrix<f64>) -> Result<(), (usize, f64)> {
        let least = 4.0 * h.nrows() as f64 * f64::EPSILON;
        self.spare_trust.clear();
        for shape in &self.structure.shapes {
            let variables = self.structure.variables(shape);
            let size = shape.n * shape.wide;
            let target = &mut self.spare[shape.at_inverse..][..size];
            let work = &mut self.work[..size];
            pack(h, variables, shape.wide, work);
            let diagonal = &mut self.scratch[0][..shape.n];
            invert(work, target, shape.n, shape.wide, diagonal, least)
                .map_err(|(local, ratio)| (variables[local] as usize, ratio))?;
            let inflation = target
                .chunks_exact(shape.wide)
                .zip(diagonal.iter())
                .enumerate()
                .map(|(j, (row, entry))| row[j] * entry)
                .fold(0.0, |most, own| if own > most { own } else { most });
            // A promise beyond what the inverse gives needs the residuals.
            self.spare_trust.push(inflation <= TRUSTED && self.tolerance >= EASY);
        }
        core::mem::swap(&mut self.inverse, &mut self.spare);
        for (memory, trusted) in self.memory.iter_mut().zip(&self.spare_trust) {
            *memory = Memory { clean: 0, measured: false, trusted: *trusted, ..*memory };
        }
        for (shape, memory) in self.structure.shapes.iter().zip(&self.memory) {
            // Only corrections need it.
            if !memory.trusted {
                let target = &mut self.hessian[shape.at_inverse..][..shape.n * shape.wide];
                pack(h, self.structure.variables(shape), shape.wide, target);
            }
        }
        for (j, unit) in self.units.iter_mut().enumerate() {
            *unit = h[(j, j)].sqrt();
        }
        if self.explicit.serves() {
            for (index, shape) in self.structure.shapes.iter().enumerate() {
                let size = shape.n * shape.wide;
                let matrices =
                    [&self.hessian, &self.inverse].map(|all| &all[shape.at_inverse..][..size]);
                let trusted = self.memory[index].trusted;
                self.explicit.refresh(index, matrices, &self.units, trusted);
            }
            return Ok(());
        }
        self.known.fill(false);
        self.all_trusted = self.memory.iter().all(|memory| memory.trusted);
        self.front.set_inverse(&self.structure, &self.inverse);
        Ok(())
    }

    /// Writes the free minimum of the whole problem to the front, and the values of all rows.
    pub(super) fn release(&mut self, f: &[f64]) {
        if self.all_trusted && self.front.is_joint(&self.structure) {
            self.front.release(f);
        } else {
            for (index, shape) in self.structure.shapes.iter().enumerate() {
                let (n, wide) = (shape.n, shape.wide);
                let variables = self.structure.variables(shape);
                let own_f = &mut self.f[shape.at_wide..][..wide];
                let x = &mut self.x[shape.at_wide..][..wide];
                for (own, &j) in own_f.iter_mut().zip(variables) {
                    *own = -f[j as usize];
                }
                let inverse = &self.inverse[shape.at_inverse..][..n * wide];
                times(inverse, &own_f[..n], x);
                if !self.memory[index].trusted {
                    let hessian = &self.hessian[shape.at_inverse..][..n * wide];
                    let [rest, step, ..] = &mut self.scratch;
                    let (rest, step) = (&mut rest[..wide], &mut step[..wide]);
                    times(hessian, &x[..n], rest);
                    for (rest, f) in rest.iter_mut().zip(own_f.iter()) {
                        *rest = f - *rest;
                    }
                    times(inverse, &rest[..n], step);
                    for (x, step) in x.iter_mut().zip(step.iter()) {
                        *x += step;
                    }
                }
                for (x, &j) in x.iter().zip(variables) {
                    self.front.x[j as usize] = *x;
                }
            }
        }
        self.front.evaluate();
    }

    /// True if block `index` holds no row and its free minimum is within the bounds.
    pub(super) fn is_free(&self, index: usize, lower: &[f64], upper: &[f64]) -> bool {
        if self.memory[index].count > 0 {
            return false;
        }
        let mut inside = true;
        for member in self.structure.members(&self.structure.shapes[index]) {
            let row = member.row as usize;
            let value = self.front.values[row];
            inside &= lower[row] <= value && value <= upper[row];
        }
        inside
    }

    /// Takes a working set of the whole problem.
    pub(super) fn adopt(&mut self, set: &[i8]) {
        if self.explicit.serves() {
            self.explicit.adopt(set);
            return;
        }
        self.sides.fill(0);
        for (shape, memory) in self.structure.shapes.iter().zip(&mut self.memory) {
            let sides = &mut self.sides[shape.at_tall..][..shape.tall];
            for member in self.structure.members(shape) {
                let side = &mut sides[member.merged as usize];
                *side = if *side == 0 { set[member.row as usize] } else { *side };
            }
            let order = &mut self.order[shape.at_order..][..shape.most];
            let held = (0..).zip(sides.iter_mut()).filter(|(_, side)| **side != 0);
            (memory.count, memory.clean) = (0, 0);
            for (row, side) in held {
                match order.get_mut(memory.count) {
                    Some(place) => {
                        *place = row;
                        memory.count += 1;
                    }
                    None => *side = 0,
                }
            }
        }
    }

    /// Rows in the working set of block `index`.
    pub(super) fn rows_held(&self, index: usize) -> u32 {
        super::structure::index(self.memory[index].count)
    }

    /// The largest entry of the free minimum, each in its unit.
    pub(super) fn size(&self) -> f64 {
        let entry = |(x, unit): (&f64, &f64)| x.abs() * unit;
        let larger = |most: f64, entry: f64| if entry > most { entry } else { most };
        // Four maxima at once: one would wait for itself.
        let (groups, rest) = self.units.as_chunks::<LANES>();
        let mut most = [0.0; LANES];
        for (group, x) in groups.iter().zip(self.front.x.as_chunks::<LANES>().0) {
            for (most, pair) in most.iter_mut().zip(x.iter().zip(group)) {
                *most = larger(*most, entry(pair));
            }
        }
        let tail = self.front.x[self.units.len() - rest.len()..].iter().zip(rest).map(entry);
        most.into_iter().chain(tail).fold(0.0, larger)
    }
}

/// Writes the part of `h` that belongs to some `variables` in padded rows.
fn pack(h: &DMatrix<f64>, variables: &[u32], wide: usize, target: &mut [f64]) {
    for (row, &j) in target.chunks_exact_mut(wide).zip(variables) {
        let source = column(h, j as usize);
        let (own, padding) = row.split_at_mut(variables.len());
        if source.len() == own.len() {
            own.copy_from_slice(source);
        } else {
            for (entry, &i) in own.iter_mut().zip(variables) {
                *entry = source[i as usize];
            }
        }
        for entry in padding {
            *entry = 0.0;
        }
    }
}
