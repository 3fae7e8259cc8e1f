//! Affine functions of parameters in [-1, 1], and polytopes cut out of that box.

use super::lp::{self, Half, WIDEST};

/// Comparisons that are closer than this, relative to their range, may go either way.
const CLOSE: f64 = 1e-10;
/// Deeper than any point of the box can be inside or outside of what is worth a look.
const DEEPEST: f64 = 1e3;

/// slope' t + constant.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line {
    pub(super) slope: Vec<f64>,
    pub(super) constant: f64,
}

impl Line {
    pub(super) fn zero(parameters: usize) -> Self {
        Self { slope: vec![0.0; parameters], constant: 0.0 }
    }

    /// self + by * other.
    pub(super) fn plus(mut self, by: f64, other: &Self) -> Self {
        self.constant += by * other.constant;
        for (own, other) in self.slope.iter_mut().zip(&other.slope) {
            *own += by * other;
        }
        self
    }

    pub(super) fn minus(&self, other: &Self) -> Self {
        self.clone().plus(-1.0, other)
    }

    pub(super) fn times(&self, by: f64) -> Self {
        Self::zero(self.slope.len()).plus(by, self)
    }

    pub(super) fn at(&self, t: &[f64]) -> f64 {
        self.slope.iter().zip(t).fold(self.constant, |sum, (slope, t)| sum + slope * t)
    }

    /// The largest change over the box, to either side.
    pub(super) fn swing(&self) -> f64 {
        self.slope.iter().map(|slope| slope.abs()).sum()
    }
}

/// The parameters of the unit box at which all `cuts` are at most zero; never empty.
#[derive(Debug, Clone)]
pub(super) struct Region {
    cuts: Vec<Line>,
    /// One of them.
    pub(super) witness: Vec<f64>,
}

impl Region {
    pub(super) fn all(parameters: usize) -> Self {
        Self { cuts: Vec::new(), witness: vec![0.0; parameters] }
    }

    /// The part in which all `lines` are at most zero, or nothing.
    pub(super) fn where_not_positive(&self, lines: &[Line]) -> Option<Self> {
        let mut part = self.clone();
        let mut holds = true;
        for line in lines {
            let swing = line.swing();
            if line.constant - swing > CLOSE * swing {
                return None;
            }
            if line.constant + swing <= 0.0 {
                continue;
            }
            holds &= line.at(&part.witness) <= 0.0;
            part.cuts.push(line.clone());
        }
        if holds { Some(part) } else { part.find() }
    }

    /// Looks for a witness: the point that is deepest inside, or nothing if even that is outside.
    fn find(mut self) -> Option<Self> {
        let d = self.witness.len();
        // The last variable is the depth.
        let half = |line: &Line| {
            let length = line.slope.iter().fold(0.0, |sum, slope| sum + slope * slope).sqrt();
            let mut normal = [0.0; WIDEST];
            for (entry, slope) in normal.iter_mut().zip(&line.slope) {
                *entry = slope / length;
            }
            normal[d] = 1.0;
            Half { normal, bound: -line.constant / length }
        };
        // The latest cuts decide most often.
        let halves: Vec<Half> = self.cuts.iter().rev().map(half).collect();
        let (mut aim, mut size) = ([0.0; WIDEST], [1.0; WIDEST]);
        (aim[d], size[d]) = (1.0, DEEPEST);
        let deepest = lp::largest(&halves, d + 1, &aim, &size)?;
        if deepest[d] < -CLOSE {
            return None;
        }
        self.witness.copy_from_slice(&deepest[..d]);
        Some(self)
    }
}
