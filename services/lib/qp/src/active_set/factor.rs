//! The factor of a working set: L D L' of the rows' Gram matrix, compliance on its diagonal.
//!
//! A row is appended at the end and taken out anywhere. Both leave a factor that depends on the
//! way there; `settle` marks what does not, and `rebuild` of the caller redoes the rest.

use crate::linear::{axpy, dot};

/// A working set in the order of its factor, in memory of the caller.
#[derive(Debug)]
pub(super) struct Factor<'a> {
    /// Rows in the working set, and how many of them stand as a rebuilt factor would have them.
    pub(super) count: &'a mut usize,
    pub(super) clean: &'a mut usize,
    pub(super) order: &'a mut [u32],
    /// L by rows, `most` numbers each, without the unit diagonal.
    pub(super) l: &'a mut [f64],
    pub(super) most: usize,
    /// D and its inverse.
    pub(super) d: &'a mut [f64],
    pub(super) inverse: &'a mut [f64],
}

impl Factor<'_> {
    pub(super) fn rows(&self) -> &[u32] {
        &self.order[..*self.count]
    }

    /// y <- L⁻¹ y.
    fn forward(&self, y: &mut [f64]) {
        for i in 1..y.len() {
            let (done, rest) = y.split_at_mut(i);
            rest[0] -= dot(&self.l[i * self.most..][..i], done);
        }
    }

    /// b <- L'⁻¹ D⁻¹ b.
    fn backward(&self, b: &mut [f64]) {
        for (b, inverse) in b.iter_mut().zip(self.inverse.iter()) {
            *b *= inverse;
        }
        for i in (1..b.len()).rev() {
            let (before, rest) = b.split_at_mut(i);
            axpy(-rest[0], &self.l[i * self.most..][..i], before);
        }
    }

    /// b <- (L D L')⁻¹ b.
    pub(super) fn solve(&self, b: &mut [f64]) {
        self.forward(b);
        self.backward(b);
    }

    /// Turns the products of a row with the working rows into `y` = L⁻¹ of them and `ratio`, how
    /// much of each working row it contains; returns the pivot it would have.
    pub(super) fn project(&self, own: f64, y: &mut [f64], ratio: &mut [f64]) -> f64 {
        self.forward(y);
        let mut pivot = own;
        for ((ratio, y), inverse) in ratio.iter_mut().zip(y.iter()).zip(self.inverse.iter()) {
            *ratio = *y;
            pivot -= y * y * inverse;
        }
        self.backward(ratio);
        pivot
    }

    /// Appends the row last projected.
    pub(super) fn push(&mut self, row: u32, pivot: f64, y: &[f64]) {
        let k = *self.count;
        let target = &mut self.l[k * self.most..][..k];
        for ((entry, y), inverse) in target.iter_mut().zip(y).zip(self.inverse.iter()) {
            *entry = y * inverse;
        }
        self.order[k] = row;
        self.d[k] = pivot;
        self.inverse[k] = 1.0 / pivot;
        if *self.clean == k && self.order[..k].last().is_none_or(|last| *last < row) {
            *self.clean += 1;
        }
        *self.count += 1;
    }

    /// Takes out the row at `position` (Gill, Golub, Murray and Saunders, 1974, method C1).
    /// `w` and `beta` are scratch for as many numbers as there are rows.
    pub(super) fn remove(&mut self, position: usize, w: &mut [f64], beta: &mut [f64]) {
        let count = *self.count;
        let mut alpha = self.d[position];
        for i in position + 1..count {
            let (above, row) = self.l[(i - 1) * self.most..].split_at_mut(self.most);
            let mut own = row[position];
            above[..position].copy_from_slice(&row[..position]);
            let pairs = w[position..].iter().zip(&beta[position..]);
            let entries = above[position..i - 1].iter_mut().zip(&row[position + 1..i]);
            for ((target, entry), (w, beta)) in entries.zip(pairs) {
                own -= w * entry;
                *target = entry + beta * own;
            }
            let old = self.d[i];
            let new = old + alpha * own * own;
            w[i - 1] = own;
            beta[i - 1] = alpha * own / new;
            alpha *= old / new;
            self.d[i - 1] = new;
            self.inverse[i - 1] = 1.0 / new;
            self.order[i - 1] = self.order[i];
        }
        *self.clean = (*self.clean).min(position);
        *self.count = count - 1;
    }

    /// Sorts the working set and forgets the factor behind its clean part. Returns the first
    /// position to rebuild and the position behind the last.
    pub(super) fn settle(&mut self) -> (usize, usize) {
        let count = *self.count;
        if let Some(least) = self.order[*self.clean..count].iter().min() {
            let keep = self.order[..*self.clean].iter().take_while(|row| *row < least).count();
            self.order[keep..count].sort_unstable();
            *self.clean = keep;
        }
        *self.count = *self.clean;
        (*self.clean, count)
    }
}
