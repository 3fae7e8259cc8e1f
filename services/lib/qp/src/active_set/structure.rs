//! What the matrices are made of: blocks of variables that share neither cost nor row, rows with
//! the same normal, rows that continue other rows.
//!
//! All of it rests on exact zeros and exact equality, so it is a function of the matrices alone.

#![expect(clippy::float_cmp, reason = "structure is what is exactly equal")]

use nalgebra::DMatrix;

use crate::linear::column;

/// A row without a predecessor to continue.
pub(super) const NONE: u32 = u32::MAX;
/// How far back the predecessor of a row is looked for: the inputs of a step and some more.
pub(super) const LOOK_BACK: usize = 8;

/// One row: the value of an earlier row, if any, one term, and `more` terms. The running sums of an
/// increment need one addition each this way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    base: u32,
    more: u32,
    first: Term,
}

/// `coefficient` times the variable with this index in its block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Term {
    pub(super) variable: u32,
    pub(super) coefficient: f64,
}

/// A row of the problem and the row of its block that stands for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Member {
    pub(super) row: u32,
    pub(super) merged: u32,
}

/// Where a block lies in the arrays over all blocks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shape {
    /// Variables and merged rows, the latter with one unit row for every variable.
    pub(super) n: usize,
    pub(super) m: usize,
    /// Most rows that can stand in a working set.
    pub(super) most: usize,
    /// Lengths of a vector of variables, and of rows, with padding.
    pub(super) wide: usize,
    pub(super) tall: usize,
    pub(super) members: usize,
    /// First entry of this block in the arrays over variables, rows, members, terms.
    pub(super) first_variable: usize,
    pub(super) first_row: usize,
    pub(super) first_member: usize,
    first_term: usize,
    /// The same with padding, and in the arrays of matrices.
    pub(super) at_wide: usize,
    pub(super) at_tall: usize,
    pub(super) at_inverse: usize,
    pub(super) at_gram: usize,
    pub(super) at_factor: usize,
    pub(super) at_order: usize,
}

/// Vectors are padded to whole groups of this many numbers.
pub(super) const LANES: usize = 4;

pub(super) fn padded(length: usize) -> usize {
    length.next_multiple_of(LANES)
}

#[derive(Debug, Clone)]
pub(super) struct Structure {
    pub(super) shapes: Vec<Shape>,
    /// Variables of the problem, block by block.
    pub(super) variables: Vec<u32>,
    /// Per variable in that order: the row of its block that is the variable itself.
    pub(super) units: Vec<u32>,
    pub(super) members: Vec<Member>,
    /// Rows of the problem without an entry.
    pub(super) empty_rows: Vec<u32>,
    /// Compliance per merged row.
    pub(super) compliance: Vec<f64>,
    steps: Vec<Step>,
    terms: Vec<Term>,
    /// Per merged row its terms from zero, for the normals.
    normals: Vec<Term>,
    normal_ends: Vec<u32>,
    parent: Vec<u32>,
    local: Vec<u32>,
    hashes: Vec<u64>,
    /// Per merged row of the block at hand: the row of the problem it came from.
    origin: Vec<u32>,
}

impl Structure {
    pub(super) fn new(n: usize, m: usize) -> Self {
        Self {
            shapes: Vec::with_capacity(n),
            variables: Vec::with_capacity(n),
            units: Vec::with_capacity(n),
            members: Vec::with_capacity(m),
            empty_rows: Vec::with_capacity(m),
            compliance: Vec::with_capacity(m + n),
            steps: Vec::with_capacity(m + n),
            terms: Vec::with_capacity(m * n + n),
            normals: Vec::with_capacity(m * n + n),
            normal_ends: Vec::with_capacity(m + n),
            parent: vec![0; n],
            local: vec![0; n],
            hashes: vec![0; m],
            origin: Vec::with_capacity(m),
        }
    }

    /// Finds the blocks of `h` (`n x n`) and the columns of `rows` (`n x m`).
    pub(super) fn analyse(&mut self, h: &DMatrix<f64>, rows: &DMatrix<f64>, compliance: &[f64]) {
        self.connect(h, rows);
        self.forget();
        let n = self.parent.len();
        for root in 0..n {
            if self.root(root) == root {
                self.add_block(root, rows, compliance);
            }
        }
        let empty = (0..rows.ncols()).filter(|&i| column(rows, i).iter().all(|a| *a == 0.0));
        self.empty_rows.extend(empty.map(index));
    }

    /// True if `h` has the blocks that are in force.
    pub(super) fn fits(&mut self, h: &DMatrix<f64>, rows: &DMatrix<f64>) -> bool {
        if self.shapes.len() == 1 && column(h, 0).iter().all(|entry| *entry != 0.0) {
            return true;
        }
        self.connect(h, rows);
        let n = self.parent.len();
        let roots = (0..n).filter(|&j| self.root(j) == j).count();
        roots == self.shapes.len()
            && self.shapes.iter().all(|shape| {
                let mut block = self.variables[shape.first_variable..][..shape.n].iter();
                let root = block.next().map(|&j| self.root(j as usize));
                block.all(|&j| Some(self.root(j as usize)) == root)
            })
    }

    fn forget(&mut self) {
        self.shapes.clear();
        self.variables.clear();
        self.units.clear();
        self.members.clear();
        self.empty_rows.clear();
        self.compliance.clear();
        self.steps.clear();
        self.terms.clear();
        self.normals.clear();
        self.normal_ends.clear();
    }

    fn root(&self, mut j: usize) -> usize {
        while self.parent[j] as usize != j {
            j = self.parent[j] as usize;
        }
        j
    }

    /// Joins two variables; the smaller index becomes the root.
    fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.root(i), self.root(j));
        self.parent[i.max(j)] = index(i.min(j));
    }

    fn connect(&mut self, h: &DMatrix<f64>, rows: &DMatrix<f64>) {
        for (j, parent) in self.parent.iter_mut().enumerate() {
            *parent = index(j);
        }
        for j in 0..self.parent.len() {
            for (i, entry) in column(h, j).iter().enumerate() {
                if *entry != 0.0 && i != j {
                    self.join(i, j);
                }
            }
        }
        for row in 0..rows.ncols() {
            let mut first = None;
            for (j, entry) in column(rows, row).iter().enumerate() {
                if *entry != 0.0 {
                    self.join(j, *first.get_or_insert(j));
                }
            }
        }
    }

    fn add_block(&mut self, root: usize, rows: &DMatrix<f64>, compliance: &[f64]) {
        let last = self.shapes.last().copied().unwrap_or_default();
        let first_variable = self.variables.len();
        let n = self.parent.len();
        for j in root..n {
            if self.root(j) == root {
                self.local[j] = index(self.variables.len() - first_variable);
                self.variables.push(index(j));
            }
        }
        let mut shape = Shape {
            n: self.variables.len() - first_variable,
            first_variable,
            first_row: self.steps.len(),
            first_member: self.members.len(),
            first_term: self.terms.len(),
            at_wide: last.at_wide + last.wide,
            at_tall: last.at_tall + last.tall,
            at_inverse: last.at_inverse + last.wide * last.n,
            at_gram: last.at_gram + last.tall * last.m,
            at_factor: last.at_factor + last.most * last.most,
            at_order: last.at_order + last.most,
            ..Shape::default()
        };
        self.origin.clear();
        for row in 0..rows.ncols() {
            let entry = column(rows, row).iter().position(|a| *a != 0.0);
            if entry.is_some_and(|j| self.root(j) == root) {
                self.add_member(row, &shape, rows, compliance);
            }
        }
        let real = self.origin.len();
        self.add_units(&shape, real, rows);
        shape.m = self.steps.len() - shape.first_row;
        let soft = self.compliance[shape.first_row..].iter().any(|c| *c > 0.0);
        shape.most = if soft { real } else { real.min(shape.n) };
        (shape.wide, shape.tall) = (padded(shape.n), padded(shape.m));
        shape.members = self.members.len() - shape.first_member;
        self.shapes.push(shape);
    }

    /// Adds a row of the problem: to the one with its normal, or as a new one.
    fn add_member(&mut self, row: usize, shape: &Shape, rows: &DMatrix<f64>, compliance: &[f64]) {
        let normal = column(rows, row);
        let mixed = |hash: u64, a: &f64| (hash ^ a.to_bits()).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.hashes[row] = normal.iter().fold(0, mixed);
        // Soft rows stay apart: two of them with one normal pull twice.
        let same = self.origin.iter().position(|&other| {
            let other = other as usize;
            self.hashes[other] == self.hashes[row]
                && compliance[other].max(compliance[row]) == 0.0
                && column(rows, other) == normal
        });
        let merged = same.unwrap_or(self.origin.len());
        self.members.push(Member { row: index(row), merged: index(merged) });
        if same.is_none() {
            self.add_step(row, shape, rows);
            self.origin.push(index(row));
            self.compliance.push(compliance[row]);
        }
    }

    fn add_step(&mut self, row: usize, shape: &Shape, rows: &DMatrix<f64>) {
        let variables = &self.variables[shape.first_variable..];
        let start = self.origin.len().saturating_sub(LOOK_BACK);
        let earlier = &self.origin[start..];
        let found = continuation(row, earlier.iter().map(|&k| k as usize), rows, variables);
        let base = found.map_or(NONE, |position| index(start + position));
        let before = self.terms.len();
        for &j in variables {
            let old = found.map_or(0.0, |position| rows[(j as usize, earlier[position] as usize)]);
            let new = rows[(j as usize, row)];
            let variable = self.local[j as usize];
            self.terms.extend(Term::change(variable, old, new));
            self.normals.extend(Term::change(variable, 0.0, new));
        }
        self.steps.push(Step::take(base, &mut self.terms, before));
        self.normal_ends.push(index(self.normals.len()));
    }

    /// Notes which rows are variables, and adds rows without bounds for the others.
    fn add_units(&mut self, shape: &Shape, real: usize, rows: &DMatrix<f64>) {
        let n = self.variables.len() - shape.first_variable;
        for local in 0..n {
            let j = self.variables[shape.first_variable + local] as usize;
            let is_unit = |row: &u32| {
                let normal = column(rows, *row as usize);
                normal[j] == 1.0 && normal.iter().filter(|a| **a != 0.0).count() == 1
            };
            let unit = self.origin[..real].iter().position(is_unit);
            let variable = index(local);
            if unit.is_none() {
                let first = Term { variable, coefficient: 1.0 };
                self.normals.push(first);
                self.steps.push(Step { base: NONE, more: 0, first });
                self.normal_ends.push(index(self.normals.len()));
                self.compliance.push(0.0);
            }
            let last = self.steps.len() - shape.first_row - 1;
            self.units.push(index(unit.unwrap_or(last)));
        }
    }

    /// The variables of a block.
    pub(super) fn variables(&self, shape: &Shape) -> &[u32] {
        &self.variables[shape.first_variable..][..shape.n]
    }

    /// Per variable of a block the row that is the variable itself.
    pub(super) fn units(&self, shape: &Shape) -> &[u32] {
        &self.units[shape.first_variable..][..shape.n]
    }

    /// The rows of the problem that belong to a block.
    pub(super) fn members(&self, shape: &Shape) -> &[Member] {
        &self.members[shape.first_member..][..shape.members]
    }

    /// The normal of row `k` of a block.
    pub(super) fn normal(&self, shape: &Shape, k: usize) -> &[Term] {
        let at = shape.first_row + k;
        let start = at.checked_sub(1).map_or(0, |before| self.normal_ends[before] as usize);
        &self.normals[start..self.normal_ends[at] as usize]
    }

    /// Values of all rows of a block, from those of the problem's rows and variables.
    pub(super) fn gather(&self, shape: &Shape, values: &[f64], x: &[f64], out: &mut [f64]) {
        for member in self.members(shape) {
            out[member.merged as usize] = values[member.row as usize];
        }
        for (&j, &unit) in self.variables(shape).iter().zip(self.units(shape)) {
            out[unit as usize] = x[j as usize];
        }
    }

    /// Values of all rows of a block at `x`.
    pub(super) fn values(&self, shape: &Shape, x: &[f64], out: &mut [f64]) {
        let steps = &self.steps[shape.first_row..][..shape.m];
        evaluate(steps, &self.terms[shape.first_term..], x, out);
    }
}

/// Values of the rows that `steps` and their `terms` describe, at `x`.
pub(super) fn evaluate(steps: &[Step], mut terms: &[Term], x: &[f64], out: &mut [f64]) {
    for (row, step) in steps.iter().enumerate() {
        let mut value = out.get(step.base as usize).copied().unwrap_or(0.0);
        value += step.first.coefficient * x[step.first.variable as usize];
        if step.more > 0 {
            let (own, rest) = terms.split_at(step.more as usize);
            for term in own {
                value += term.coefficient * x[term.variable as usize];
            }
            terms = rest;
        }
        out[row] = value;
    }
}

impl Step {
    /// Takes the terms from `before` on; all but the first stay there.
    pub(super) fn take(base: u32, terms: &mut Vec<Term>, before: usize) -> Self {
        let nothing = Term { variable: 0, coefficient: 0.0 };
        let first = if terms.len() > before { terms.remove(before) } else { nothing };
        Self { base, more: index(terms.len() - before), first }
    }
}

impl Term {
    /// What leads from one coefficient to another.
    pub(super) fn change(variable: u32, old: f64, new: f64) -> Option<Self> {
        let coefficient = if old == 0.0 { new } else { -old };
        (new != old).then_some(Self { variable, coefficient })
    }
}

/// The one of some `earlier` rows that needs the fewest terms to become `row`, by its position;
/// `None` if the row itself has no more. Only coefficients that appear or vanish are exact.
pub(super) fn continuation(
    row: usize,
    earlier: impl Iterator<Item = usize>,
    rows: &DMatrix<f64>,
    variables: &[u32],
) -> Option<usize> {
    let normal = column(rows, row);
    let mut least = variables.iter().filter(|&&j| normal[j as usize] != 0.0).count();
    let mut found = None;
    for (position, other) in earlier.enumerate() {
        let other = column(rows, other);
        let pairs = || variables.iter().map(|&j| (other[j as usize], normal[j as usize]));
        let exact = pairs().all(|(old, new)| old == new || old == 0.0 || new == 0.0);
        let count = pairs().filter(|(old, new)| old != new).count();
        if exact && count < least {
            (least, found) = (count, Some(position));
        }
    }
    found
}

pub(super) fn index(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(NONE)
}
