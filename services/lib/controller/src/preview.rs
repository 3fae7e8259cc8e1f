//! The reference at the controller's own instants, and what to fly when no reference comes.

use nalgebra::Vector3;
use shared_types::guidance::REFERENCE_POINTS;
use shared_types::{Reference, ReferencePoint};

/// What to do when the reference has ended: hover at its last point, then land.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landing {
    /// Time without a new reference after which the descent begins \[s\].
    pub after_s: f64,
    /// Descent rate \[m/s\].
    pub descent_m_s: f64,
    /// Height at which the descent ends \[m\].
    pub ground_m: f64,
}

impl Default for Landing {
    /// Two seconds of hover, then half a metre per second.
    fn default() -> Self {
        Self { after_s: 2.0, descent_m_s: 0.5, ground_m: 0.0 }
    }
}

impl Landing {
    /// How long the descent from a height takes \[s\].
    #[must_use]
    pub fn lasts_s(&self, height_m: f64) -> f64 {
        (height_m - self.ground_m).max(0.0) / self.descent_m_s
    }

    /// How far the descent has got at an instant `ahead_s` after that of a reference whose age is `age_s` \[m\].
    fn descent_m(&self, age_s: f64, ahead_s: f64) -> f64 {
        if age_s < self.after_s { 0.0 } else { self.descent_m_s * (ahead_s - self.after_s) }
    }
}

/// Fills `points` with the reference at now + T, now + 2 T, ... and returns the heading for now
/// \[rad\].
pub fn preview(
    reference: &Reference,
    now_ns: u64,
    period_s: f64,
    landing: &Landing,
    points: &mut [Vector3<f64>],
) -> f64 {
    let age_s = now_ns.saturating_sub(reference.header.valid_ns) as f64 * 1e-9;
    for (i, point) in points.iter_mut().enumerate() {
        *point = place(reference, age_s, age_s + (i + 1) as f64 * period_s, landing);
    }
    yaw_at(reference, age_s)
}

/// The reference at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Position \[m\] in W, for now.
    pub position_w_m: Vector3<f64>,
    /// Velocity \[m/s\] in W, for now.
    pub velocity_w_m_s: Vector3<f64>,
    /// Acceleration \[m/s²\] in W, for `lead_s` from now.
    pub acceleration_w_m_s2: Vector3<f64>,
    /// Heading \[rad\], for now.
    pub yaw_rad: f64,
}

/// Where to be now and how to move, with the acceleration of `lead_s` \[s\] from now, for a loop that
/// answers so much later.
#[must_use]
pub fn target(reference: &Reference, now_ns: u64, lead_s: f64, landing: &Landing) -> Target {
    /// Two of these are less than the spacing of any reference, and differences still exact \[s\].
    const STEP_S: f64 = 0.005;
    let age_s = now_ns.saturating_sub(reference.header.valid_ns) as f64 * 1e-9;
    let ahead = |from_s: f64| {
        [0.0, 1.0, 2.0].map(|step| place(reference, age_s, age_s + from_s + step * STEP_S, landing))
    };
    // Exact for parabolas: (−3 p₀ + 4 p₁ − p₂)/2h and (p₀ − 2 p₁ + p₂)/h².
    let [p0, p1, p2] = ahead(0.0);
    let [q0, q1, q2] = ahead(lead_s);
    // Where the reference stops dead, at its end or on the ground, there is no acceleration to be had.
    let rests = |ahead_s: f64| rests_at(reference, age_s, ahead_s, landing);
    let stops = rests(age_s + lead_s) != rests(age_s + lead_s + 2.0 * STEP_S);
    let bend = if stops { Vector3::zeros() } else { q0 - q1 * 2.0 + q2 };
    Target {
        position_w_m: p0,
        velocity_w_m_s: (p1 * 4.0 - p0 * 3.0 - p2) / (2.0 * STEP_S),
        acceleration_w_m_s2: bend / (STEP_S * STEP_S),
        yaw_rad: yaw_at(reference, age_s),
    }
}

/// Where the reference is `ahead_s` after its own instant, or where the landing is by then, if it has begun at `age_s`.
fn place(reference: &Reference, age_s: f64, ahead_s: f64, landing: &Landing) -> Vector3<f64> {
    let mut point = position_at(reference, ahead_s);
    let descent_m = landing.descent_m(age_s, ahead_s);
    if descent_m > 0.0 {
        point.z = (point.z - descent_m).max(landing.ground_m.min(point.z));
    }
    point
}

/// Whether the reference is at its end, and whether the landing is, as in [`place`].
fn rests_at(reference: &Reference, age_s: f64, ahead_s: f64, landing: &Landing) -> [bool; 2] {
    let end = in_use(reference).len() - 1;
    let height_m = position_at(reference, ahead_s).z - landing.ground_m;
    let descent_m = landing.descent_m(age_s, ahead_s);
    [segment(reference, ahead_s).0 == end, descent_m > 0.0 && descent_m >= height_m]
}

fn yaw_at(reference: &Reference, age_s: f64) -> f64 {
    in_use(reference).get(segment(reference, age_s).0).map_or(0.0, |point| point.yaw_rad)
}

fn in_use(reference: &Reference) -> &[ReferencePoint] {
    let count = usize::try_from(reference.count).unwrap_or(REFERENCE_POINTS);
    &reference.points[..count.clamp(1, REFERENCE_POINTS)]
}

/// Index of the point at or before an instant and the fraction of the way to the next one.
fn segment(reference: &Reference, ahead_s: f64) -> (usize, f64) {
    let spacing_s = reference.spacing_ns.max(1) as f64 * 1e-9;
    let last = in_use(reference).len() - 1;
    let steps = ahead_s / spacing_s;
    if steps >= last as f64 {
        return (last, 0.0);
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=47")]
    let index = steps.max(0.0) as usize;
    (index, (steps - index as f64).clamp(0.0, 1.0))
}

/// Cubic Hermite through positions and velocities; past the last point it rests there.
fn position_at(reference: &Reference, ahead_s: f64) -> Vector3<f64> {
    let (index, s) = segment(reference, ahead_s);
    let points = in_use(reference);
    let from = &points[index];
    let Some(to) = points.get(index + 1) else { return from.position_w_m.into() };
    let h = reference.spacing_ns as f64 * 1e-9;
    let (p0, p1) = (Vector3::from(from.position_w_m), Vector3::from(to.position_w_m));
    let (v0, v1) = (Vector3::from(from.velocity_w_m_s), Vector3::from(to.velocity_w_m_s));
    let (s2, s3) = (s * s, s * s * s);
    p0 * (2.0 * s3 - 3.0 * s2 + 1.0)
        + v0 * (h * (s3 - 2.0 * s2 + s))
        + p1 * (3.0 * s2 - 2.0 * s3)
        + v1 * (h * (s3 - s2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cubic, which Hermite interpolation must reproduce exactly.
    fn cubic(t: f64) -> (f64, f64) {
        (1.0 + t - 2.0 * t * t + 0.5 * t * t * t, 1.0 - 4.0 * t + 1.5 * t * t)
    }

    fn reference() -> Reference {
        let mut reference = Reference { spacing_ns: 20_000_000, count: 48, ..Reference::default() };
        reference.header.valid_ns = 1_000_000_000;
        for (i, point) in reference.points.iter_mut().enumerate() {
            let (p, v) = cubic(i as f64 * 0.02);
            *point = ReferencePoint {
                position_w_m: [p, -p, 2.0 * p],
                velocity_w_m_s: [v, -v, 2.0 * v],
                yaw_rad: i as f64,
            };
        }
        reference
    }

    #[test]
    fn a_cubic_path_is_met_between_the_points() {
        let mut points = [Vector3::zeros(); 20];
        let yaw = preview(&reference(), 1_013_000_000, 0.01, &Landing::default(), &mut points);
        for (i, point) in points.iter().enumerate() {
            let (p, _) = cubic(0.013 + (i + 1) as f64 * 0.01);
            assert!((point - Vector3::new(p, -p, 2.0 * p)).norm() < 1e-12);
        }
        assert!((yaw - 0.0).abs() < 1e-12);
    }

    #[test]
    fn the_motion_of_a_parabola_is_known_exactly_and_a_lead_looks_ahead() {
        let mut reference = Reference { spacing_ns: 20_000_000, count: 48, ..Reference::default() };
        for (i, point) in reference.points.iter_mut().enumerate() {
            let t = i as f64 * 0.02;
            point.position_w_m = [t * t, 1.0 - t, 0.0];
            point.velocity_w_m_s = [2.0 * t, -1.0, 0.0];
        }
        let now = target(&reference, 113_000_000, 0.05, &Landing::default());
        assert!((now.position_w_m - Vector3::new(0.012769, 0.887, 0.0)).norm() < 1e-12);
        assert!((now.velocity_w_m_s - Vector3::new(0.226, -1.0, 0.0)).norm() < 1e-10);
        assert!((now.acceleration_w_m_s2 - Vector3::new(2.0, 0.0, 0.0)).norm() < 1e-8);
        // The reference rests after its last point, and so does what looks beyond it.
        let late = target(&reference, 900_000_000, 0.1, &Landing::default());
        assert!((late.acceleration_w_m_s2.norm(), late.velocity_w_m_s.x > 1.7) == (0.0, true));
    }

    #[test]
    fn until_a_landing_begins_the_reference_is_followed_and_then_nothing_jumps() {
        let soon = Landing { after_s: 0.5, ..Landing::default() };
        let (mut points, mut planned) = ([Vector3::zeros(); 60], [Vector3::zeros(); 60]);
        for (age_ns, descent_m) in [(20_000_000, 0.0), (499_000_000, 0.0), (600_000_000, 0.05)] {
            let now_ns = 1_000_000_000 + age_ns;
            preview(&reference(), now_ns, 0.02, &soon, &mut points);
            preview(&reference(), now_ns, 0.02, &Landing::default(), &mut planned);
            let now = [&soon, &Landing::default()]
                .map(|landing| target(&reference(), now_ns, 0.0, landing).position_w_m.z);
            assert!((now[1] - now[0] - descent_m).abs() < 1e-9, "{now:?}");
            assert_eq!(points == planned, descent_m == 0.0, "{age_ns}");
        }
    }

    #[test]
    fn where_a_reference_stops_dead_no_acceleration_is_asked_for() {
        let mut reference = Reference { spacing_ns: 50_000_000, count: 2, ..Reference::default() };
        for (i, point) in reference.points.iter_mut().enumerate() {
            point.position_w_m = [i as f64 * 0.05, 0.0, 1.0];
            point.velocity_w_m_s = [1.0, 0.0, 0.0];
        }
        for now_ns in (0..5_000_000_000).step_by(1_000_000) {
            for lead_s in [0.0, 0.05] {
                let asked = target(&reference, now_ns, lead_s, &Landing::default());
                let most = asked.acceleration_w_m_s2.norm();
                assert!(most < 1e-6, "{most} m/s² after {now_ns} ns, {lead_s} s ahead");
            }
        }
    }

    #[test]
    fn after_the_last_point_it_hovers_and_then_lands() {
        let landing = Landing { after_s: 5.0, descent_m_s: 0.5, ground_m: 0.0 };
        let mut points = [Vector3::zeros(); 1];
        let end = Vector3::from(reference().points[47].position_w_m);
        let mut at = |t_s: f64| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "test")]
            let now_ns = 1_000_000_000 + (t_s * 1e9) as u64;
            preview(&reference(), now_ns, 0.02, &landing, &mut points);
            points[0]
        };
        assert!((at(4.0) - end).norm() < 1e-12);
        assert!((at(6.0).z - (end.z - 0.5 * 1.02)).abs() < 1e-9);
        assert!(at(600.0).z.abs() < 1e-12);
    }
}
