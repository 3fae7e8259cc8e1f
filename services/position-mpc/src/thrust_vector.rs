//! Between the thrust vector, in which the translation is linear, and a set point's angles and thrust.
//!
//! Inside the law the input is u = (θ₀, φ₀, T₀), ordered by the axis it moves: with n the direction of the thrust T in W,
//! the last column of the rotation in (2), and ψ = 0, θ₀ = n₁ / n₃ and φ₀ = −n₂ / n₃ are tangents of the tilt and
//! T₀ = T n₃ is the part of the thrust that carries. Then m (ẍ, ÿ, z̈ + g) = T₀ (θ₀, −φ₀, 1) at any tilt, where (3) holds
//! for small angles, and a tilt costs no lift. Tangents turn with the heading exactly as [`heading`] turns small angles.

use controller::heading;
use nalgebra::Vector3;

/// Least n₃ that counts: a vehicle that lies on its side is none that the law can predict.
const LIFT_MIN: f64 = 0.2;

/// (φ, θ) \[rad\] at heading `psi` \[rad\] of (θ₀, φ₀).
pub(crate) fn angles_at(u: &Vector3<f64>, psi: f64) -> (f64, f64) {
    let (right, ahead) = heading::angles_at(u, psi);
    let theta = libm::atan(ahead);
    (libm::atan(right * libm::cos(theta)), theta)
}

/// u at ψ = 0 of angles at heading `psi` \[rad\] and thrust T \[N\].
pub(crate) fn input_of(phi: f64, theta: f64, psi: f64, thrust_n: f64) -> Vector3<f64> {
    let lift = lift(phi, theta);
    let ahead = libm::sin(theta) * libm::cos(phi) / lift;
    let right = libm::sin(phi) / lift;
    heading::input_of(right, ahead, psi, thrust_n * lift)
}

/// Share of the thrust that carries, n₃.
pub(crate) fn lift(phi: f64, theta: f64) -> f64 {
    (libm::cos(phi) * libm::cos(theta)).max(LIFT_MIN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vehicle::quaternion_from_euler;

    #[test]
    fn a_set_point_accelerates_by_the_input_at_every_heading() {
        for degrees in (-180..=180).step_by(15) {
            let psi = f64::from(degrees).to_radians();
            let u = Vector3::new(0.3, -0.25, 1.2);
            let (phi, theta) = angles_at(&u, psi);
            let thrust_n = u.z / lift(phi, theta);
            let attitude = quaternion_from_euler(&Vector3::new(phi, theta, psi));
            let force_n = attitude * Vector3::z() * thrust_n;
            let wanted_n = Vector3::new(u.x * u.z, -u.y * u.z, u.z);
            assert!((force_n - wanted_n).amax() < 1e-15, "{degrees}: {force_n}");
            assert!((input_of(phi, theta, psi, thrust_n) - u).amax() < 1e-15);
        }
    }

    #[test]
    fn the_input_of_a_vehicle_on_its_side_is_finite() {
        for [phi, theta] in [[1.57, 0.0], [0.0, -1.57], [3.1, 0.4], [1.6, 1.6]] {
            assert!(input_of(phi, theta, 0.3, 2.0).amax() <= 5.0);
        }
    }
}
