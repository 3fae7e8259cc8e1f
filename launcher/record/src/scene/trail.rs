//! Where something has been.

use std::collections::VecDeque;

/// Between two points \[ns\].
const SPACING_NS: u64 = 100_000_000;
/// Twenty seconds of them.
const POINTS: usize = 200;

/// The last points of a path.
#[derive(Debug, Default)]
pub(super) struct Trail {
    points: VecDeque<[f64; 3]>,
    last: Option<u64>,
}

impl Trail {
    /// Adds a position \[m\], if it is the first in a while.
    pub(super) fn add(&mut self, release_ns: u64, position_w_m: [f64; 3]) {
        let period = Some(release_ns / SPACING_NS);
        if core::mem::replace(&mut self.last, period) == period {
            return;
        }
        if self.points.len() == POINTS {
            self.points.pop_front();
        }
        self.points.push_back(position_w_m);
    }

    pub(super) fn points(&self) -> impl Iterator<Item = [f64; 3]> {
        self.points.iter().copied()
    }
}
