//! Between the ψ = 0 frame, in which (3) holds, and the vehicle's heading.
//!
//! Inside the law the input is u = (θ₀, φ₀, T), ordered by the axis it moves: x, y, z. With the
//! small angles of (3) the horizontal acceleration is g (θ₀, −φ₀) in the ψ = 0 frame and
//! g (cψ θ + sψ φ, sψ θ − cψ φ) at heading ψ; equating them gives the rotation below.

use nalgebra::Vector3;

/// (φ, θ) at heading `psi` that accelerates like `u` in the ψ = 0 frame.
#[must_use]
pub fn angles_at(u: &Vector3<f64>, psi: f64) -> (f64, f64) {
    let (s, c) = libm::sincos(psi);
    let (theta, phi) = (u.x, u.y);
    (c * phi + s * theta, c * theta - s * phi)
}

/// u in the ψ = 0 frame of (φ, θ) at heading `psi` with thrust `thrust`.
#[must_use]
pub fn input_of(phi: f64, theta: f64, psi: f64, thrust: f64) -> Vector3<f64> {
    let (s, c) = libm::sincos(psi);
    Vector3::new(c * theta + s * phi, c * phi - s * theta, thrust)
}

#[cfg(test)]
mod tests {
    use vehicle::quaternion_from_euler;

    use super::*;

    #[test]
    fn a_rotated_command_accelerates_the_same_way_at_every_heading() {
        for degrees in (-180..=180).step_by(15) {
            let psi = f64::from(degrees).to_radians();
            let u = Vector3::new(2e-3, -3e-3, 1.2);
            let (phi, theta) = angles_at(&u, psi);
            let z_w = quaternion_from_euler(&Vector3::new(phi, theta, psi)) * Vector3::z();
            // Horizontal thrust direction (θ₀, −φ₀), up to the square of the angles.
            assert!((z_w.x - u.x).abs() < 1e-7, "{degrees}");
            assert!((z_w.y + u.y).abs() < 1e-7, "{degrees}");
            assert!((input_of(phi, theta, psi, u.z) - u).amax() < 1e-15);
        }
    }
}
