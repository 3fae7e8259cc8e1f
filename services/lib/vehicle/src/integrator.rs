//! Runge-Kutta 4 for a rigid body. The quaternion is integrated in its embedding space and projected
//! back onto the unit sphere after each step, which keeps the order
//! [Hairer, Lubich, Wanner 2006, Ch. IV.4].

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::canonical;

/// The integrated part of the state, with the quaternion as free numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RigidBody {
    pub(crate) position_w: Vector3<f64>,
    pub(crate) velocity_w: Vector3<f64>,
    pub(crate) q: Quaternion<f64>,
    pub(crate) omega_b: Vector3<f64>,
}

/// What the equations of motion answer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Acceleration {
    pub(crate) linear_w: Vector3<f64>,
    pub(crate) angular_b: Vector3<f64>,
}

/// Instant inside a step at which the equations of motion are asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    Start,
    Middle,
    End,
}

impl RigidBody {
    /// The attitude of a stage.
    pub(crate) fn attitude(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(self.q)
    }

    fn rate(&self, acceleration: Acceleration) -> Self {
        Self {
            position_w: self.velocity_w,
            velocity_w: acceleration.linear_w,
            // q̇ = ½ q ⊗ (0, ω)
            q: self.q * Quaternion::from_imag(self.omega_b) * 0.5,
            omega_b: acceleration.angular_b,
        }
    }

    fn plus(&self, h: f64, rate: &Self) -> Self {
        Self {
            position_w: self.position_w + rate.position_w * h,
            velocity_w: self.velocity_w + rate.velocity_w * h,
            q: self.q + rate.q * h,
            omega_b: self.omega_b + rate.omega_b * h,
        }
    }
}

/// One step of `h` seconds; `motion` gives the accelerations at a stage.
pub(crate) fn rk4(
    start: &RigidBody,
    h: f64,
    motion: impl Fn(Stage, &RigidBody) -> Acceleration,
) -> RigidBody {
    let rate = |stage, body: &RigidBody| body.rate(motion(stage, body));
    let k1 = rate(Stage::Start, start);
    let k2 = rate(Stage::Middle, &start.plus(0.5 * h, &k1));
    let k3 = rate(Stage::Middle, &start.plus(0.5 * h, &k2));
    let k4 = rate(Stage::End, &start.plus(h, &k3));
    let mut end = start.plus(h / 6.0, &k1).plus(h / 3.0, &k2).plus(h / 3.0, &k3).plus(h / 6.0, &k4);
    end.q = canonical(end.attitude()).into_inner();
    end
}
