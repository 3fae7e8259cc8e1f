//! Whether a solution keeps its rows as exactly as is promised, which is looked at after every whole solve by the fast
//! methods.

use super::ActiveSet;
use crate::kkt::Size;

impl ActiveSet {
    /// True if every row keeps its bounds, and a working one its own, as exactly as is promised.
    pub(super) fn keeps_rows(&mut self, f: &[f64], bounds: (&[f64], &[f64])) -> bool {
        let (n, x) = (self.x.len(), self.x.as_slice());
        products(self.rows.as_slice(), x, &mut self.values);
        let mut size = None;
        (0..self.values.len()).all(|i| {
            let value = self.values[i] - self.compliance[i] * self.multipliers[i];
            // Most rows: within their bounds, so that nothing has to be allowed for.
            if self.set[i] == 0 && bounds.0[i] <= value && value <= bounds.1[i] {
                return true;
            }
            let size = *size.get_or_insert_with(|| self.size(f));
            let row = &self.rows.as_slice()[i * n..][..n];
            self.keeps_row((i, row), value, size, [bounds.0[i], bounds.1[i]])
        })
    }

    /// Size of the solution, in the units of the blocks.
    fn size(&self, f: &[f64]) -> Size {
        let mut size = Size::default();
        for ((x, f), unit) in self.x.iter().zip(f).zip(&self.blocks.units) {
            size.take(*x, *f, 1.0 / unit);
        }
        size
    }

    /// True if one row does, whose value is `value`.
    fn keeps_row(
        &self,
        (i, row): (usize, &[f64]),
        value: f64,
        size: Size,
        [lower, upper]: [f64; 2],
    ) -> bool {
        let (mut terms, mut reach) = (0.0, 0.0);
        for ((a, x), unit) in row.iter().zip(&self.x).zip(&self.blocks.units) {
            terms += (a * x).abs();
            reach += a.abs() / unit;
        }
        let room = |bound: f64| 0.5 * self.tolerance * size.span(bound, terms, reach);
        let kept = |miss: f64, bound: f64| bound.is_infinite() || miss <= room(bound);
        let held = match self.set[i] {
            0 => true,
            side => {
                let bound = if side < 0 { lower } else { upper };
                kept((value - bound).abs(), bound)
            }
        };
        held && kept(lower - value, lower) && kept(value - upper, upper)
    }
}

/// Products of the rows, one after the other in `rows`, with `x`. Each is summed in the order of `x`, and four of them side
/// by side, since each addition has to wait for the one before it.
fn products(rows: &[f64], x: &[f64], values: &mut [f64]) {
    let n = x.len();
    let mut fours = values.chunks_exact_mut(4);
    let mut rows = rows.chunks_exact(4 * n);
    for (four, values) in rows.by_ref().zip(fours.by_ref()) {
        let ((a, b), (c, d)) = {
            let (first, last) = four.split_at(2 * n);
            (first.split_at(n), last.split_at(n))
        };
        let mut sums = [0.0; 4];
        for ((((x, a), b), c), d) in x.iter().zip(a).zip(b).zip(c).zip(d) {
            for (sum, entry) in sums.iter_mut().zip([a, b, c, d]) {
                *sum += entry * x;
            }
        }
        values.copy_from_slice(&sums);
    }
    for (row, value) in rows.remainder().chunks_exact(n).zip(fours.into_remainder()) {
        *value = row.iter().zip(x).fold(0.0, |sum, (a, x)| sum + a * x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_each_row_alone_to_the_last_bit() {
        for (n, m) in [(1, 0), (1, 1), (3, 4), (5, 7), (18, 13)] {
            let number = |i: usize| libm::sin(0.7 + 1.3 * i as f64);
            let rows: Vec<f64> = (0..n * m).map(number).collect();
            let x: Vec<f64> = (0..n).map(|i| number(1000 + i)).collect();
            let mut values = vec![0.0; m];
            products(&rows, &x, &mut values);
            for (row, value) in rows.chunks_exact(n).zip(&values) {
                let alone = row.iter().zip(&x).fold(0.0, |sum, (a, x)| sum + a * x);
                assert_eq!(alone.to_bits(), value.to_bits());
            }
        }
    }
}
