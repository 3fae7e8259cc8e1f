//! Flat ground at z = 0 under four feet, one at each arm tip: spring, damper and friction.

use nalgebra::{UnitQuaternion, Vector3};

use crate::ParameterError;
use crate::parameter_error::positive;

/// One foot on the ground. Chosen for a 0.12 kg vehicle at steps of 1 ms: the fastest contact mode,
/// yaw and pitch on the smallest arms, decays at about 700 1/s, well inside RK4's reach of 2.8/dt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundContact {
    /// Normal stiffness of a foot \[N/m\].
    pub stiffness_n_m: f64,
    /// Normal damping of a foot \[N s/m\].
    pub damping_n_s_m: f64,
    /// Coulomb friction coefficient.
    pub friction: f64,
    /// Friction per slip speed while it sticks \[N s/m\]; a steady push creeps at push / (4 times
    /// this).
    pub slip_damping_n_s_m: f64,
}

impl Default for GroundContact {
    fn default() -> Self {
        Self { stiffness_n_m: 500.0, damping_n_s_m: 4.0, friction: 0.6, slip_damping_n_s_m: 4.0 }
    }
}

/// What the feet see of the body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FeetMotion<'a> {
    pub(crate) position_w: &'a Vector3<f64>,
    pub(crate) velocity_w: &'a Vector3<f64>,
    pub(crate) q_wb: &'a UnitQuaternion<f64>,
    pub(crate) omega_b: &'a Vector3<f64>,
    pub(crate) arm_length: f64,
}

impl GroundContact {
    /// Refuses a contact that does not push or damp.
    ///
    /// # Errors
    /// The first number that is not finite and above zero.
    pub fn validate(&self) -> Result<(), ParameterError> {
        const REMEDY: &str = "give a finite number above zero, or switch the ground off";
        positive("ground.stiffness_n_m", self.stiffness_n_m, REMEDY)?;
        positive("ground.damping_n_s_m", self.damping_n_s_m, REMEDY)?;
        positive("ground.friction", self.friction, REMEDY)?;
        positive("ground.slip_damping_n_s_m", self.slip_damping_n_s_m, REMEDY)
    }

    /// Force in W and torque in B on the body. A foot is as long as it sinks in under a quarter of
    /// `weight`, so that a vehicle at rest has its centre of mass at z = 0 exactly. The feet's own
    /// speed while the arms morph is left out: it is radial and cancels.
    pub(crate) fn wrench(&self, body: FeetMotion<'_>, weight: f64) -> (Vector3<f64>, Vector3<f64>) {
        let foot = 0.25 * weight / self.stiffness_n_m;
        let (mut force_w, mut torque_b) = (Vector3::zeros(), Vector3::zeros());
        if body.position_w.z > body.arm_length + foot {
            return (force_w, torque_b);
        }
        let l = body.arm_length;
        let tips = [(l, 0.0), (0.0, l), (-l, 0.0), (0.0, -l)];
        for tip in tips.map(|(x, y)| Vector3::new(x, y, 0.0)) {
            let depth = foot - (body.position_w + body.q_wb * tip).z;
            if depth > 0.0 {
                let v_w = body.velocity_w + body.q_wb * body.omega_b.cross(&tip);
                let f_w = self.foot_force(depth, &v_w);
                force_w += f_w;
                torque_b += tip.cross(&body.q_wb.inverse_transform_vector(&f_w));
            }
        }
        (force_w, torque_b)
    }

    fn foot_force(&self, depth: f64, v_w: &Vector3<f64>) -> Vector3<f64> {
        let normal = (self.stiffness_n_m * depth - self.damping_n_s_m * v_w.z).max(0.0);
        let slip = (v_w.x * v_w.x + v_w.y * v_w.y).sqrt();
        // Coulomb's limit, approached along a finite slope: a sign function has no RK4.
        let drag = if self.slip_damping_n_s_m * slip > self.friction * normal {
            self.friction * normal / slip
        } else {
            self.slip_damping_n_s_m
        };
        Vector3::new(-drag * v_w.x, -drag * v_w.y, normal)
    }
}
