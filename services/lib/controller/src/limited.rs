//! An input within the bounds on its level and on its increment, (12)-(14), by clipping.

use nalgebra::Vector3;
use shared_types::{BoundedInput, SolveReport, SolveStatus};

/// What is left of a wish, with the bounds it keeps to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limited {
    /// u(k).
    pub input: Vector3<f64>,
    /// u(k−1).
    pub previous: Vector3<f64>,
    /// Least u(k).
    pub min: Vector3<f64>,
    /// Largest u(k).
    pub max: Vector3<f64>,
    /// Bound on |Δu(k)|, relaxation included.
    pub increment: Vector3<f64>,
    /// Part of it that is relaxation: where u(k−1) is so far outside that no increment leads back.
    pub relaxation: Vector3<f64>,
    /// Inputs that are not as wished.
    pub clipped: u32,
}

impl Limited {
    /// Brings `wish` within `min..=max` and within `step` of `previous`; of two bounds that exclude
    /// one another the level holds.
    #[must_use]
    pub fn new(
        wish: &Vector3<f64>,
        previous: &Vector3<f64>,
        [min, max]: [&Vector3<f64>; 2],
        step: &Vector3<f64>,
    ) -> Self {
        let near = wish.sup(&(previous - step)).inf(&(previous + step));
        let input = near.sup(min).inf(max);
        let relaxation = ((input - previous).abs() - step).sup(&Vector3::zeros());
        let clipped = (0..3).map(|i| u32::from(input[i].to_bits() != wish[i].to_bits())).sum();
        let (previous, min, max) = (*previous, *min, *max);
        Self { input, previous, min, max, increment: step + relaxation, relaxation, clipped }
    }

    /// The input that is held because a sample could not be used.
    #[must_use]
    pub fn held(input: &Vector3<f64>) -> Self {
        let zero = Vector3::zeros();
        let (input, previous, min, max) = (*input, *input, *input, *input);
        Self { input, previous, min, max, increment: zero, relaxation: zero, clipped: 0 }
    }

    /// As a report has it.
    #[must_use]
    pub fn bounded(&self) -> BoundedInput {
        BoundedInput {
            input: self.input.into(),
            previous: self.previous.into(),
            min: self.min.into(),
            max: self.max.into(),
            increment_max: self.increment.into(),
            relaxation: self.relaxation.into(),
        }
    }

    /// Verdict and effort of a law without an optimiser, which so far refused as many steps.
    #[must_use]
    pub fn solve(&self, is_new: bool, refused: u64) -> SolveReport {
        let status = if is_new { SolveStatus::Solved } else { SolveStatus::Refused };
        let active_constraints = self.clipped.into();
        SolveReport { refused, active_constraints, status, ..SolveReport::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limit(wish: f64, previous: f64) -> Limited {
        let of = Vector3::repeat;
        Limited::new(&of(wish), &of(previous), [&of(-1.0), &of(2.0)], &of(0.5))
    }

    #[test]
    fn a_wish_within_its_bounds_is_granted_bit_for_bit() {
        let limited = limit(0.1 + 0.2, 0.3);
        assert_eq!((limited.input.x, limited.clipped), (0.1 + 0.2, 0));
        assert_eq!(limited.relaxation, Vector3::zeros());
    }

    #[test]
    fn an_increment_is_cut_a_level_is_cut_and_of_both_the_level_holds() {
        assert_eq!(limit(9.0, 0.0).input.x, 0.5);
        assert_eq!(limit(-9.0, 0.0).input.x, -0.5);
        assert_eq!(limit(9.0, 1.75).input.x, 2.0);
        let outside = limit(9.0, 3.0);
        assert_eq!((outside.input.x, outside.relaxation.x), (2.0, 0.5));
        for (wish, previous) in [(9.0, 0.0), (9.0, 1.75), (9.0, 3.0), (-9.0, -7.0), (0.1, 0.2)] {
            let report = limit(wish, previous).bounded();
            assert!(report.worst_violation() <= 0.0, "{wish} after {previous}");
        }
    }
}
