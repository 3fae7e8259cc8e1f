//! What is tracked once the set points have ended: the tilt that was asked for last fades, and the vehicle comes to
//! rest.
//!
//! For a few tenths of a second the last tilt is nearer to what the next controller will ask for than none, and after
//! seconds of it the vehicle is lost. So it fades, and what takes its place brakes the vehicle.

use shared_types::StateEstimate;

/// Time constant of the fading \[s\].
const FADES_S: f64 = 0.5;
/// Tilt against the horizontal velocity \[rad s/m\]: a time constant of about a second.
const TILT_PER_SPEED_RAD_S_M: f64 = 0.1;
/// Largest tilt that brakes \[rad\].
const TILT_MAX_RAD: f64 = 0.2;
/// Share of the weight against the vertical velocity \[s/m\].
const LIFT_PER_SPEED_S_M: f64 = 0.1;
/// Largest share of it.
const LIFT_MAX: f64 = 0.3;

/// What brings the vehicle to rest: T \[N\], φ, θ, ψ \[rad\], the heading as it is given. Without a
/// finite estimate that is level, and carries the weight.
pub(super) fn braking(weight_n: f64, yaw_rad: f64, estimate: Option<&StateEstimate>) -> [f64; 4] {
    let [ahead, left, up] = estimate.map_or([0.0; 3], velocity_h_m_s);
    let tilt = |speed: f64| (TILT_PER_SPEED_RAD_S_M * speed).clamp(-TILT_MAX_RAD, TILT_MAX_RAD);
    let (roll_rad, pitch_rad) = (tilt(left), -tilt(ahead));
    let lift = 1.0 - (LIFT_PER_SPEED_S_M * up).clamp(-LIFT_MAX, LIFT_MAX);
    // 1 / (cos φ cos θ) to second order.
    let by_tilt = 1.0 + 0.5 * (roll_rad * roll_rad + pitch_rad * pitch_rad);
    [weight_n * lift * by_tilt, roll_rad, pitch_rad, yaw_rad]
}

/// Velocity ahead and to the left of the vehicle's heading, and up \[m/s\]; zeros for one that is not finite.
fn velocity_h_m_s(estimate: &StateEstimate) -> [f64; 3] {
    let [w, x, y, z] = estimate.q_wb.to_array();
    let [east, north, up] = estimate.velocity_w_m_s;
    let (cosine, sine) = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z));
    let length = (cosine * cosine + sine * sine).sqrt();
    let velocity =
        [(cosine * east + sine * north) / length, (cosine * north - sine * east) / length, up];
    if velocity.iter().all(|speed| speed.is_finite()) { velocity } else { [0.0; 3] }
}

/// `from` as far as it has not faded to `to` after `after_ns`.
pub(super) fn faded(from: &[f64; 4], to: &[f64; 4], after_ns: u64) -> [f64; 4] {
    let left = FADES_S / (FADES_S + after_ns as f64 * 1e-9);
    core::array::from_fn(|i| to[i] + (from[i] - to[i]) * left)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_1_SQRT_2;
    use shared_types::Quaternion;

    /// Looks to the north.
    const NORTH: Quaternion = Quaternion::from_array([FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]);

    fn moving(velocity_w_m_s: [f64; 3], q_wb: Quaternion) -> StateEstimate {
        StateEstimate { velocity_w_m_s, q_wb, ..StateEstimate::default() }
    }

    fn assert_near(is: [f64; 4], wanted: [f64; 4]) {
        let is_near = is.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(is_near, "{is:?} for {wanted:?}");
    }

    #[test]
    fn a_vehicle_is_tilted_against_its_velocity_in_the_frame_of_its_heading() {
        assert_near(braking(2.0, 0.7, None), [2.0, 0.0, 0.0, 0.7]);
        let east = moving([1.0, 0.0, 0.0], Quaternion::IDENTITY);
        assert_near(braking(2.0, 0.0, Some(&east)), [2.01, 0.0, -0.1, 0.0]);
        // To the east is to the right of a vehicle that looks to the north.
        let north = moving([1.0, 0.0, 0.0], NORTH);
        assert_near(braking(2.0, 0.0, Some(&north)), [2.01, -0.1, 0.0, 0.0]);
        let falling = moving([0.0, 0.0, -1.0], Quaternion::IDENTITY);
        assert_near(braking(2.0, 0.0, Some(&falling)), [2.2, 0.0, 0.0, 0.0]);
        let fast = moving([9.0, 0.0, -9.0], Quaternion::IDENTITY);
        assert_near(braking(2.0, 0.0, Some(&fast)), [2.0 * 1.3 * 1.02, 0.0, -0.2, 0.0]);
    }

    #[test]
    fn an_estimate_that_is_not_finite_is_none() {
        let estimate = moving([f64::NAN, 0.0, 0.0], NORTH);
        assert_near(braking(2.0, 0.0, Some(&estimate)), [2.0, 0.0, 0.0, 0.0]);
        let unknown = moving([1.0; 3], Quaternion::default());
        assert!(braking(2.0, 0.0, Some(&unknown)).iter().all(|number| number.is_finite()));
    }

    #[test]
    fn what_was_asked_for_fades_with_a_time_constant_of_half_a_second() {
        let (from, to) = ([2.0, 0.3, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0]);
        let after =
            |steps: u64| (0..steps).fold(from, |value, _| faded(&value, &to, 1_000_000_000 / 500));
        assert_near(after(0), from);
        // exp(-1)
        assert!((after(250)[1] / 0.3 - 0.367_879).abs() < 2e-3, "{:?}", after(250));
        assert!(after(2500)[1] < 3e-5);
    }
}
