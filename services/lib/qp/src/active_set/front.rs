//! The free minimum and the values of all rows there, for the whole problem at once: all that a
//! solve needs when no bound is met.

use nalgebra::DMatrix;

use super::inverse::times;
use super::structure::{
    LOOK_BACK, NONE, Step, Structure, Term, continuation, evaluate, index, padded,
};

/// Up to this many variables one product with zeros in it is faster than one per block.
const DENSE: usize = 12;

/// H⁻¹ and the rows in the order of the problem.
#[derive(Debug, Clone)]
pub(super) struct Front {
    steps: Vec<Step>,
    terms: Vec<Term>,
    /// H⁻¹ by padded rows, where there are several blocks and one product serves them all.
    inverse: Vec<f64>,
    wide: usize,
    /// The free minimum of all variables, padded, and the values of all rows there.
    pub(super) x: Vec<f64>,
    pub(super) values: Vec<f64>,
}

impl Front {
    pub(super) fn new(n: usize, m: usize) -> Self {
        let wide = padded(n);
        Self {
            steps: Vec::with_capacity(m),
            terms: Vec::with_capacity(m * n),
            inverse: vec![0.0; wide * n.min(DENSE)],
            wide,
            x: vec![0.0; wide],
            values: vec![0.0; m],
        }
    }

    /// Takes new rows (columns of `rows`, `n x m`).
    pub(super) fn set_rows(&mut self, structure: &Structure, rows: &DMatrix<f64>) {
        self.steps.clear();
        self.terms.clear();
        for row in 0..rows.ncols() {
            let start = row.saturating_sub(LOOK_BACK);
            let found = continuation(row, start..row, rows, &structure.variables);
            let from = self.terms.len();
            for j in 0..rows.nrows() {
                let old = found.map_or(0.0, |position| rows[(j, start + position)]);
                self.terms.extend(Term::change(index(j), old, rows[(j, row)]));
            }
            let base = found.map_or(NONE, |position| index(start + position));
            self.steps.push(Step::take(base, &mut self.terms, from));
        }
    }

    /// True if the inverses of several blocks stand in one matrix here.
    pub(super) fn is_joint(&self, structure: &Structure) -> bool {
        structure.shapes.len() > 1 && self.inverse.len() == self.wide * structure.variables.len()
    }

    /// Takes the inverses of the blocks.
    pub(super) fn set_inverse(&mut self, structure: &Structure, inverse: &[f64]) {
        if !self.is_joint(structure) {
            return;
        }
        self.inverse.fill(0.0);
        for shape in &structure.shapes {
            let variables = structure.variables(shape);
            let rows = inverse[shape.at_inverse..].chunks_exact(shape.wide);
            for (&j, row) in variables.iter().zip(rows) {
                let target = &mut self.inverse[j as usize * self.wide..][..self.wide];
                for (&i, entry) in variables.iter().zip(row) {
                    target[i as usize] = *entry;
                }
            }
        }
    }

    /// x <- -H⁻¹ f, by one product.
    pub(super) fn release(&mut self, f: &[f64]) {
        times(&self.inverse, f, &mut self.x);
        for x in &mut self.x {
            *x = -*x;
        }
    }

    /// Values of all rows at x.
    pub(super) fn evaluate(&mut self) {
        evaluate(&self.steps, &self.terms, &self.x, &mut self.values);
    }

    /// True if all rows are within their bounds, which are numbers then.
    pub(super) fn is_inside(&self, lower: &[f64], upper: &[f64]) -> bool {
        // No early end: without branches several rows go at once.
        let mut inside = true;
        for ((value, low), high) in self.values.iter().zip(lower).zip(upper) {
            let (above, below) = (low <= value, value <= high);
            inside &= above & below;
        }
        inside
    }

    /// f'H⁻¹f.
    pub(super) fn depth(&self, f: &[f64]) -> f64 {
        crate::linear::dot(&self.x[..f.len()], f).abs()
    }
}
