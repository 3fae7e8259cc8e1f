//! Rotation vectors and quaternions: the maps Exp and Log of Solà, section 2.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Below this angle \[rad\] the series to second order is exact to rounding.
const SMALL_ANGLE_RAD: f64 = 1e-5;

/// Exp: unit quaternion of a rotation vector \[rad\] (Solà eq. 101).
pub(super) fn exp(phi: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = phi.norm();
    let (w, scale) = if angle < SMALL_ANGLE_RAD {
        (1.0 - angle * angle / 8.0, 0.5 - angle * angle / 48.0)
    } else {
        let (s, c) = libm::sincos(0.5 * angle);
        (c, s / angle)
    };
    let v = phi * scale;
    UnitQuaternion::new_unchecked(Quaternion::new(w, v.x, v.y, v.z))
}

/// Log: rotation vector \[rad\] of a unit quaternion, the shorter way round (Solà eq. 105).
pub(super) fn log(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let q = vehicle::canonical(*q);
    let v = q.imag();
    let sine = v.norm();
    if sine < SMALL_ANGLE_RAD {
        return v * (2.0 / q.w);
    }
    v * (2.0 * libm::atan2(sine, q.w) / sine)
}

/// Product of two rotations, brought back to unit length, because rounding accumulates over a flight.
pub(super) fn compose(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(a.into_inner() * b.into_inner())
}

/// Rotation matrix of a unit quaternion (Solà eq. 115).
pub(super) fn matrix(q: &UnitQuaternion<f64>) -> Matrix3<f64> {
    q.to_rotation_matrix().into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_undoes_exp_from_rounding_size_to_almost_half_a_turn() {
        for angle in [0.0, 1e-12, 9.9e-6, 1.01e-5, 1e-3, 0.5, 3.1] {
            let phi = Vector3::new(0.36, -0.48, 0.8) * angle;
            let back = log(&exp(&phi));
            assert!((back - phi).norm() <= 1e-15 + 1e-14 * angle, "{angle}: {back}");
        }
    }

    #[test]
    fn log_takes_the_shorter_way_for_either_sign_of_the_quaternion() {
        let q = exp(&Vector3::new(0.1, -0.2, 0.3));
        let flipped = UnitQuaternion::new_unchecked(-q.into_inner());
        assert_eq!(log(&q), log(&flipped));
    }

    #[test]
    fn exp_agrees_with_an_independent_implementation() {
        let phi = Vector3::new(0.7, -1.1, 0.4);
        let theirs = UnitQuaternion::from_scaled_axis(phi);
        assert!(exp(&phi).angle_to(&theirs) < 1e-12);
        let wanted = nalgebra::Rotation3::from_scaled_axis(phi).into_inner();
        assert!((matrix(&exp(&phi)) - wanted).norm() < 1e-14);
    }
}
