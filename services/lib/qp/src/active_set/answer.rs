//! From a block that meets its bounds to its part of the answer, by the walk for its size.

use super::blocks::Blocks;
use super::structure::{Member, Shape, Structure};
use super::tableau::{MAX_ROWS, Small, Tick};
use super::walk::Doubt;

/// Where the answer for the whole problem goes.
#[derive(Debug)]
pub(super) struct Answer<'a> {
    pub(super) x: &'a mut [f64],
    pub(super) set: &'a mut [i8],
    pub(super) multipliers: &'a mut [f64],
}

/// What was found for the rows of one block.
#[derive(Debug, Clone, Copy)]
struct Found<'a> {
    sides: &'a [i8],
    values: &'a [f64],
    pushes: &'a [f64],
    lower: &'a [f64],
    upper: &'a [f64],
}

impl Answer<'_> {
    fn publish(
        &mut self,
        structure: &Structure,
        shape: &Shape,
        tick: &Tick<'_>,
        found: &Found<'_>,
    ) {
        for (&j, &unit) in structure.variables(shape).iter().zip(structure.units(shape)) {
            self.x[j as usize] = found.values[unit as usize];
        }
        let members = structure.members(shape);
        for (position, member) in members.iter().enumerate() {
            let (row, k) = (member.row as usize, member.merged as usize);
            let side = found.sides[k];
            if side == 0 && self.set[row] == 0 {
                // Its multiplier is zero already.
                continue;
            }
            let (bounds, bound) =
                if side < 0 { (tick.lower, found.lower[k]) } else { (tick.upper, found.upper[k]) };
            // Of rows with one normal the first whose bound it is.
            let holds = |row: usize| side != 0 && bounds[row] <= bound && bound <= bounds[row];
            let earlier =
                |other: &Member| other.merged == member.merged && holds(other.row as usize);
            let held = holds(row) && !members[..position].iter().any(earlier);
            (self.set[row], self.multipliers[row]) =
                if held { (side, found.pushes[k]) } else { (0, 0.0) };
        }
    }
}

impl Blocks {
    /// Solves block `index`, by at most `most` changes, which it counts and returns.
    pub(super) fn walk(
        &mut self,
        index: usize,
        tick: &Tick<'_>,
        most: u32,
        answer: &mut Answer<'_>,
    ) -> Result<u32, Doubt> {
        match self.structure.shapes[index].tall {
            4 => self.walk_small::<4>(index, tick, most, answer),
            8 => self.walk_small::<8>(index, tick, most, answer),
            12 => self.walk_small::<12>(index, tick, most, answer),
            16 => self.walk_small::<16>(index, tick, most, answer),
            _ => self.walk_large(index, tick, most, answer),
        }
    }

    fn walk_large(
        &mut self,
        index: usize,
        tick: &Tick<'_>,
        most: u32,
        answer: &mut Answer<'_>,
    ) -> Result<u32, Doubt> {
        let mut block = self.block(index);
        block.start(tick.f, answer.x);
        let changes = block.walk(tick, most)?;
        // The free values are no longer needed: their place takes the multipliers by rows.
        for (&k, multiplier) in block.factor.rows().iter().zip(block.multipliers.iter()) {
            block.free[k as usize] = *multiplier;
        }
        let found = Found {
            sides: block.sides,
            values: block.values,
            pushes: block.free,
            lower: block.lower,
            upper: block.upper,
        };
        answer.publish(block.structure, &block.shape, tick, &found);
        Ok(changes)
    }

    fn walk_small<const M: usize>(
        &mut self,
        index: usize,
        tick: &Tick<'_>,
        most: u32,
        answer: &mut Answer<'_>,
    ) -> Result<u32, Doubt> {
        if !self.memory[index].measured {
            self.block(index).measure();
        }
        let shape = &self.structure.shapes[index];
        let trusted = self.memory[index].trusted;
        let mut free = [0.0; M];
        self.structure.gather(shape, &self.front.values, &self.front.x, &mut free);
        let lengths = self.reach[shape.at_tall..]
            .first_chunk()
            .zip(self.weights[shape.at_tall..].first_chunk());
        let lanes = self.sides[shape.at_tall..].first_chunk_mut().zip(lengths);
        let Some((sides, (reach, weights))) = lanes else { return Err(Doubt) };
        let tableau = &mut self.tableau[shape.at_order * MAX_ROWS..][..shape.most * M];
        let mut small = Small::<M> {
            structure: &self.structure,
            shape,
            memory: &mut self.memory[index],
            inverse: &self.inverse[shape.at_inverse..][..shape.n * shape.wide],
            gram: self.gram[shape.at_gram..][..shape.m * M].as_chunks_mut().0,
            known: &mut self.known[shape.first_row..][..shape.m],
            tableau: tableau.as_chunks_mut().0,
            order: &mut self.order[shape.at_order..][..shape.most],
            sides,
            reach,
            weights,
            compliance: &self.structure.compliance[shape.first_row..][..shape.m],
            free,
            lower: [f64::NEG_INFINITY; M],
            upper: [f64::INFINITY; M],
            low: [0.0; M],
            high: [0.0; M],
            values: [0.0; M],
            multipliers: [0.0; M],
            across: [0.0; M],
            changes: 0,
            most,
        };
        small.walk(tick)?;
        if trusted && small.is_weak() {
            return Err(Doubt);
        }
        let changes = small.changes;
        let Small { low, high, mut values, mut multipliers, lower, upper, .. } = small;
        if !trusted {
            let bounds = [&lower, &upper, &low, &high];
            self.polish_small(index, tick, answer.x, bounds, (&mut values, &mut multipliers))?;
        }
        let shape = &self.structure.shapes[index];
        let found = Found {
            sides: &self.sides[shape.at_tall..],
            values: &values,
            pushes: &multipliers,
            lower: &lower,
            upper: &upper,
        };
        answer.publish(&self.structure, shape, tick, &found);
        Ok(changes)
    }

    /// Corrects what a walk found for a small block by its residuals.
    fn polish_small<const M: usize>(
        &mut self,
        index: usize,
        tick: &Tick<'_>,
        x: &[f64],
        [lower, upper, low, high]: [&[f64; M]; 4],
        (values, multipliers): (&mut [f64; M], &mut [f64; M]),
    ) -> Result<(), Doubt> {
        let mut block = self.block(index);
        block.start(tick.f, x);
        block.lower.copy_from_slice(lower);
        block.upper.copy_from_slice(upper);
        block.low.copy_from_slice(low);
        block.high.copy_from_slice(high);
        block.values.copy_from_slice(values);
        for (by, &k) in block.multipliers.iter_mut().zip(block.factor.rows()) {
            *by = multipliers[k as usize];
        }
        block.polish()?;
        block.finish();
        values.copy_from_slice(block.values);
        for (by, &k) in block.multipliers.iter().zip(block.factor.rows()) {
            multipliers[k as usize] = *by;
        }
        Ok(())
    }
}
