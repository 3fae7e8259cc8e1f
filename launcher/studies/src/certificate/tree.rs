//! The walk of the active-set solver with affine functions for numbers, following every way that
//! some parameters take.

use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;

use super::MARGIN;
use super::region::{Line, Region};

/// Pivots below this, relative to their row, mean dependent rows.
const DEPENDENT: f64 = 1e-10;

/// What the walk needs of the program.
#[derive(Debug)]
pub(super) struct Program {
    pub(super) parameters: usize,
    /// Rows that a working set can have.
    pub(super) most: usize,
    /// A H⁻¹ A'.
    pub(super) gram: DMatrix<f64>,
    /// Row values at the free minimum.
    pub(super) free: Vec<Line>,
    pub(super) lower: Vec<Vec<Line>>,
    pub(super) upper: Vec<Vec<Line>>,
    /// Units in which violations are compared: the largest coefficient of each row, in variables
    /// that have one on the diagonal of H.
    pub(super) unit: Vec<f64>,
}

/// Why an enumeration ended early.
#[derive(Debug)]
pub(super) enum Outcome {
    TooManyPaths(u64),
    /// No point satisfies the rows at these parameters.
    Infeasible(Vec<f64>),
}

/// A point on a path: the part of the box that got here, and the state of the solver.
#[derive(Debug, Clone)]
struct Node {
    region: Region,
    changes: u32,
    /// The bound of each side that holds, if any.
    lower: Vec<Option<Line>>,
    upper: Vec<Option<Line>>,
    /// Working rows with side and multiplier.
    working: Vec<(usize, f64, Line)>,
    values: Vec<Line>,
    /// Sets that rows were chosen from on the way here.
    passed: Vec<Vec<i8>>,
}

impl Node {
    fn bound(&self, row: usize, side: f64) -> Option<&Line> {
        if side < 0.0 { self.lower[row].as_ref() } else { self.upper[row].as_ref() }
    }

    fn set(&self) -> Vec<i8> {
        let mut set = vec![0; self.lower.len()];
        for (row, side, _) in &self.working {
            set[*row] = if *side < 0.0 { -1 } else { 1 };
        }
        set
    }
}

/// All paths so far.
#[derive(Debug)]
pub(super) struct Enumeration<'a> {
    program: &'a Program,
    most_paths: u64,
    pub(super) paths: u64,
    /// The sets that paths ended in.
    pub(super) sets: BTreeSet<Vec<i8>>,
    /// Most changes, with parameters that need them and the set they start from.
    pub(super) worst: (u32, Vec<f64>, Vec<i8>),
    start: Vec<i8>,
}

impl<'a> Enumeration<'a> {
    pub(super) fn new(program: &'a Program, most_paths: u64) -> Self {
        Self {
            program,
            most_paths,
            paths: 0,
            sets: BTreeSet::new(),
            worst: (0, vec![0.0; program.parameters], vec![0; program.free.len()]),
            start: Vec::new(),
        }
    }

    /// Follows all paths from a working set.
    pub(super) fn follow(&mut self, set: &[i8]) -> Result<(), Outcome> {
        self.start = set.to_vec();
        let none = || vec![None; set.len()];
        let node = Node {
            region: Region::all(self.program.parameters),
            changes: 0,
            lower: none(),
            upper: none(),
            working: Vec::new(),
            values: Vec::new(),
            passed: Vec::new(),
        };
        self.bounds(node, 0, set)
    }

    /// Branches over which of several bounds of one side holds; `side` counts lower, upper by row.
    fn bounds(&mut self, mut node: Node, side: usize, set: &[i8]) -> Result<(), Outcome> {
        let row = side / 2;
        if row == set.len() {
            let held = set.iter().enumerate().filter(|(_, side)| **side != 0);
            let zero = Line::zero(self.program.parameters);
            node.working = held.map(|(k, &side)| (k, f64::from(side), zero.clone())).collect();
            self.evaluate(&mut node);
            return self.drop_wrong(node, 0, Vec::new());
        }
        let (candidates, sign) = if side.is_multiple_of(2) {
            (&self.program.lower[row], -1.0)
        } else {
            (&self.program.upper[row], 1.0)
        };
        if candidates.is_empty() {
            return self.bounds(node, side + 1, set);
        }
        for tightest in candidates {
            let others = candidates.iter().filter(|other| *other != tightest);
            let cuts: Vec<Line> = others.map(|other| tightest.minus(other).times(sign)).collect();
            let Some(region) = node.region.where_not_positive(&cuts) else { continue };
            let mut next = Node { region, ..node.clone() };
            let place = if side.is_multiple_of(2) { &mut next.lower } else { &mut next.upper };
            place[row] = Some(tightest.clone());
            self.bounds(next, side + 1, set)?;
        }
        Ok(())
    }

    /// Multipliers and values of the working set: λ = (`P_WW`)⁻¹ (r⁰ - b).
    fn evaluate(&self, node: &mut Node) {
        let rows: Vec<usize> = node.working.iter().map(|(row, ..)| *row).collect();
        let inverse = self.inverse(&rows);
        let excess: Vec<Line> = node
            .working
            .iter()
            .map(|&(row, side, _)| match node.bound(row, side) {
                Some(bound) => self.program.free[row].minus(bound),
                None => Line::zero(self.program.parameters),
            })
            .collect();
        for (i, (.., multiplier)) in node.working.iter_mut().enumerate() {
            let zero = Line::zero(self.program.parameters);
            let parts = excess.iter().enumerate();
            *multiplier = parts.fold(zero, |sum, (j, excess)| sum.plus(inverse[(i, j)], excess));
        }
        node.values.clone_from(&self.program.free);
        for (row, _, multiplier) in &node.working {
            for (k, value) in node.values.iter_mut().enumerate() {
                *value = value.clone().plus(-self.program.gram[(k, *row)], multiplier);
            }
        }
    }

    fn inverse(&self, rows: &[usize]) -> DMatrix<f64> {
        let gram = self.program.gram.select_rows(rows).select_columns(rows);
        gram.cholesky().map_or_else(|| DMatrix::zeros(rows.len(), rows.len()), |c| c.inverse())
    }

    /// Branches over which working multipliers push the wrong way, from `position` on.
    fn drop_wrong(
        &mut self,
        mut node: Node,
        position: usize,
        wrong: Vec<usize>,
    ) -> Result<(), Outcome> {
        if position < node.working.len() {
            let (_, side, multiplier) = &node.working[position];
            for (sign, is_wrong) in [(-1.0, false), (1.0, true)] {
                let cut = [multiplier.times(sign * side)];
                let Some(region) = node.region.where_not_positive(&cut) else { continue };
                let mut wrong = wrong.clone();
                if is_wrong {
                    wrong.push(position);
                }
                self.drop_wrong(Node { region, ..node.clone() }, position + 1, wrong)?;
            }
            return Ok(());
        }
        if wrong.is_empty() {
            return self.choose(node);
        }
        for position in wrong.into_iter().rev() {
            node.working.remove(position);
            node.changes += 1;
        }
        self.evaluate(&mut node);
        self.drop_wrong(node, 0, Vec::new())
    }

    /// Branches over which row is violated most, and the end where none is.
    fn choose(&mut self, mut node: Node) -> Result<(), Outcome> {
        let set = node.set();
        // The dual cost grows with every row that enters, so that no set returns: this region is
        // empty but for rounding.
        if node.passed.contains(&set) {
            return Ok(());
        }
        node.passed.push(set);
        let node = &node;
        let mut misses = Vec::new();
        for (row, value) in node.values.iter().enumerate() {
            if node.working.iter().any(|(other, ..)| *other == row) {
                continue;
            }
            for side in [-1.0, 1.0] {
                if let Some(bound) = node.bound(row, side) {
                    // Relative to what the row can reach, so that the margin means the same.
                    let free = &self.program.free[row];
                    let range = free.swing() + free.constant.abs() + bound.constant.abs();
                    let mut miss = value.minus(bound).times(side);
                    miss.constant -= MARGIN * range;
                    misses.push((row, side, miss.times(1.0 / self.program.unit[row])));
                }
            }
        }
        let satisfied: Vec<Line> = misses.iter().map(|(.., miss)| miss.clone()).collect();
        if node.region.where_not_positive(&satisfied).is_some() {
            self.end(node)?;
        }
        for (k, (row, side, miss)) in misses.iter().enumerate() {
            let others = misses.iter().enumerate().filter(|(other, _)| *other != k);
            let mut cuts = vec![miss.times(-1.0)];
            cuts.extend(others.map(|(_, (.., other))| other.minus(miss)));
            if let Some(region) = node.region.where_not_positive(&cuts) {
                let none = Line::zero(self.program.parameters);
                self.enter(Node { region, ..node.clone() }, *row, *side, &none)?;
            }
        }
        Ok(())
    }

    /// Branches over what ends the growth of an entering row's multiplier.
    fn enter(
        &mut self,
        mut node: Node,
        row: usize,
        side: f64,
        multiplier: &Line,
    ) -> Result<(), Outcome> {
        node.changes += 1;
        let rows: Vec<usize> = node.working.iter().map(|(row, ..)| *row).collect();
        let gram = &self.program.gram;
        let across = DVector::from_iterator(rows.len(), rows.iter().map(|k| gram[(*k, row)]));
        let ratio = self.inverse(&rows) * &across;
        let pivot = gram[(row, row)] - across.dot(&ratio);
        let fits = pivot > DEPENDENT * gram[(row, row)] && rows.len() < self.program.most;
        // Steps to each possible end; `None` is the row's own bound.
        let mut ends: Vec<(Option<usize>, Line)> = Vec::new();
        if let (true, Some(bound)) = (fits, node.bound(row, side)) {
            ends.push((None, node.values[row].minus(bound).times(side / pivot)));
        }
        for (position, (_, own, held)) in node.working.iter().enumerate() {
            let yields = own * side * ratio[position];
            if yields > DEPENDENT {
                ends.push((Some(position), held.times(own / yields)));
            }
        }
        if ends.is_empty() {
            return Err(Outcome::Infeasible(node.region.witness));
        }
        for (end, step) in &ends {
            let others = ends.iter().filter(|(other, _)| other != end);
            let cuts: Vec<Line> = others.map(|(_, other)| step.minus(other)).collect();
            let Some(region) = node.region.where_not_positive(&cuts) else { continue };
            let mut next = Node { region, ..node.clone() };
            let grown = multiplier.clone().plus(side, step);
            self.advance(&mut next, row, side, step, &ratio);
            match end {
                None => {
                    next.working.push((row, side, grown));
                    self.choose(next)?;
                }
                Some(position) => {
                    next.working.remove(*position);
                    self.enter(next, row, side, &grown)?;
                }
            }
        }
        Ok(())
    }

    fn advance(&self, node: &mut Node, row: usize, side: f64, step: &Line, ratio: &DVector<f64>) {
        let gram = &self.program.gram;
        for (k, value) in node.values.iter_mut().enumerate() {
            let shares =
                node.working.iter().zip(ratio).map(|((other, ..), r)| gram[(k, *other)] * r);
            *value = value.clone().plus(-side * (gram[(k, row)] - shares.sum::<f64>()), step);
        }
        for ((.., multiplier), ratio) in node.working.iter_mut().zip(ratio) {
            *multiplier = multiplier.clone().plus(-side * ratio, step);
        }
    }

    /// A path is complete.
    fn end(&mut self, node: &Node) -> Result<(), Outcome> {
        self.paths += 1;
        if self.paths > self.most_paths {
            return Err(Outcome::TooManyPaths(self.most_paths));
        }
        if node.changes > self.worst.0 {
            self.worst = (node.changes, node.region.witness.clone(), self.start.clone());
        }
        self.sets.insert(node.set());
        Ok(())
    }
}
