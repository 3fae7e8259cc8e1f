//! Equations of motion, (1), (2), (4) and (5), with the attitude as a quaternion.
//!
//! Beyond the paper: İω while morphing, drag against the wind, ground, disturbances.

use nalgebra::Vector3;

use crate::contact::FeetMotion;
use crate::integrator::{Acceleration, RigidBody};
use crate::{Disturbance, GroundContact, VehicleParameters, Wrench};

/// The actuators at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActuatorSample {
    /// Produced by the rotors, losses included.
    pub(crate) wrench: Wrench,
    pub(crate) arm_length: f64,
    /// I(β), principal.
    pub(crate) inertia: Vector3<f64>,
    /// İ = dI/dβ β̇.
    pub(crate) inertia_rate: Vector3<f64>,
}

/// Everything about the world that does not change inside a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    pub(crate) parameters: &'a VehicleParameters,
    pub(crate) ground: Option<&'a GroundContact>,
    pub(crate) disturbance: &'a Disturbance,
}

impl Surroundings<'_> {
    /// v̇ in W and ω̇ in B.
    pub(crate) fn acceleration(
        &self,
        actuators: &ActuatorSample,
        body: &RigidBody,
    ) -> Acceleration {
        let (p, d) = (self.parameters, self.disturbance);
        let q_wb = body.attitude();
        let mut force_w = q_wb * Vector3::new(0.0, 0.0, actuators.wrench.thrust_n)
            + (d.wind_w_m_s - body.velocity_w) * p.drag_n_s_m
            + d.force_w_n;
        let mut torque_b = actuators.wrench.torque_b_nm + d.torque_b_nm;
        if let Some(ground) = self.ground {
            let feet = FeetMotion {
                position_w: &body.position_w,
                velocity_w: &body.velocity_w,
                q_wb: &q_wb,
                omega_b: &body.omega_b,
                arm_length: actuators.arm_length,
            };
            let (f_w, tau_b) = ground.wrench(feet, p.weight_n() + d.payload_kg * p.gravity_m_s2);
            force_w += f_w;
            torque_b += tau_b;
        }
        let (inertia, omega) = (&actuators.inertia, &body.omega_b);
        // m v̇ = −m g e₃ + R (0, 0, T) + drag + contact + disturbance   (2)
        let linear_w =
            force_w / (p.mass_kg + d.payload_kg) - Vector3::new(0.0, 0.0, p.gravity_m_s2);
        // I ω̇ = τ − İ ω − ω × I ω   (4) and the İ ω that it leaves out
        let spin = inertia.component_mul(omega);
        let rhs = torque_b - actuators.inertia_rate.component_mul(omega) - omega.cross(&spin);
        Acceleration { linear_w, angular_b: rhs.component_div(inertia) }
    }
}
