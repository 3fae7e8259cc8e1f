//! Numbers read from a trajectory, each as the paper reads them.

use super::rig::Trajectory;
use nalgebra::Vector3;

/// Half width of the band that counts as recovered \[rad\].
pub const BAND_RAD: f64 = 0.004;

type Path<'a> = &'a [(f64, Vector3<f64>)];

/// First time at which `axis` reaches `target` from below \[s\], linear between points; none if it
/// never does.
#[must_use]
pub fn crossing_s(path: Path, axis: usize, target: f64) -> Option<f64> {
    path.windows(2).find_map(|pair| {
        let [(from_s, from), (to_s, to)] = [pair[0], pair[1]];
        let (a, b) = (from[axis], to[axis]);
        (a < target && b >= target).then(|| from_s + (to_s - from_s) * (target - a) / (b - a))
    })
}

/// Largest angle of `axis` \[rad\].
#[must_use]
pub fn peak_rad(path: Path, axis: usize) -> f64 {
    path.iter().map(|(_, gamma)| gamma[axis]).fold(f64::NEG_INFINITY, f64::max)
}

/// How far the peak lies beyond the target, in percent of the target.
#[must_use]
pub fn overshoot_percent(path: Path, axis: usize, target: f64) -> f64 {
    100.0 * (peak_rad(path, axis) / target - 1.0)
}

/// Largest distance from `target` on `axis` at or after `from_s` \[rad\].
#[must_use]
pub fn deviation_rad(path: Path, axis: usize, target: f64, from_s: f64) -> f64 {
    let after = path.iter().filter(|(t_s, _)| *t_s >= from_s - 1e-9);
    after.map(|(_, gamma)| (gamma[axis] - target).abs()).fold(0.0, f64::max)
}

/// From `from_s` until every axis stays within ±[`BAND_RAD`] of the target \[s\]: at the first
/// point after the last one outside. None if the last point is outside.
#[must_use]
pub fn recovery_s(path: Path, target: &Vector3<f64>, from_s: f64) -> Option<f64> {
    let outside = |(t_s, gamma): &(f64, Vector3<f64>)| {
        *t_s >= from_s - 1e-9 && (gamma - target).amax() > BAND_RAD
    };
    match path.iter().rposition(outside) {
        None => Some(0.0),
        Some(last) => path.get(last + 1).map(|(t_s, _)| t_s - from_s),
    }
}

/// How far u or Δu ever lay beyond its bound \[N m\]; negative if always inside.
#[must_use]
pub fn excess_nm(trajectory: &Trajectory) -> f64 {
    trajectory.samples.iter().map(super::rig::Sample::excess_nm).fold(f64::NEG_INFINITY, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Vec<(f64, Vector3<f64>)> {
        [0.0, 0.1, 0.3, 0.2]
            .iter()
            .zip(0..4)
            .map(|(y, k)| (f64::from(k), Vector3::repeat(*y)))
            .collect()
    }

    #[test]
    fn a_crossing_lies_between_its_points_and_a_peak_on_one() {
        assert!((crossing_s(&ramp(), 0, 0.15).unwrap() - 1.25).abs() < 1e-12);
        assert_eq!(crossing_s(&ramp(), 0, 0.4), None);
        assert!((overshoot_percent(&ramp(), 1, 0.2) - 50.0).abs() < 1e-12);
        assert!((deviation_rad(&ramp(), 2, 0.2, 3.0)).abs() < 1e-12);
    }

    #[test]
    fn recovery_counts_from_the_blow_to_the_first_point_that_stays_inside() {
        assert_eq!(recovery_s(&ramp(), &Vector3::repeat(0.2), 1.0), Some(2.0));
        assert_eq!(recovery_s(&ramp(), &Vector3::repeat(0.5), 1.0), None);
        assert_eq!(recovery_s(&ramp(), &Vector3::repeat(0.2), 3.0), Some(0.0));
    }
}
