//! Reader of recorded closed-loop programs; the format is in the README beside this file.

#![allow(dead_code, reason = "each user reads a part")]

use core::fmt;
use nalgebra::{DMatrix, DVector};
use std::path::Path;

/// Inputs per step, fixed by the format.
const AXES: usize = 3;
/// Larger counts are damage: the blocks they announce would not fit any file.
const MAX_COUNT: usize = 4096;

/// A file that is not what it should be.
#[derive(Debug)]
pub(crate) struct Damaged {
    pub(crate) file: String,
    /// Byte at which reading stopped making sense.
    pub(crate) offset: usize,
    pub(crate) what: String,
}

impl fmt::Display for Damaged {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}, byte {}: {}", self.file, self.offset, self.what)
    }
}

impl std::error::Error for Damaged {}

/// What stays the same between two ticks, or not if the model is scheduled.
#[derive(Debug, Clone)]
pub(crate) struct Constants {
    /// Bound on the increment of each axis, in its unit.
    pub(crate) rate_bound: [f64; AXES],
    /// Unit of each variable, `n`.
    pub(crate) scale: DVector<f64>,
    /// `n x n`.
    pub(crate) hessian: DMatrix<f64>,
    /// Bounds on the variables, `n` each.
    pub(crate) box_lower: DVector<f64>,
    pub(crate) box_upper: DVector<f64>,
}

/// One program and its solution.
#[derive(Debug, Clone)]
pub(crate) struct Tick {
    pub(crate) f: DVector<f64>,
    /// Bounds on the rows, `mr` each.
    pub(crate) lower: DVector<f64>,
    pub(crate) upper: DVector<f64>,
    /// The solution.
    pub(crate) x: DVector<f64>,
    /// One valid working set: boxes, then rows.
    pub(crate) sides: Vec<i8>,
}

/// One closed-loop run.
#[derive(Debug, Clone)]
pub(crate) struct Sequence {
    pub(crate) name: String,
    /// The constants change on every tick.
    pub(crate) varying: bool,
    /// Terms per axis of the Laguerre form; zero for plain increments.
    pub(crate) laguerre: usize,
    /// A, `mr x n`.
    pub(crate) rows: DMatrix<f64>,
    /// One, or one per tick if varying.
    pub(crate) constants: Vec<Constants>,
    pub(crate) ticks: Vec<Tick>,
}

impl Sequence {
    pub(crate) fn n(&self) -> usize {
        self.rows.ncols()
    }

    pub(crate) fn constants(&self, tick: usize) -> &Constants {
        &self.constants[if self.varying { tick } else { 0 }]
    }

    /// The rows that have a bound in some tick: boxes, then A, as indices into both.
    pub(crate) fn bounded(&self) -> Vec<usize> {
        let bound = |tick: usize, row: usize| {
            let (lower, upper) = self.ends(tick, row);
            lower.is_finite() || upper.is_finite()
        };
        let ticks = 0..self.ticks.len();
        let count = self.n() + self.rows.nrows();
        (0..count).filter(|&row| ticks.clone().any(|tick| bound(tick, row))).collect()
    }

    /// Boxes and A as one matrix, those rows that are `kept`.
    pub(crate) fn stacked(&self, kept: &[usize]) -> DMatrix<f64> {
        let n = self.n();
        DMatrix::from_fn(kept.len(), n, |i, j| match kept[i].checked_sub(n) {
            Some(row) => self.rows[(row, j)],
            None => f64::from(u8::from(kept[i] == j)),
        })
    }

    /// Lower and upper bounds of the rows that are `kept`.
    pub(crate) fn bounds(&self, tick: usize, kept: &[usize]) -> (DVector<f64>, DVector<f64>) {
        let ends: Vec<(f64, f64)> = kept.iter().map(|&row| self.ends(tick, row)).collect();
        let side = |pick: fn(&(f64, f64)) -> f64| {
            DVector::from_iterator(kept.len(), ends.iter().map(pick))
        };
        (side(|end| end.0), side(|end| end.1))
    }

    fn ends(&self, tick: usize, row: usize) -> (f64, f64) {
        let (constants, now) = (self.constants(tick), &self.ticks[tick]);
        match row.checked_sub(self.n()) {
            Some(row) => (now.lower[row], now.upper[row]),
            None => (constants.box_lower[row], constants.box_upper[row]),
        }
    }

    /// How far the first move of `x` is from the solution's, in units of the bound on it. In
    /// Laguerre form the worst of all rows, the first move among them.
    pub(crate) fn first_move_error(&self, tick: usize, x: &DVector<f64>) -> f64 {
        let constants = self.constants(tick);
        let error = x - &self.ticks[tick].x;
        let moved = if self.laguerre > 0 { &self.rows * error } else { error };
        let count = if self.laguerre > 0 { moved.len() } else { AXES };
        (0..count)
            .map(|i| (moved[i] * constants.scale[i % AXES] / constants.rate_bound[i % AXES]).abs())
            .fold(0.0, |worst, error| if error.is_nan() { f64::INFINITY } else { worst.max(error) })
    }
}

/// Reads one file.
pub(crate) fn read(path: &Path) -> Result<Vec<Sequence>, Damaged> {
    let file = path.display().to_string();
    match std::fs::read(path) {
        Ok(bytes) => parse(&file, &bytes),
        Err(error) => Err(Damaged { file, offset: 0, what: format!("cannot be read: {error}") }),
    }
}

/// Reads what a file holds; `file` is for errors.
pub(crate) fn parse(file: &str, bytes: &[u8]) -> Result<Vec<Sequence>, Damaged> {
    let mut cursor = Cursor { file, bytes, at: 0 };
    if cursor.take(4)? != b"MQPS" {
        return Err(cursor.damaged_at(0, "not a file of QP sequences: it must begin with MQPS"));
    }
    let version = cursor.count()?;
    if version != 2 {
        return Err(cursor.damaged_at(4, format!("format version {version}, only 2 is known")));
    }
    let runs = cursor.count()?;
    cursor.take(4)?;
    let mut sequences = Vec::new();
    for _ in 0..runs {
        sequences.push(cursor.sequence()?);
    }
    if cursor.at != bytes.len() {
        let left = bytes.len() - cursor.at;
        return Err(cursor.damaged_at(cursor.at, format!("{left} bytes after the last run")));
    }
    Ok(sequences)
}

struct Cursor<'a> {
    file: &'a str,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    fn damaged_at(&self, offset: usize, what: impl Into<String>) -> Damaged {
        Damaged { file: self.file.to_owned(), offset, what: what.into() }
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], Damaged> {
        let rest = &self.bytes[self.at..];
        let Some(taken) = rest.get(..length) else {
            let what = format!("the file ends where {length} more bytes belong");
            return Err(self.damaged_at(self.bytes.len(), what));
        };
        self.at += length;
        Ok(taken)
    }

    fn count(&mut self) -> Result<usize, Damaged> {
        let bytes = self.take(4)?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
    }

    /// A count in its range.
    fn within(&mut self, what: &str, least: usize, most: usize) -> Result<usize, Damaged> {
        let at = self.at;
        let value = self.count()?;
        if (least..=most).contains(&value) {
            return Ok(value);
        }
        Err(self.damaged_at(at, format!("{what} = {value} must lie in {least}..={most}")))
    }

    /// Numbers that are not NaN, and finite unless they are bounds.
    fn numbers(&mut self, what: &str, count: usize, bound: bool) -> Result<Vec<f64>, Damaged> {
        let at = self.at;
        let mut values = Vec::with_capacity(count);
        for (i, word) in self.take(8 * count)?.as_chunks::<8>().0.iter().enumerate() {
            let value = f64::from_le_bytes(*word);
            if value.is_nan() || (value.is_infinite() && !bound) {
                return Err(self.damaged_at(at + 8 * i, format!("{what}[{i}] is {value}")));
            }
            values.push(value);
        }
        Ok(values)
    }

    fn vector(&mut self, what: &str, count: usize) -> Result<DVector<f64>, Damaged> {
        Ok(DVector::from_vec(self.numbers(what, count, false)?))
    }

    fn bounds(&mut self, what: &str, count: usize) -> Result<DVector<f64>, Damaged> {
        Ok(DVector::from_vec(self.numbers(what, count, true)?))
    }

    /// Skips zeros up to the next multiple of 8.
    fn pad(&mut self) -> Result<(), Damaged> {
        let at = self.at;
        match self.take(at.next_multiple_of(8) - at)?.iter().position(|byte| *byte != 0) {
            Some(k) => Err(self.damaged_at(at + k, "padding that is not zero")),
            None => Ok(()),
        }
    }

    fn name(&mut self) -> Result<String, Damaged> {
        let length = self.within("length of the name", 1, MAX_COUNT)?;
        let at = self.at;
        let name = String::from_utf8(self.take(length)?.to_vec());
        let name = name.map_err(|_| self.damaged_at(at, "the name is not UTF-8"))?;
        self.pad()?;
        Ok(name)
    }

    fn sequence(&mut self) -> Result<Sequence, Damaged> {
        let name = self.name()?;
        let n = self.within("n", AXES, MAX_COUNT)?;
        let row_count = self.within("rows of A", 0, MAX_COUNT)?;
        let count = self.within("ticks", 1, usize::MAX)?;
        let varying = self.within("hvar", 0, 1)? == 1;
        self.within("Np", 1, usize::MAX)?;
        self.within("Nc", 1, usize::MAX)?;
        self.within("inputs", AXES, AXES)?;
        let laguerre = self.within("lagN", 0, n)?;
        self.numbers("Ts, w, pole", 5, false)?;
        let a = self.numbers("A", row_count * n, false)?;
        let rows = DMatrix::from_row_slice(row_count, n, &a);
        let mut sequence =
            Sequence { name, varying, laguerre, rows, constants: Vec::new(), ticks: Vec::new() };
        for tick in 0..count {
            if varying || tick == 0 {
                sequence.constants.push(self.constants(n)?);
            }
            sequence.ticks.push(self.tick(n, row_count)?);
        }
        Ok(sequence)
    }

    fn constants(&mut self, n: usize) -> Result<Constants, Damaged> {
        self.numbers("model", 36 + 18, false)?;
        self.numbers("umin, umax", 2 * AXES, true)?;
        let rate_bound = self.positive("dmax", AXES)?;
        let scale = self.positive("S", n)?;
        let hessian = DMatrix::from_row_slice(n, n, &self.numbers("H", n * n, false)?);
        let (box_lower, box_upper) = (self.bounds("lb", n)?, self.bounds("ub", n)?);
        Ok(Constants {
            rate_bound: [rate_bound[0], rate_bound[1], rate_bound[2]],
            scale,
            hessian,
            box_lower,
            box_upper,
        })
    }

    fn positive(&mut self, what: &str, count: usize) -> Result<DVector<f64>, Damaged> {
        let at = self.at;
        let values = self.vector(what, count)?;
        match values.iter().position(|value| *value <= 0.0) {
            Some(i) => Err(self.damaged_at(at + 8 * i, format!("{what}[{i}] is not positive"))),
            None => Ok(values),
        }
    }

    fn tick(&mut self, n: usize, row_count: usize) -> Result<Tick, Damaged> {
        self.numbers("dx, y, ref, uprev", 6 + 3 * AXES, false)?;
        let f = self.vector("f", n)?;
        let (lower, upper) = (self.bounds("lbA", row_count)?, self.bounds("ubA", row_count)?);
        let x = self.vector("x", n)?;
        let at = self.at;
        let sides: Vec<i8> =
            self.take(n + row_count)?.iter().map(|byte| i8::from_le_bytes([*byte])).collect();
        if let Some(i) = sides.iter().position(|side| !(-1..=1).contains(side)) {
            return Err(self.damaged_at(at + i, format!("act[{i}] = {} is no side", sides[i])));
        }
        self.pad()?;
        Ok(Tick { f, lower, upper, x, sides })
    }
}
