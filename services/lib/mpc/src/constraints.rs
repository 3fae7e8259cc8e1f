//! Bounds (12)-(14) on level and increment, as rows `lower <= A ΔU <= upper`.
//!
//! Rows 0..NU Nc are the levels, prefix sums of ΔU as in (13). The first of them has the same
//! normal as the first increment row of (12), so the two are one row with the tighter bounds, and
//! the increment rows NU Nc.. start with the second move.

use nalgebra::{DMatrix, DVector, SVector};

/// Bounds on u and Δu, the same over the whole horizon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds<const NU: usize> {
    /// Least u.
    pub u_min: SVector<f64, NU>,
    /// Largest u.
    pub u_max: SVector<f64, NU>,
    /// Largest |Δu| of one sample, >= 0.
    pub du_max: SVector<f64, NU>,
}

impl<const NU: usize> Bounds<NU> {
    /// |u| <= `u_max` and |Δu| <= `du_max`.
    #[must_use]
    pub fn symmetric(u_max: SVector<f64, NU>, du_max: SVector<f64, NU>) -> Self {
        Self { u_min: -u_max, u_max, du_max }
    }

    /// No NaN, no crossed bounds, zero allowed as an increment.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        (0..NU).all(|i| self.u_min[i] <= self.u_max[i] && self.du_max[i] >= 0.0)
    }

    /// What the first increment may be after `u_previous`.
    ///
    /// If the level bounds moved away from `u_previous` faster than `du_max` can follow, the
    /// increment bound gives way by exactly the missing amount; else no increment would do.
    #[must_use]
    pub fn first_move(&self, u_previous: &SVector<f64, NU>) -> FirstMove<NU> {
        let level_lower = self.u_min - u_previous;
        let level_upper = self.u_max - u_previous;
        let missing_below = level_lower - self.du_max;
        let missing_above = -level_upper - self.du_max;
        let relaxation = missing_below.sup(&missing_above).sup(&SVector::zeros());
        let reach = self.du_max + relaxation;
        FirstMove {
            // Level bounds last: where reach equals them, they are met to the last bit.
            lower: (-reach).sup(&level_lower).inf(&level_upper),
            upper: reach.inf(&level_upper).sup(&level_lower),
            relaxation,
        }
    }
}

/// Bounds of the first increment, and how far its own bound had to give way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstMove<const NU: usize> {
    /// Least Δu(k).
    pub lower: SVector<f64, NU>,
    /// Largest Δu(k).
    pub upper: SVector<f64, NU>,
    /// Amount added to `du_max`, >= 0 and zero in normal flight.
    pub relaxation: SVector<f64, NU>,
}

impl<const NU: usize> FirstMove<NU> {
    /// The nearest increment within the bounds; a NaN counts as no increment.
    #[must_use]
    pub fn clip(&self, du: &SVector<f64, NU>) -> SVector<f64, NU> {
        let finite = du.map(|du| if du.is_finite() { du } else { 0.0 });
        finite.sup(&self.lower).inf(&self.upper)
    }
}

/// Rows of A for `control` moves of `inputs` inputs.
pub(crate) const fn row_count(inputs: usize, control: usize) -> usize {
    inputs * (2 * control - 1)
}

/// A of the rows above; ΔU is ordered by time, then input.
pub(crate) fn rows(inputs: usize, control: usize) -> DMatrix<f64> {
    let moves = inputs * control;
    DMatrix::from_fn(row_count(inputs, control), moves, |row, column| {
        let active = if row < moves {
            column <= row && (row - column).is_multiple_of(inputs)
        } else {
            column == row - moves + inputs
        };
        f64::from(active)
    })
}

/// Writes the bounds of every row.
pub(crate) fn fill<const NU: usize>(
    bounds: &Bounds<NU>,
    first: &FirstMove<NU>,
    u_previous: &SVector<f64, NU>,
    lower: &mut DVector<f64>,
    upper: &mut DVector<f64>,
) {
    let moves = lower.len().midpoint(NU); // rows = 2 moves - NU
    let (level_lower, level_upper) = (bounds.u_min - u_previous, bounds.u_max - u_previous);
    for row in 0..lower.len() {
        let input = row % NU;
        (lower[row], upper[row]) = if row < NU {
            (first.lower[input], first.upper[input])
        } else if row < moves {
            (level_lower[input], level_upper[input])
        } else {
            (-bounds.du_max[input], bounds.du_max[input])
        };
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Vector1, Vector2};

    use super::*;

    #[test]
    fn the_rows_are_the_levels_and_increments_of_a_played_sequence() {
        let a = rows(2, 3);
        let du = [[1.0, -4.0], [0.25, 8.0], [2.0, 16.0]];
        let stacked = DVector::from_iterator(6, du.iter().flatten().copied());
        let got = a * stacked;
        let expected = [1.0, -4.0, 1.25, 4.0, 3.25, 20.0, 0.25, 8.0, 2.0, 16.0];
        assert_eq!(got.as_slice(), &expected);
    }

    #[test]
    fn the_first_row_carries_the_tighter_of_level_and_increment() {
        let bounds = Bounds::symmetric(Vector2::new(1.0, 1.0), Vector2::new(0.5, 0.5));
        let u = Vector2::new(0.8, -0.2);
        let first = bounds.first_move(&u);
        assert!((first.upper - Vector2::new(0.2, 0.5)).amax() < 1e-15);
        assert!((first.lower - Vector2::new(-0.5, -0.5)).amax() < 1e-15);
        assert_eq!(first.relaxation, Vector2::zeros());
        let (mut lower, mut upper) = (DVector::zeros(6), DVector::zeros(6));
        fill(&bounds, &first, &u, &mut lower, &mut upper);
        assert_eq!(lower.as_slice(), &[-0.5, -0.5, -1.8, -0.8, -0.5, -0.5]);
        assert!((upper[2] - 0.2).abs() < 1e-15 && (upper[3] - 1.2).abs() < 1e-15);
    }

    #[test]
    fn a_shrinking_level_bound_relaxes_the_increment_by_the_missing_amount_only() {
        let bounds = Bounds::symmetric(Vector1::new(0.25), Vector1::new(0.125));
        let cases = [(0.3125, 0.0), (0.375, 0.0), (0.5, 0.125), (-1.0, 0.625)];
        for (u, missing) in cases {
            let first = bounds.first_move(&Vector1::new(u));
            assert_eq!(first.relaxation[0], missing, "u(k-1) = {u}");
            assert!(first.lower <= first.upper);
            if missing > 0.0 {
                assert_eq!(first.lower, first.upper, "one increment is left");
                assert_eq!((u + first.lower[0]).abs(), 0.25);
            }
        }
    }

    #[test]
    fn clipping_meets_the_bounds_and_takes_nan_as_no_move() {
        let bounds = Bounds::symmetric(Vector2::new(1.0, 1.0), Vector2::new(0.5, 0.5));
        let first = bounds.first_move(&Vector2::new(0.0, 0.9));
        let clipped = first.clip(&Vector2::new(-7.0, f64::NAN));
        assert_eq!(clipped, Vector2::new(-0.5, 0.0));
    }
}
