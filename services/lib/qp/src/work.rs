//! The work of a solve, counted and bounded.

use core::cell::Cell;

/// Multiply-adds that a solve may still take, nearly: those of its inner loops are counted.
///
/// What was done in an earlier solve and is still known counts as if it were done again, so that a
/// solver that was restored comes to the same end.
#[derive(Debug, Clone)]
pub(crate) struct Work {
    left: Cell<u64>,
    /// Some part of the solve was left off.
    cut: Cell<bool>,
}

impl Work {
    pub(crate) fn new(most: u64) -> Self {
        Self { left: Cell::new(most), cut: Cell::new(false) }
    }

    pub(crate) fn spend(&self, products: usize) {
        self.left.set(self.left.get().saturating_sub(products as u64));
    }

    pub(crate) fn left(&self) -> u64 {
        self.left.get()
    }

    /// True if nothing is left; something is then left off.
    pub(crate) fn runs_out(&self) -> bool {
        let out = self.left.get() == 0;
        self.cut.set(self.cut.get() || out);
        out
    }

    /// True if something was left off.
    pub(crate) fn was_cut(&self) -> bool {
        self.cut.get()
    }
}
