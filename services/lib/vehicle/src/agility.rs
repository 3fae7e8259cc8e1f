//! How fast a vehicle can turn and move aside, from which limits of its motion are derived.

use crate::{MorphAngle, VehicleParameters};
use nalgebra::Vector3;

/// What the rotors can do to a vehicle that hovers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agility {
    /// Angular acceleration about each body axis at hover thrust, α = τ / I(β) \[rad/s²\].
    pub acceleration_b_rad_s2: Vector3<f64>,
    /// Horizontal acceleration at the tilt bound, g tan θ \[m/s²\].
    pub lateral_m_s2: f64,
}

impl Agility {
    /// Of a vehicle at the morph angle `beta` whose tilt is bounded by `tilt_max_rad` \[rad\].
    ///
    /// At hover thrust each pair of rotors carries half of the weight: τ = m g L(β) / 2 about roll and pitch, k m g
    /// about yaw ([`VehicleParameters::largest_wrench`]).
    #[must_use]
    pub fn at(vehicle: &VehicleParameters, beta: MorphAngle, tilt_max_rad: f64) -> Self {
        let [_, roll_nm, pitch_nm, yaw_nm] = vehicle.largest_wrench(beta);
        let torque_b_nm = Vector3::new(roll_nm, pitch_nm, yaw_nm);
        Self {
            acceleration_b_rad_s2: torque_b_nm.component_div(&vehicle.inertia_kg_m2(beta)),
            lateral_m_s2: vehicle.gravity_m_s2 * libm::tan(tilt_max_rad),
        }
    }

    /// Angular acceleration about the slower one of roll and pitch \[rad/s²\].
    #[must_use]
    pub fn tilting_rad_s2(&self) -> f64 {
        self.acceleration_b_rad_s2.x.min(self.acceleration_b_rad_s2.y)
    }

    /// Time to change the tilt by `angle_rad`, 2 √(Δ/α): full torque accelerates for half of the time and brakes for
    /// the other half \[s\].
    #[must_use]
    pub fn tilting_s(&self, angle_rad: f64) -> f64 {
        2.0 * (angle_rad / self.tilting_rad_s2()).sqrt()
    }
}
