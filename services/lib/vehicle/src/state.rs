//! What a plant is: its state, what acts on it, and what a perfect observer would see.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::{MorphAngle, ParameterError, VehicleParameters, Wrench};

/// Numbers in a plant model's memory.
pub const MODEL_MEMORY_LEN: usize = 19;

/// State of the vehicle: rigid body, rotors and morph servo. All SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBodyState {
    /// Position of the centre of mass \[m\] in W.
    pub position_w: Vector3<f64>,
    /// Velocity \[m/s\] in W.
    pub velocity_w: Vector3<f64>,
    /// Attitude, body to world.
    pub q_wb: UnitQuaternion<f64>,
    /// Body rate ω \[rad/s\] in B.
    pub omega_b: Vector3<f64>,
    /// Rotor thrusts \[N\], behind the rotor lag and before any loss of efficiency.
    pub rotor_thrust_n: [f64; 4],
    /// Morph angle β.
    pub beta: MorphAngle,
    /// β̇ \[rad/s\] under the command last in effect.
    pub beta_rate_rad_s: f64,
}

impl RigidBodyState {
    /// Hover trim: level, at rest, each rotor at a quarter of the weight.
    #[must_use]
    pub fn hover(
        parameters: &VehicleParameters,
        position_w: Vector3<f64>,
        beta: MorphAngle,
    ) -> Self {
        Self {
            position_w,
            velocity_w: Vector3::zeros(),
            q_wb: UnitQuaternion::identity(),
            omega_b: Vector3::zeros(),
            rotor_thrust_n: [0.25 * parameters.weight_n(); 4],
            beta,
            beta_rate_rad_s: 0.0,
        }
    }

    /// Refuses a state that no plant can start from.
    ///
    /// # Errors
    /// The first number that is not finite, or a quaternion that is not unit to 1e-6.
    pub fn validate(&self) -> Result<(), ParameterError> {
        let bad = self.to_array().into_iter().find(|x| !x.is_finite());
        let norm = self.q_wb.quaternion().norm();
        if let Some(value) = bad {
            let remedy = "every number of the state must be finite";
            Err(ParameterError { name: "initial_state", value, remedy })
        } else if (norm - 1.0).abs() > 1e-6 {
            let remedy = "normalise the attitude quaternion";
            Err(ParameterError { name: "initial_state.q_wb", value: norm, remedy })
        } else {
            Ok(())
        }
    }

    /// All numbers in a fixed order: position, velocity, q (w, x, y, z), ω, thrusts, β, β̇.
    #[must_use]
    pub fn to_array(&self) -> [f64; MODEL_MEMORY_LEN] {
        let (p, v, q, w) = (&self.position_w, &self.velocity_w, &self.q_wb, &self.omega_b);
        let [f1, f2, f3, f4] = self.rotor_thrust_n;
        let (beta, rate) = (self.beta.rad(), self.beta_rate_rad_s);
        [
            p.x, p.y, p.z, v.x, v.y, v.z, q.w, q.i, q.j, q.k, w.x, w.y, w.z, f1, f2, f3, f4, beta,
            rate,
        ]
    }

    /// The state of [`to_array`](Self::to_array), bit for bit. `None` if a number is not finite,
    /// the quaternion is not unit to 1e-6, a thrust is negative or β is out of range.
    #[must_use]
    pub fn from_array(values: &[f64; MODEL_MEMORY_LEN]) -> Option<Self> {
        let [px, py, pz, vx, vy, vz, qw, qx, qy, qz, wx, wy, wz, f1, f2, f3, f4, beta, rate] =
            *values;
        let q = Quaternion::new(qw, qx, qy, qz);
        let rotor_thrust_n = [f1, f2, f3, f4];
        let usable = values.iter().all(|v| v.is_finite())
            && (q.norm() - 1.0).abs() < 1e-6
            && rotor_thrust_n.iter().all(|f| *f >= 0.0);
        if !usable {
            return None;
        }
        Some(Self {
            position_w: Vector3::new(px, py, pz),
            velocity_w: Vector3::new(vx, vy, vz),
            // Not normalised again: a restored state must continue with the same bits.
            q_wb: UnitQuaternion::new_unchecked(q),
            omega_b: Vector3::new(wx, wy, wz),
            rotor_thrust_n,
            beta: MorphAngle::from_rad(beta).ok()?,
            beta_rate_rad_s: rate,
        })
    }
}

/// What acts on the vehicle besides its actuators.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disturbance {
    /// Force at the centre of mass \[N\] in W.
    pub force_w_n: Vector3<f64>,
    /// Torque \[N m\] in B.
    pub torque_b_nm: Vector3<f64>,
    /// Wind velocity \[m/s\] in W.
    pub wind_w_m_s: Vector3<f64>,
    /// Produced over nominal thrust and drag torque of each rotor, 1 for a healthy one.
    pub rotor_efficiency: [f64; 4],
    /// Mass \[kg\] attached at the centre of mass.
    pub payload_kg: f64,
}

impl Default for Disturbance {
    /// Calm air, healthy rotors, no payload.
    fn default() -> Self {
        Self {
            force_w_n: Vector3::zeros(),
            torque_b_nm: Vector3::zeros(),
            wind_w_m_s: Vector3::zeros(),
            rotor_efficiency: [1.0; 4],
            payload_kg: 0.0,
        }
    }
}

impl Disturbance {
    /// True if every number is finite and neither payload nor an efficiency is negative.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        [self.force_w_n, self.torque_b_nm, self.wind_w_m_s]
            .iter()
            .all(|v| v.iter().all(|x| x.is_finite()))
            && self.rotor_efficiency.iter().all(|e| *e >= 0.0 && e.is_finite())
            && self.payload_kg >= 0.0
            && self.payload_kg.is_finite()
    }
}

/// What a perfect observer on board sees at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// The state.
    pub state: RigidBodyState,
    /// The wrench that the rotors produce now, losses of efficiency included.
    pub wrench: Wrench,
    /// Acceleration \[m/s²\] in W.
    pub acceleration_w_m_s2: Vector3<f64>,
    /// Specific force \[m/s²\] in B, what an ideal accelerometer at the centre of mass reads.
    pub specific_force_b_m_s2: Vector3<f64>,
    /// ω̇ \[rad/s²\] in B.
    pub angular_acceleration_b_rad_s2: Vector3<f64>,
}
