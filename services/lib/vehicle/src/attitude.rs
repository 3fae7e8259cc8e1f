//! Attitude: Euler angles γ = (φ, θ, ψ) of the paper, intrinsic z-y-x, against `q_wb`.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Beyond this |θ| \[rad\] the Euler rates of eq. (5) grow without use: cos 1.2 is 0.36.
pub const MAX_PITCH_RAD: f64 = 1.2;

/// `q_wb` of γ = (φ, θ, ψ) \[rad\]: yaw ψ about z, then pitch θ about y, then roll φ about x.
/// w ≥ 0.
#[must_use]
pub fn quaternion_from_euler(gamma: &Vector3<f64>) -> UnitQuaternion<f64> {
    let half = gamma * 0.5;
    let (sr, cr) = libm::sincos(half.x);
    let (sp, cp) = libm::sincos(half.y);
    let (sy, cy) = libm::sincos(half.z);
    canonical(UnitQuaternion::new_normalize(Quaternion::new(
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )))
}

/// γ = (φ, θ, ψ) \[rad\] of `q_wb`, φ and ψ in [−π, π], θ in [−π/2, π/2].
#[must_use]
pub fn euler_from_quaternion(q_wb: &UnitQuaternion<f64>) -> Vector3<f64> {
    let (w, x, y, z) = (q_wb.w, q_wb.i, q_wb.j, q_wb.k);
    Vector3::new(
        libm::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        libm::asin((2.0 * (w * y - z * x)).clamp(-1.0, 1.0)),
        libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
}

/// R₂(γ) of eq. (5): γ̇ = R₂ ω, ω in body axes. `None` beyond [`MAX_PITCH_RAD`] or for a γ that is
/// not finite.
#[must_use]
pub fn euler_rate_matrix(gamma: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let usable = gamma.x.is_finite() && gamma.y.abs() <= MAX_PITCH_RAD && gamma.z.is_finite();
    usable.then(|| {
        let (sp, cp) = libm::sincos(gamma.x);
        let (st, ct) = libm::sincos(gamma.y);
        Matrix3::new(
            1.0,
            sp * st / ct,
            cp * st / ct, //
            0.0,
            cp,
            -sp, //
            0.0,
            sp / ct,
            cp / ct,
        )
    })
}

/// The inverse of R₂(γ), ω = R₂⁻¹ γ̇; it exists at every attitude.
#[must_use]
pub fn body_rate_matrix(gamma: &Vector3<f64>) -> Matrix3<f64> {
    let (sp, cp) = libm::sincos(gamma.x);
    let (st, ct) = libm::sincos(gamma.y);
    Matrix3::new(
        1.0,
        0.0,
        -st, //
        0.0,
        cp,
        sp * ct, //
        0.0,
        -sp,
        cp * ct,
    )
}

/// The same rotation with w ≥ 0.
#[must_use]
pub fn canonical(q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if q.w < 0.0 { UnitQuaternion::new_unchecked(-q.into_inner()) } else { q }
}

/// The rotation with these components, scalar first, as a sample has them: of norm 1.
#[must_use]
pub fn rotation([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
}

/// The components of a rotation, scalar first, as a sample has them: w ≥ 0.
#[must_use]
pub fn components(q: UnitQuaternion<f64>) -> [f64; 4] {
    let q = canonical(q);
    [q.w, q.i, q.j, q.k]
}

/// `angle_rad` brought into (−π, π]; exact, also for many turns. NaN for an angle not finite.
#[must_use]
pub fn wrap_pi(angle_rad: f64) -> f64 {
    let wrapped = libm::remainder(angle_rad, TAU);
    if wrapped <= -PI { PI } else { wrapped }
}

#[cfg(test)]
#[expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;

    fn gamma_up_to(pitch: f64) -> impl Strategy<Value = Vector3<f64>> {
        (-3.1..3.1, -pitch..pitch, -3.1..3.1).prop_map(|(r, p, y)| Vector3::new(r, p, y))
    }

    #[test]
    fn each_axis_turns_as_the_frames_define() {
        let turn = |r, p, y| quaternion_from_euler(&Vector3::new(r, p, y));
        // Yaw left takes x to y; pitch takes x down; roll takes y up (B is forward-left-up).
        let yaw = turn(0.0, 0.0, FRAC_PI_2) * Vector3::x();
        let pitch = turn(0.0, FRAC_PI_2, 0.0) * Vector3::x();
        let roll = turn(FRAC_PI_2, 0.0, 0.0) * Vector3::y();
        assert!((yaw - Vector3::y()).norm() < 1e-15);
        assert!((pitch + Vector3::z()).norm() < 1e-15);
        assert!((roll - Vector3::z()).norm() < 1e-15);
    }

    #[test]
    fn the_thrust_axis_is_the_one_printed_in_equation_2() {
        let (phi, theta, psi) = (0.3_f64, -0.4_f64, 1.1_f64);
        let z_w = quaternion_from_euler(&Vector3::new(phi, theta, psi)) * Vector3::z();
        let expected = Vector3::new(
            phi.cos() * psi.cos() * theta.sin() + phi.sin() * psi.sin(),
            phi.cos() * psi.sin() * theta.sin() - psi.cos() * phi.sin(),
            phi.cos() * theta.cos(),
        );
        assert!((z_w - expected).norm() < 1e-15);
    }

    #[test]
    fn the_euler_rate_matrix_refuses_steep_pitch_and_nan() {
        assert!(euler_rate_matrix(&Vector3::new(0.0, 1.19, 0.0)).is_some());
        assert!(euler_rate_matrix(&Vector3::new(0.0, -1.21, 0.0)).is_none());
        for axis in 0..3 {
            let mut gamma = Vector3::zeros();
            gamma[axis] = f64::NAN;
            assert!(euler_rate_matrix(&gamma).is_none());
        }
    }

    #[test]
    fn wrapping_lands_in_the_half_open_turn() {
        assert!((wrap_pi(PI) - PI).abs() < 1e-15);
        assert!((wrap_pi(-PI) - PI).abs() < 1e-15);
        assert!((wrap_pi(-3.0) + 3.0).abs() < 1e-15);
        assert!((wrap_pi(3.5) - (3.5 - TAU)).abs() < 1e-15);
        assert!((wrap_pi(100.0 * TAU + 1.0) - 1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn euler_angles_survive_the_round_trip(gamma in gamma_up_to(1.5)) {
            let q_wb = quaternion_from_euler(&gamma);
            prop_assert!(q_wb.w >= 0.0);
            prop_assert!((euler_from_quaternion(&q_wb) - gamma).norm() < 1e-13);
        }

        #[test]
        fn the_euler_rates_are_the_derivative_of_the_angles(
            gamma in gamma_up_to(1.1), p in -5.0..5.0, q in -5.0..5.0, r in -5.0..5.0,
        ) {
            let omega_b = Vector3::new(p, q, r);
            let rate = euler_rate_matrix(&gamma).unwrap() * omega_b;
            let h = 1e-5;
            let turned = |t: f64| {
                let q_wb = quaternion_from_euler(&gamma);
                let difference = euler_from_quaternion(
                    &(q_wb * UnitQuaternion::from_scaled_axis(omega_b * t))) - gamma;
                difference.map(wrap_pi)
            };
            // Central difference: truncation ~ h² |ω|³ / cos³θ, below 1e-5 here.
            prop_assert!(((turned(h) - turned(-h)) / (2.0 * h) - rate).norm() < 1e-5);
            prop_assert!((body_rate_matrix(&gamma) * rate - omega_b).norm() < 1e-13);
        }
    }
}
