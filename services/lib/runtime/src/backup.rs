//! The position law for want of a position controller: of an attitude loop whose set points have ended, and of the plant's
//! gate, which no controller commands. It follows the reference, and where there is none it comes to rest.
//!
//! Proportional in position and velocity, beside the reference's acceleration. It has no integral and knows neither wind
//! nor drag; what the last set point asked for beyond it is what holds against them, and fades.

use shared_types::guidance::REFERENCE_POINTS;
use shared_types::{Reference, StateEstimate};

/// Bound on the tilt that a position loop asks for, the unit in which steps of it are measured \[rad\].
pub const TILT_BOUND_RAD: f64 = 0.35;
/// Time constant with which the last set point fades \[s\].
const FADES_S: f64 = 0.5;
/// Velocity per position error \[1/s\].
const POSITION_GAIN_S: f64 = 2.2;
/// Acceleration per velocity error \[1/s\].
const VELOCITY_GAIN_S: f64 = 5.5;
/// Largest velocity that a position error asks for beside the reference's \[m/s\].
const SPEED_MAX_M_S: f64 = 1.0;
/// How far ahead the reference's acceleration is taken: the lag of an attitude loop \[ns\].
const LEAD_NS: u64 = 50_000_000;
/// Largest share of the weight by which the thrust differs from it.
const LIFT_MAX: f64 = 0.5;
/// Thrust in weights of any set point here.
const THRUST_WEIGHTS: [f64; 2] = [0.3, 2.0];
/// Age of a reference from which on the vehicle lands, and how fast, as position controllers do \[ns, m/s\].
const HOVER_NS: u64 = 2_000_000_000;
const LANDING_M_S: f64 = 0.5;

/// What is tracked at `now_ns` without a set point: T \[N\], φ, θ, ψ \[rad\]. The heading is the reference's, without one
/// `yaw_rad`. Without a finite estimate it is level, and carries the weight.
#[must_use]
pub fn setpoint(
    now_ns: u64,
    vehicle: Vehicle,
    yaw_rad: f64,
    estimate: Option<&StateEstimate>,
    reference: Option<&Reference>,
) -> [f64; 4] {
    let motion = reference.map(|reference| Motion::at(reference, now_ns));
    let motion = motion.filter(Motion::is_finite);
    let wanted = estimate.map(|estimate| acceleration_w_m_s2(estimate, motion.as_ref()));
    let [ahead, left, up] = estimate
        .zip(wanted)
        .and_then(|(estimate, wanted)| in_heading(estimate, wanted))
        .unwrap_or_default()
        .map(|acceleration| acceleration / vehicle.gravity_m_s2);
    let tilt = |share: f64| share.clamp(-TILT_BOUND_RAD, TILT_BOUND_RAD);
    let (roll_rad, pitch_rad) = (-tilt(left), tilt(ahead));
    let lift = 1.0 + up.clamp(-LIFT_MAX, LIFT_MAX);
    // 1 / (cos φ cos θ) to second order.
    let by_tilt = 1.0 + 0.5 * (roll_rad * roll_rad + pitch_rad * pitch_rad);
    let yaw_rad = motion.map_or(yaw_rad, |motion| motion.yaw_rad);
    [vehicle.weight_n * lift * by_tilt, roll_rad, pitch_rad, yaw_rad]
}

/// How fast the vehicle leaves the place at which a reference wants it at `now_ns` \[m/s\]; zero if a number is not finite.
#[must_use]
pub fn leaving_m_s(now_ns: u64, estimate: &StateEstimate, reference: &Reference) -> f64 {
    let motion = Motion::at(reference, now_ns);
    let away = [0, 1, 2].map(|i| estimate.position_w_m[i] - motion.position_w_m[i]);
    let velocity = [0, 1, 2].map(|i| estimate.velocity_w_m_s[i] - motion.velocity_w_m_s[i]);
    let along = |vector: [f64; 3]| away.iter().zip(vector).map(|(a, b)| a * b).sum::<f64>();
    let leaving_m_s = along(velocity) / along(away).sqrt();
    if leaving_m_s.is_finite() { leaving_m_s } else { 0.0 }
}

/// What is left of a last set point beside the law's: both together, T, φ and θ, within what a set point may ask for, or
/// what was tracked `before`, where that is more: nothing jumps.
pub(crate) fn bounded(sum: [f64; 3], before: [f64; 3], vehicle: Vehicle) -> [f64; 3] {
    let [least, most] = THRUST_WEIGHTS.map(|weights| weights * vehicle.weight_n);
    let tilt = |i: usize| {
        let most_rad = TILT_BOUND_RAD.max(before[i].abs());
        sum[i].clamp(-most_rad, most_rad)
    };
    [sum[0].clamp(least.min(before[0]), most.max(before[0])), tilt(1), tilt(2)]
}

/// The share of what the last set point asked for beyond the law that is left after so long.
pub(crate) fn share_left(after_ns: u64) -> f64 {
    FADES_S / (FADES_S + after_ns as f64 * 1e-9)
}

/// The vehicle as the law knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vehicle {
    /// Its weight \[N\].
    pub weight_n: f64,
    /// What makes it \[m/s²\].
    pub gravity_m_s2: f64,
}

/// Where to be and how to move, in W.
#[derive(Clone, Copy)]
struct Motion {
    position_w_m: [f64; 3],
    velocity_w_m_s: [f64; 3],
    acceleration_w_m_s2: [f64; 3],
    yaw_rad: f64,
}

impl Motion {
    /// What the reference prescribes, with constant acceleration between its points; it rests at the last one. Once it is
    /// old, the way down.
    fn at(reference: &Reference, now_ns: u64) -> Self {
        let age_ns = now_ns.saturating_sub(reference.header.valid_ns);
        let spacing_ns = reference.spacing_ns.max(1);
        let spacing_s = spacing_ns as f64 * 1e-9;
        let end = reference.count.clamp(1, REFERENCE_POINTS as u64) - 1;
        let point = |index: u64| {
            let index = usize::try_from(index.min(end)).unwrap_or_default();
            &reference.points[index]
        };
        let slope = |index: u64| {
            let (from, to) = (point(index).velocity_w_m_s, point(index + 1).velocity_w_m_s);
            [0, 1, 2].map(|i| (to[i] - from[i]) / spacing_s)
        };
        let index = age_ns / spacing_ns;
        let from = point(index);
        let rests = index >= end;
        let since_s = if rests { 0.0 } else { (age_ns % spacing_ns) as f64 * 1e-9 };
        let velocity = if rests { [0.0; 3] } else { from.velocity_w_m_s };
        let bend = slope(index);
        let mut position = [0, 1, 2]
            .map(|i| from.position_w_m[i] + (velocity[i] + 0.5 * bend[i] * since_s) * since_s);
        let mut speed = [0, 1, 2].map(|i| velocity[i] + bend[i] * since_s);
        let descent_m = LANDING_M_S * age_ns.saturating_sub(HOVER_NS) as f64 * 1e-9;
        if descent_m > 0.0 {
            let height_m = position[2];
            position[2] = (height_m - descent_m).max(height_m.min(0.0));
            if !rests || position[2] > 0.0 {
                speed[2] -= LANDING_M_S;
            }
        }
        Self {
            position_w_m: position,
            velocity_w_m_s: speed,
            acceleration_w_m_s2: slope(age_ns.saturating_add(LEAD_NS) / spacing_ns),
            yaw_rad: from.yaw_rad,
        }
    }

    fn is_finite(&self) -> bool {
        let numbers = [self.position_w_m, self.velocity_w_m_s, self.acceleration_w_m_s2];
        numbers.iter().flatten().chain([&self.yaw_rad]).all(|number| number.is_finite())
    }
}

/// Acceleration towards a motion, or to rest without one.
fn acceleration_w_m_s2(estimate: &StateEstimate, motion: Option<&Motion>) -> [f64; 3] {
    let braking = estimate.velocity_w_m_s.map(|speed| -VELOCITY_GAIN_S * speed);
    motion.map_or(braking, |motion| {
        [0, 1, 2].map(|i| {
            let away_m = motion.position_w_m[i] - estimate.position_w_m[i];
            let asked_m_s = (POSITION_GAIN_S * away_m).clamp(-SPEED_MAX_M_S, SPEED_MAX_M_S);
            let lacking_m_s = motion.velocity_w_m_s[i] + asked_m_s - estimate.velocity_w_m_s[i];
            motion.acceleration_w_m_s2[i] + VELOCITY_GAIN_S * lacking_m_s
        })
    })
}

/// A vector of W as its parts ahead and to the left of the vehicle's heading, and up; none that is not finite.
fn in_heading(estimate: &StateEstimate, [east, north, up]: [f64; 3]) -> Option<[f64; 3]> {
    let [w, x, y, z] = estimate.q_wb.to_array();
    let (cosine, sine) = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z));
    let length = (cosine * cosine + sine * sine).sqrt();
    let turned =
        [(cosine * east + sine * north) / length, (cosine * north - sine * east) / length, up];
    turned.iter().all(|part| part.is_finite()).then_some(turned)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_1_SQRT_2;
    use shared_types::Quaternion;

    /// Looks to the north.
    const NORTH: Quaternion = Quaternion::from_array([FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]);
    const WEIGHT_N: f64 = 2.0;
    const VEHICLE: Vehicle = Vehicle { weight_n: WEIGHT_N, gravity_m_s2: 9.81 };

    fn moving(velocity_w_m_s: [f64; 3], q_wb: Quaternion) -> StateEstimate {
        StateEstimate { velocity_w_m_s, q_wb, ..StateEstimate::default() }
    }

    fn assert_near(is: [f64; 4], wanted: [f64; 4]) {
        let is_near = is.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(is_near, "{is:?} for {wanted:?}");
    }

    #[test]
    fn without_a_reference_the_tilt_is_against_the_velocity_at_any_heading() {
        let braking = |estimate: Option<&StateEstimate>| setpoint(0, VEHICLE, 0.7, estimate, None);
        assert_near(braking(None), [WEIGHT_N, 0.0, 0.0, 0.7]);
        let tilt = 0.1 * VELOCITY_GAIN_S / VEHICLE.gravity_m_s2;
        let lifted = WEIGHT_N * (1.0 + 0.5 * tilt * tilt);
        let east = moving([0.1, 0.0, 0.0], Quaternion::IDENTITY);
        assert_near(braking(Some(&east)), [lifted, 0.0, -tilt, 0.7]);
        // To the east is to the right of a vehicle that looks to the north.
        let north = moving([0.1, 0.0, 0.0], NORTH);
        assert_near(braking(Some(&north)), [lifted, -tilt, 0.0, 0.7]);
        let fast = moving([9.0, 0.0, -9.0], Quaternion::IDENTITY);
        let lifted = WEIGHT_N * 1.5 * (1.0 + 0.5 * TILT_BOUND_RAD * TILT_BOUND_RAD);
        assert_near(braking(Some(&fast)), [lifted, 0.0, -TILT_BOUND_RAD, 0.7]);
    }

    #[test]
    fn what_is_not_finite_is_not_followed() {
        let level = [WEIGHT_N, 0.0, 0.0, 0.7];
        let law = |estimate: &StateEstimate, reference: Option<&Reference>| {
            setpoint(0, VEHICLE, 0.7, Some(estimate), reference)
        };
        assert_near(law(&moving([f64::NAN, 0.0, 0.0], NORTH), None), level);
        assert!(law(&moving([1.0; 3], Quaternion::default()), None).iter().all(|n| n.is_finite()));
        let mut reference = Reference { count: u64::MAX, ..Reference::default() };
        reference.points[0].position_w_m[1] = f64::INFINITY;
        assert_near(law(&moving([0.0; 3], NORTH), Some(&reference)), level);
    }

    /// A circle of 1 m in 5 s: as much tilt as a position controller may ask for is nearly needed.
    fn circle(now_s: f64) -> ([f64; 3], [f64; 3]) {
        let rate = core::f64::consts::TAU / 5.0;
        let (sine, cosine) = libm::sincos(rate * now_s);
        ([cosine, sine, 1.5], [-rate * sine, rate * cosine, 0.0])
    }

    #[test]
    fn a_point_of_mass_is_brought_to_the_reference_and_kept_on_it() {
        const STEP_S: f64 = 0.002;
        let mut reference = Reference { spacing_ns: 50_000_000, count: 48, ..Reference::default() };
        let (mut position, mut velocity) = ([1.3, 0.0, 1.3], [0.0, 1.0, 0.0]);
        let mut last_m = f64::INFINITY;
        for step in 0..2500_u64 {
            let now_ns = step * 2_000_000;
            if step.is_multiple_of(25) {
                reference.header.valid_ns = now_ns;
                for (point, index) in reference.points.iter_mut().zip(0_u32..) {
                    let (at, speed) = circle(step as f64 * STEP_S + f64::from(index) * 0.05);
                    (point.position_w_m, point.velocity_w_m_s) = (at, speed);
                }
            }
            let estimate = StateEstimate { position_w_m: position, ..moving(velocity, NORTH) };
            let [thrust_n, roll, pitch, _] =
                setpoint(now_ns, VEHICLE, 0.0, Some(&estimate), Some(&reference));
            // Ahead is north, and left is west.
            let horizontal = thrust_n / WEIGHT_N * 9.81;
            let acceleration = [
                horizontal * libm::sin(roll) * libm::cos(pitch),
                horizontal * libm::sin(pitch),
                horizontal * libm::cos(roll) * libm::cos(pitch) - 9.81,
            ];
            for axis in 0..3 {
                velocity[axis] += STEP_S * acceleration[axis];
                position[axis] += STEP_S * velocity[axis];
            }
            let (wanted, _) = circle((step + 1) as f64 * STEP_S);
            last_m = (0..3).map(|i| (position[i] - wanted[i]).abs()).fold(0.0, f64::max);
        }
        assert!(last_m < 0.03, "{last_m} m");
    }

    #[test]
    fn a_vehicle_leaves_its_reference_relative_to_how_that_moves() {
        let mut reference =
            Reference { spacing_ns: 1_000_000_000, count: 2, ..Reference::default() };
        for (point, at_m) in reference.points.iter_mut().zip([0.0, 1.0]) {
            (point.position_w_m, point.velocity_w_m_s) = ([at_m, 0.0, 0.0], [1.0, 0.0, 0.0]);
        }
        let leaves = |velocity_w_m_s: [f64; 3]| {
            let position_w_m = [0.8, 0.4, 0.0];
            let vehicle = StateEstimate { position_w_m, ..moving(velocity_w_m_s, NORTH) };
            leaving_m_s(500_000_000, &vehicle, &reference)
        };
        for (velocity_w_m_s, expected_m_s) in
            [([1.0, 0.0, 0.0], 0.0), ([1.6, 0.8, 0.0], 1.0), ([0.4, -0.8, 0.0], -1.0)]
        {
            assert!((leaves(velocity_w_m_s) - expected_m_s).abs() < 1e-12, "{velocity_w_m_s:?}");
        }
        assert!(leaves([f64::NAN; 3]).abs() < 1e-12);
    }

    #[test]
    fn a_reference_rests_at_its_last_point() {
        let mut reference = Reference { spacing_ns: 50, count: 2, ..Reference::default() };
        reference.points[1].position_w_m = [1.0, 2.0, 3.0];
        reference.points[1].velocity_w_m_s = [1.0; 3];
        let motion = Motion::at(&reference, 50_000);
        let bits = |vector: [f64; 3]| vector.map(f64::to_bits);
        assert_eq!(bits(motion.position_w_m), bits([1.0, 2.0, 3.0]));
        assert_eq!(bits(motion.velocity_w_m_s), [0; 3]);
        assert_eq!(bits(motion.acceleration_w_m_s2), [0; 3]);
    }

    #[test]
    fn without_a_new_reference_the_way_leads_down_to_the_ground_and_ends_there() {
        let mut reference = Reference { spacing_ns: 50_000_000, count: 2, ..Reference::default() };
        for point in &mut reference.points {
            point.position_w_m = [1.0, 2.0, 1.5];
        }
        let down = |now_ns: u64| {
            let motion = Motion::at(&reference, now_ns);
            (motion.position_w_m[2], motion.velocity_w_m_s[2])
        };
        let near = |(a, b): (f64, f64), (c, d): (f64, f64)| (a - c).abs().max((b - d).abs()) < 1e-9;
        assert!(near(down(2_000_000_000), (1.5, 0.0)), "{:?}", down(2_000_000_000));
        assert!(near(down(4_000_000_000), (0.5, -0.5)), "{:?}", down(4_000_000_000));
        assert!(near(down(60_000_000_000), (0.0, 0.0)), "{:?}", down(60_000_000_000));
    }

    #[test]
    fn a_set_point_and_what_is_left_of_another_stay_within_bounds() {
        let within = |sum: [f64; 3], before: [f64; 3]| {
            let [thrust_n, roll, pitch] = bounded(sum, before, VEHICLE);
            [thrust_n, roll, pitch, 0.0]
        };
        let rest = [WEIGHT_N, 0.0, 0.0];
        assert_near(within([9.0, 0.1, -0.6], rest), [4.0, 0.1, -TILT_BOUND_RAD, 0.0]);
        assert_near(within([-1.0, 0.6, 0.0], rest), [0.6, TILT_BOUND_RAD, 0.0, 0.0]);
        assert_near(within([5.0, 0.6, -0.5], [4.5, -0.5, 0.6]), [4.5, 0.5, -0.5, 0.0]);
    }

    #[test]
    fn what_was_asked_for_fades_with_a_time_constant_of_half_a_second() {
        let after = |steps: usize| [share_left(2_000_000)].repeat(steps).iter().product::<f64>();
        // exp(-1)
        assert!((after(250) - 0.367_879).abs() < 2e-3, "{}", after(250));
    }
}
