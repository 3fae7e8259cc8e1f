//! One block as the walk sees it.

use super::blocks::{Blocks, Memory};
use super::factor::Factor;
use super::structure::{Shape, Structure};
use super::tableau::MAX_ROWS;

/// One block.
#[derive(Debug)]
pub(super) struct Block<'a> {
    pub(super) shape: Shape,
    pub(super) structure: &'a Structure,
    pub(super) hessian: &'a [f64],
    pub(super) inverse: &'a [f64],
    pub(super) compliance: &'a [f64],
    units: &'a [f64],
    pub(super) trusted: bool,
    pub(super) tolerance: f64,
    measured: &'a mut bool,
    pub(super) gram: &'a mut [f64],
    known: &'a mut [bool],
    pub(super) d: &'a mut [f64],
    pub(super) reach: &'a mut [f64],
    pub(super) weights: &'a mut [f64],
    pub(super) f: &'a mut [f64],
    pub(super) x: &'a mut [f64],
    pub(super) free: &'a mut [f64],
    pub(super) values: &'a mut [f64],
    pub(super) lower: &'a mut [f64],
    pub(super) upper: &'a mut [f64],
    /// Rows of the tableau of a small block.
    pub(super) tableau: &'a mut [f64],
    pub(super) sides: &'a mut [i8],
    pub(super) factor: Factor<'a>,
    pub(super) multipliers: &'a mut [f64],
    pub(super) low: &'a mut [f64],
    pub(super) high: &'a mut [f64],
    pub(super) direction: &'a mut [f64],
    pub(super) scratch: [&'a mut [f64]; 4],
}

impl Blocks {
    /// A view of block `index`.
    pub(super) fn block(&mut self, index: usize) -> Block<'_> {
        let shape = self.structure.shapes[index];
        let Shape { n, m, wide, tall, most, .. } = shape;
        let (at_wide, at_tall, at_order) = (shape.at_wide, shape.at_tall, shape.at_order);
        let Memory { count, clean, measured, trusted } = &mut self.memory[index];
        let [a, b, c, d] = &mut self.scratch;
        Block {
            shape,
            structure: &self.structure,
            hessian: &self.hessian[shape.at_inverse..][..n * wide],
            inverse: &self.inverse[shape.at_inverse..][..n * wide],
            units: &self.units,
            compliance: &self.structure.compliance[shape.first_row..][..m],
            trusted: *trusted,
            tolerance: self.tolerance,
            measured,
            gram: &mut self.gram[shape.at_gram..][..m * tall],
            known: &mut self.known[shape.first_row..][..m],
            d: &mut self.d[at_wide..][..wide],
            reach: &mut self.reach[at_tall..][..tall],
            weights: &mut self.weights[at_tall..][..tall],
            f: &mut self.f[at_wide..][..wide],
            x: &mut self.x[at_wide..][..wide],
            free: &mut self.free[at_tall..][..tall],
            values: &mut self.values[at_tall..][..tall],
            lower: &mut self.lower[at_tall..][..tall],
            upper: &mut self.upper[at_tall..][..tall],
            tableau: &mut self.tableau[at_order * MAX_ROWS..][..most * MAX_ROWS],
            sides: &mut self.sides[at_tall..][..m],
            factor: Factor {
                count,
                clean,
                order: &mut self.order[at_order..][..most],
                l: &mut self.l[shape.at_factor..][..most * most],
                most,
                d: &mut self.pivots[at_order..][..most],
                inverse: &mut self.inverse_pivots[at_order..][..most],
            },
            multipliers: &mut self.multipliers[at_order..][..most],
            low: &mut self.low[..tall],
            high: &mut self.high[..tall],
            direction: &mut self.direction[..tall],
            scratch: [a, b, c, d],
        }
    }
}

impl Block<'_> {
    /// Takes over the free minimum; both of the whole problem.
    pub(super) fn start(&mut self, f: &[f64], x: &[f64]) {
        let variables = self.structure.variables(&self.shape).iter();
        for ((own_f, own_x), &j) in self.f.iter_mut().zip(self.x.iter_mut()).zip(variables) {
            (*own_f, *own_x) = (-f[j as usize], x[j as usize]);
        }
        self.structure.values(&self.shape, self.x, self.free);
    }

    /// Lengths of rows and variables, on demand.
    pub(super) fn measure(&mut self) {
        if *self.measured {
            return;
        }
        let variables = self.structure.variables(&self.shape);
        for (d, &j) in self.d.iter_mut().zip(variables) {
            *d = 1.0 / self.units[j as usize];
        }
        for k in 0..self.shape.m {
            let terms = self.structure.normal(&self.shape, k);
            let (mut sum, mut most) = (0.0, 0.0);
            for term in terms {
                let length = term.coefficient.abs() * self.d[term.variable as usize];
                sum += length;
                most = if length > most { length } else { most };
            }
            (self.reach[k], self.weights[k]) = (sum, 1.0 / most);
        }
        self.reach[self.shape.m..].fill(1.0);
        self.weights[self.shape.m..].fill(1.0);
        *self.measured = true;
    }

    /// Makes sure that column `row` of the Gram matrix is there.
    pub(super) fn need(&mut self, row: usize) {
        if self.known[row] {
            return;
        }
        self.known[row] = true;
        let (wide, tall) = (self.shape.wide, self.shape.tall);
        let terms = self.structure.normal(&self.shape, row);
        let image = &mut self.scratch[3][..wide];
        image.fill(0.0);
        for term in terms {
            let source = &self.inverse[term.variable as usize * wide..][..wide];
            for (entry, source) in image.iter_mut().zip(source) {
                *entry += term.coefficient * source;
            }
        }
        let target = &mut self.gram[row * tall..][..tall];
        target[self.shape.m..].fill(0.0);
        self.structure.values(&self.shape, image, target);
    }
}
