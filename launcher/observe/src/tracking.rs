//! How far the vehicle was from its reference.

use super::course_bins::Off;
use super::evidence::Evidence;
use ::verdict::worst;
use shared_types::{Reference, Truth};
use std::collections::VecDeque;
use vehicle::{euler_from_quaternion, rotation, wrap_pi};

/// Poses that wait for their reference.
const WAITING_CAPACITY: usize = 1 << 16;

/// Position error against the reference.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tracking {
    /// Truth samples compared.
    pub samples: u64,
    /// Root mean square over the flight \[m\].
    pub rms_m: f64,
    /// Largest \[m\].
    pub max_m: f64,
    /// Mean over the last second \[m\].
    pub last_second_m: f64,
}

/// Where the vehicle was beside where it was to be at that instant, in whatever order both come.
#[derive(Debug, Clone, Default)]
pub struct Course {
    references: VecDeque<Reference>,
    waiting: VecDeque<Pose>,
}

/// Where the vehicle was, and where it pointed.
#[derive(Debug, Clone, Copy)]
struct Pose {
    t_ns: u64,
    position_w_m: [f64; 3],
    yaw_rad: f64,
}

/// A pose and the reference in effect at its instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Logical instant \[ns\].
    pub t_ns: u64,
    /// Where the vehicle was \[m\].
    pub was_w_m: [f64; 3],
    /// Where it was to be \[m\].
    pub wanted_w_m: [f64; 3],
    /// How far its heading was counter-clockwise of where it was to point, from −π to π \[rad\].
    pub turned_rad: f64,
}

impl Course {
    /// Takes note of where the vehicle is to be.
    pub fn observe_reference(&mut self, reference: &Reference) {
        self.references.push_back(*reference);
    }

    /// Takes note of where it is, and of its heading \[rad\].
    pub fn observe_pose(&mut self, t_ns: u64, position_w_m: [f64; 3], yaw_rad: f64) {
        if self.waiting.len() < WAITING_CAPACITY {
            self.waiting.push_back(Pose { t_ns, position_w_m, yaw_rad });
        }
    }

    /// The next pose whose reference is known; `finished` means that no reference will follow.
    pub fn next(&mut self, finished: bool) -> Option<Point> {
        loop {
            let &Pose { t_ns, position_w_m: was_w_m, yaw_rad } = self.waiting.front()?;
            while self.references.get(1).is_some_and(|r| r.header.valid_ns <= t_ns) {
                self.references.pop_front();
            }
            let settled = self.references.len() > 1 || finished;
            let Some(reference) = self.references.front().filter(|r| r.header.valid_ns <= t_ns)
            else {
                if finished || self.references.front().is_some_and(|r| r.header.valid_ns > t_ns) {
                    self.waiting.pop_front();
                    continue;
                }
                return None;
            };
            if !settled {
                return None;
            }
            let (wanted_w_m, wanted_rad) = reference_at(reference, t_ns);
            self.waiting.pop_front();
            let turned_rad = wrap_pi(yaw_rad - wanted_rad);
            return Some(Point { t_ns, was_w_m, wanted_w_m, turned_rad });
        }
    }
}

/// Sums up how far positions are from their references.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracker {
    course: Course,
    squares: f64,
    tracking: Tracking,
    recent: VecDeque<(u64, f64)>,
}

impl Tracker {
    /// One that knows where the vehicle is to be, and of no error yet.
    pub(super) fn anew(self) -> Self {
        let course = Course { references: self.course.references, waiting: VecDeque::new() };
        Self { course, ..Self::default() }
    }

    /// Takes note of where the vehicle is to be.
    pub(super) fn observe_reference(&mut self, reference: &Reference) {
        self.course.observe_reference(reference);
    }

    /// Takes note of where it is.
    pub(super) fn observe_truth(&mut self, truth: &Truth) {
        let yaw_rad = euler_from_quaternion(&rotation(truth.q_wb.to_array())).z;
        self.course.observe_pose(truth.header.valid_ns, truth.position_w_m, yaw_rad);
    }

    /// Compares waiting truths with the reference in effect at their instant.
    pub(super) fn compare(&mut self, finished: bool, evidence: &mut Evidence) {
        while let Some(point) = self.course.next(finished) {
            let Point { t_ns, was_w_m, wanted_w_m, turned_rad } = point;
            let distance_m = distance(&wanted_w_m, &was_w_m);
            self.add_error(t_ns, distance_m);
            evidence.error(t_ns, Off { distance_m, heading_rad: turned_rad.abs() }, wanted_w_m[2]);
        }
    }

    fn add_error(&mut self, t_ns: u64, error_m: f64) {
        self.tracking.samples += 1;
        self.squares += error_m * error_m;
        self.tracking.max_m = worst(self.tracking.max_m, error_m);
        self.recent.push_back((t_ns, error_m));
        while self.recent.front().is_some_and(|(t, _)| t.saturating_add(1_000_000_000) <= t_ns) {
            self.recent.pop_front();
        }
    }

    /// Closes the comparison at the end of the flight.
    pub(super) fn finish(&mut self, evidence: &mut Evidence) {
        self.compare(true, evidence);
        let samples = self.tracking.samples.max(1) as f64;
        self.tracking.rms_m = (self.squares / samples).sqrt();
        let recent = self.recent.len().max(1) as f64;
        self.tracking.last_second_m = self.recent.iter().map(|(_, e)| e).sum::<f64>() / recent;
    }

    /// What came of it; complete after [`Tracker::finish`].
    pub(super) fn tracking(&self) -> Tracking {
        self.tracking
    }
}

/// Position \[m\] and heading \[rad\] that a reference asks for.
fn reference_at(reference: &Reference, t_ns: u64) -> ([f64; 3], f64) {
    let ahead_ns = t_ns.saturating_sub(reference.header.valid_ns);
    let spacing_ns = reference.spacing_ns.max(1);
    let count = usize::try_from(reference.count).unwrap_or(1).clamp(1, reference.points.len());
    let index = usize::try_from(ahead_ns / spacing_ns).unwrap_or(count).min(count - 1);
    let point = &reference.points[index];
    let rest_ns = ahead_ns.saturating_sub(index as u64 * spacing_ns).min(spacing_ns);
    let rest_s = if index + 1 == count { 0.0 } else { rest_ns as f64 * 1e-9 };
    let next = &reference.points[(index + 1).min(count - 1)];
    let [position, velocity] = [point.position_w_m, point.velocity_w_m_s];
    // The velocity goes over into that of the next point.
    let gained = |i: usize| {
        0.5 * (next.velocity_w_m_s[i] - velocity[i]) * rest_s * rest_s / (spacing_ns as f64 * 1e-9)
    };
    let there = |i: usize| position[i] + velocity[i] * rest_s + gained(i);
    (core::array::from_fn(there), point.yaw_rad)
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference(t_ms: u64, x_m: f64, speed_m_s: f64) -> Reference {
        let mut reference = Reference { spacing_ns: 20_000_000, count: 2, ..Reference::default() };
        reference.header.valid_ns = t_ms * 1_000_000;
        for (i, point) in reference.points.iter_mut().take(2).enumerate() {
            point.position_w_m = [x_m + i as f64 * 0.02 * speed_m_s, 0.0, 0.0];
            point.velocity_w_m_s = [speed_m_s, 0.0, 0.0];
        }
        reference
    }

    fn be(tracker: &mut Tracker, t_ms: u64, x_m: f64) {
        tracker.course.observe_pose(t_ms * 1_000_000, [x_m, 0.0, 0.0], 0.0);
        tracker.compare(false, &mut Evidence::default());
    }

    #[test]
    fn errors_do_not_depend_on_the_order_in_which_topics_are_drained() {
        let (mut first, mut second) = (Tracker::default(), Tracker::default());
        for t in 0..40 {
            be(&mut first, t, 0.001 * t as f64 + 0.01);
        }
        for t in [0, 20, 40] {
            let reference = reference(t, 0.001 * t as f64, 1.0);
            first.observe_reference(&reference);
            second.observe_reference(&reference);
        }
        for t in 0..40 {
            be(&mut second, t, 0.001 * t as f64 + 0.01);
        }
        for tracker in [&mut first, &mut second] {
            tracker.finish(&mut Evidence::default());
            let tracking = tracker.tracking();
            assert_eq!(tracking.samples, 40);
            assert!((tracking.rms_m - 0.01).abs() < 1e-12);
            assert!((tracking.max_m - 0.01).abs() < 1e-12);
        }
    }

    #[test]
    fn the_heading_is_compared_with_that_of_the_reference_across_its_seam() {
        let mut course = Course::default();
        let mut turned = reference(0, 0.0, 0.0);
        turned.points[0].yaw_rad = 3.1;
        course.observe_reference(&turned);
        course.observe_pose(0, [0.0; 3], -3.1);
        let point = course.next(true).unwrap();
        assert!((point.turned_rad - (core::f64::consts::TAU - 6.2)).abs() < 1e-12, "{point:?}");
    }

    #[test]
    fn what_is_judged_anew_forgets_errors_and_not_where_the_vehicle_is_to_be() {
        let mut tracker = Tracker::default();
        tracker.observe_reference(&reference(0, 0.0, 1.0));
        tracker.observe_reference(&reference(20, 0.02, 1.0));
        for t in 0..20 {
            be(&mut tracker, t, 0.001 * t as f64 + 0.5);
        }
        let mut tracker = tracker.anew();
        for t in 20..30 {
            be(&mut tracker, t, 0.001 * t as f64 + 0.01);
        }
        tracker.finish(&mut Evidence::default());
        assert_eq!(tracker.tracking().samples, 10);
        assert!((tracker.tracking().max_m - 0.01).abs() < 1e-12);
    }
}
