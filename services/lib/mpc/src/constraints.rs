//! Bounds (12)-(14), and what the first move may be under them.

use nalgebra::SVector;

/// Difference of a level from its bound, relative to it, that is the solver's rounding.
const ROUNDING: f64 = 1e-10;

/// Bounds on u and Δu at one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds<const N: usize> {
    /// Least u.
    pub u_min: SVector<f64, N>,
    /// Largest u.
    pub u_max: SVector<f64, N>,
    /// Largest |Δu| of one sample, >= 0.
    pub du_max: SVector<f64, N>,
}

impl<const N: usize> Bounds<N> {
    /// |u| <= `u_max` and |Δu| <= `du_max`.
    #[must_use]
    pub fn symmetric(u_max: SVector<f64, N>, du_max: SVector<f64, N>) -> Self {
        Self { u_min: -u_max, u_max, du_max }
    }

    /// No NaN, no crossed bounds, zero allowed as an increment.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        (0..N).all(|i| self.u_min[i] <= self.u_max[i] && self.du_max[i] >= 0.0)
    }

    /// `u`, or the bound on it where they differ by rounding only: a level that the last solve brought to its bound would
    /// otherwise leave room of some 1e-15 in each of many rows, where their exact number is zero and all of them meet in
    /// one point. Double precision cannot resolve what is optimal within such room.
    pub(crate) fn with_rounding_taken_off(&self, u: &SVector<f64, N>) -> SVector<f64, N> {
        u.zip_zip_map(&self.u_min, &self.u_max, |u, least, most| {
            let is_at =
                |bound: f64| (u - bound).abs() <= ROUNDING * bound.abs() && bound.is_finite();
            if is_at(least) {
                least
            } else if is_at(most) {
                most
            } else {
                u
            }
        })
    }

    /// How much more than `du_max` an input needs that followed the bounds of the sample before.
    pub(crate) fn missing_since(&self, before: &Self, i: usize) -> f64 {
        let shrunk = (self.u_min[i] - before.u_min[i]).max(before.u_max[i] - self.u_max[i]);
        (shrunk - self.du_max[i]).max(0.0)
    }
}

/// `lower <= n'u <= upper` for each of a law's rows n.
#[derive(Debug, Clone, Copy)]
pub struct Coupled<'a, const N: usize> {
    /// The rows n.
    pub normals: &'a [[f64; N]],
    /// Least n'u of each row, <= 0: no input at all must be admissible.
    pub lower: &'a [f64],
    /// Largest n'u of each row, >= 0.
    pub upper: &'a [f64],
}

impl<const N: usize> Coupled<'_, N> {
    /// No rows.
    pub const NONE: Self = Self { normals: &[], lower: &[], upper: &[] };

    /// Largest share in 0..=1 of the way from `from`, which is admissible, to `to`.
    fn share(&self, from: &SVector<f64, N>, to: &SVector<f64, N>) -> f64 {
        let rows = self.normals.iter().zip(self.lower.iter().zip(self.upper));
        let share = rows.fold(1.0_f64, |share, (normal, (&lower, &upper))| {
            let (start, end) = (along(normal, from), along(normal, to));
            let limit = if end > upper {
                (upper - start) / (end - start)
            } else if end < lower {
                (lower - start) / (end - start)
            } else {
                1.0
            };
            share.min(limit)
        });
        if share.is_finite() { share.max(0.0) } else { 0.0 }
    }

    /// As much of the way from `from`, which is admissible, to `to` as the rows leave, in the inputs that they have.
    fn towards(&self, from: &SVector<f64, N>, to: &SVector<f64, N>) -> SVector<f64, N> {
        let share = self.share(from, to);
        let has = |i: usize| self.normals.iter().any(|normal| normal[i].abs() > 0.0);
        SVector::from_fn(|i, _| {
            if share < 1.0 && has(i) { from[i] + (to[i] - from[i]) * share } else { to[i] }
        })
    }

    /// How far `u` leaves the rows; 0 inside.
    pub(crate) fn excess(&self, u: &SVector<f64, N>) -> f64 {
        let rows = self.normals.iter().zip(self.lower.iter().zip(self.upper));
        rows.fold(0.0_f64, |excess, (normal, (&lower, &upper))| {
            let value = along(normal, u);
            excess.max(lower - value).max(value - upper)
        })
    }
}

fn along<const N: usize>(normal: &[f64; N], u: &SVector<f64, N>) -> f64 {
    normal.iter().zip(u).map(|(n, u)| n * u).sum()
}

/// What the first increment may be, and how far its own bound had to give way for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstMove<const N: usize> {
    /// Least Δu(k).
    pub lower: SVector<f64, N>,
    /// Largest Δu(k).
    pub upper: SVector<f64, N>,
    /// Amount added to `du_max`, >= 0 and zero in normal flight.
    pub relaxation: SVector<f64, N>,
    /// The admissible level that was u(k−1), or what is left of it.
    anchor: SVector<f64, N>,
}

impl<const N: usize> FirstMove<N> {
    /// After `u_previous` under `bounds` and `coupled`.
    ///
    /// If the bounds on the level moved away from `u_previous` faster than `du_max` can follow,
    /// the increment bound gives way by exactly the missing amount; else no increment would do.
    /// Boxes alone are followed input by input; with coupled rows the inputs that they have shrink towards
    /// none at all, which they always admit.
    pub(crate) fn new(
        bounds: &Bounds<N>,
        coupled: &Coupled<'_, N>,
        u_previous: &SVector<f64, N>,
    ) -> Self {
        let boxed = u_previous.sup(&bounds.u_min).inf(&bounds.u_max);
        let anchor = coupled.towards(&SVector::zeros(), &boxed);
        let needed = (anchor - u_previous).abs();
        let relaxation = (needed - bounds.du_max).sup(&SVector::zeros());
        let reach = bounds.du_max + relaxation;
        let level_lower = bounds.u_min - u_previous;
        let level_upper = bounds.u_max - u_previous;
        Self {
            // Level bounds last: where reach equals them, they are met to the last bit.
            lower: (-reach).sup(&level_lower).inf(&level_upper),
            upper: reach.inf(&level_upper).sup(&level_lower),
            relaxation,
            anchor,
        }
    }

    /// u(k) for the increment `du`: the nearest one in the box, then as much of the way to it from
    /// the admissible level as the coupled rows leave. A NaN counts as no increment.
    pub(crate) fn level(
        &self,
        du: &SVector<f64, N>,
        u_previous: &SVector<f64, N>,
        coupled: &Coupled<'_, N>,
    ) -> SVector<f64, N> {
        let finite = du.map(|du| if du.is_finite() { du } else { 0.0 });
        let wanted = u_previous + finite.sup(&self.lower).inf(&self.upper);
        coupled.towards(&self.anchor, &wanted)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Vector1, Vector2, Vector3};

    use super::*;

    const DIAMOND: Coupled<'_, 2> =
        Coupled { normals: &[[1.0, 1.0], [1.0, -1.0]], lower: &[-1.0; 2], upper: &[1.0; 2] };

    fn first<const N: usize>(bounds: &Bounds<N>, u: &SVector<f64, N>) -> FirstMove<N> {
        FirstMove::new(bounds, &Coupled::NONE, u)
    }

    #[test]
    fn the_first_move_keeps_the_tighter_of_level_and_increment() {
        let bounds = Bounds::symmetric(Vector2::new(1.0, 1.0), Vector2::new(0.5, 0.5));
        let first = first(&bounds, &Vector2::new(0.8, -0.2));
        assert!((first.upper - Vector2::new(0.2, 0.5)).amax() < 1e-15);
        assert!((first.lower - Vector2::new(-0.5, -0.5)).amax() < 1e-15);
        assert_eq!(first.relaxation, Vector2::zeros());
    }

    #[test]
    fn a_shrinking_level_bound_relaxes_the_increment_by_the_missing_amount_only() {
        let bounds = Bounds::symmetric(Vector1::new(0.25), Vector1::new(0.125));
        let cases = [(0.3125, 0.0), (0.375, 0.0), (0.5, 0.125), (-1.0, 0.625)];
        for (u, missing) in cases {
            let first = first(&bounds, &Vector1::new(u));
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
        let u = Vector2::new(0.0, 0.9);
        let level = first(&bounds, &u).level(&Vector2::new(-7.0, f64::NAN), &u, &Coupled::NONE);
        assert_eq!(level, Vector2::new(-0.5, 0.9));
    }

    #[test]
    fn a_level_within_rounding_of_its_bound_is_at_it() {
        let (u_min, u_max) =
            (Vector3::new(-0.35, 0.0, 0.3), Vector3::new(0.35, f64::INFINITY, 2.0));
        let bounds = Bounds { u_min, u_max, du_max: Vector3::repeat(0.1) };
        let taken = |u: [f64; 3]| bounds.with_rounding_taken_off(&Vector3::from(u));
        assert_eq!(taken([-0.35 + 4e-15, 1.0, 2.0 + 9e-15]), Vector3::new(-0.35, 1.0, 2.0));
        let others = [[0.35 - 1e-9, 1e-15, 0.3 + 1e-9], [0.0, f64::INFINITY, 5.0]];
        for other in others {
            assert_eq!(taken(other), Vector3::from(other));
        }
    }

    #[test]
    fn a_level_outside_the_coupled_rows_shrinks_to_zero_and_the_increment_gives_way() {
        let bounds = Bounds::symmetric(Vector2::repeat(9.0), Vector2::repeat(0.25));
        let u = Vector2::new(1.5, 0.5);
        let first = FirstMove::new(&bounds, &DIAMOND, &u);
        // Half of it is on the edge.
        assert!((first.relaxation - Vector2::new(0.5, 0.0)).amax() < 1e-15);
        let wishes = [Vector2::zeros(), Vector2::new(5.0, 5.0), Vector2::new(-0.7, 0.2)];
        for du in wishes {
            let level = first.level(&du, &u, &DIAMOND);
            assert!(DIAMOND.excess(&level) < 1e-15, "{level}");
            let excess = (level - u).abs() - bounds.du_max - first.relaxation;
            assert!(excess.max() < 1e-15, "{level}");
        }
    }
}
