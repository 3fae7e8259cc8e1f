//! What the vehicle can do, which sizes challenges and tube alike.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use vehicle::{MorphAngle, VehicleParameters};

/// The slot that a candidate is to take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Slot {
    /// Torques for the attitude set point.
    Attitude,
    /// Thrust and tilt for the trajectory.
    Position,
}

/// What is known of the vehicle, its loops and its plan.
#[derive(Debug, Clone, Copy)]
pub struct Facts {
    /// As everybody models it.
    pub vehicle: VehicleParameters,
    /// β at the beginning \[rad\].
    pub morph_angle_rad: f64,
    /// Bound of the position controller on roll and pitch \[rad\].
    pub tilt_max_rad: f64,
    /// Period of the attitude loop \[s\].
    pub attitude_period_s: f64,
    /// Period of the position loop \[s\].
    pub position_period_s: f64,
    /// From a set point and from a command to their effect, together \[s\].
    pub latency_s: f64,
    /// Largest speed of the reference in the time rehearsed \[m/s\].
    pub speed_m_s: f64,
    /// Largest acceleration of the reference in the time rehearsed \[m/s²\].
    pub acceleration_m_s2: f64,
    /// There is no position loop: the pilot sets attitudes.
    pub is_rig: bool,
    /// There is ground at z = 0.
    pub ground: bool,
}

/// Bounds that follow from [`Facts`].
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Largest angular acceleration about each body axis within the torque bounds of hover \[rad/s²\].
    pub acceleration_b_rad_s2: [f64; 3],
    /// From a kick to full torque: a sample is waited for, the command takes effect, the rotors
    /// follow \[s\].
    pub reaction_s: f64,
    /// Jump of the body rate about each axis by which a kick shakes the vehicle \[rad/s\].
    pub kick_b_rad_s: [f64; 3],
    /// Angle that such a kick leads to before full torque has stopped it \[rad\].
    pub stopping_b_rad: [f64; 3],
    /// Acceleration at the tilt bound \[m/s²\].
    pub lateral_m_s2: f64,
    /// Time in which a tilt is reached that was asked for \[s\].
    pub tilting_s: f64,
    /// Jump of the velocity along each axis by which a push shakes the vehicle \[m/s\].
    pub push_m_s: [f64; 3],
    /// Way that such a push leads to before the tilt bound has stopped it \[m\].
    pub stopping_m: f64,
}

/// A push is over within this time \[s\].
pub(crate) const PUSH_S: f64 = 0.05;

impl Limits {
    /// Of a vehicle.
    ///
    /// A kick is half of what full torque does within the reaction time of the loop: Δω = α t/2. Full torque
    /// stops it in half of that time again, so that the angle reached is Δω t + Δω²/2α = 5/8 α t². A push
    /// is one level up: Δv = a t with a = g tan θmax and the time t in which a tilt is there, and the way
    /// Δv t + Δv²/2a = 3/2 a t².
    #[must_use]
    pub fn of(facts: &Facts) -> Self {
        let vehicle = &facts.vehicle;
        let beta =
            MorphAngle::saturating_from_rad(facts.morph_angle_rad).unwrap_or(MorphAngle::MIN);
        let weight_n = vehicle.weight_n();
        let bound = vehicle.torque_bound_nm(beta, weight_n);
        let alpha: Vector3<f64> = bound.component_div(&vehicle.inertia_kg_m2(beta));
        let reaction_s = facts.attitude_period_s + facts.latency_s + vehicle.rotor_lag_s;
        let kick = alpha * (0.5 * reaction_s);
        let stopping = kick * (1.25 * reaction_s);
        let lateral_m_s2 = vehicle.gravity_m_s2 * libm::tan(facts.tilt_max_rad);
        // Half of the way to the bound at full torque, and as much to stop there.
        let turning_s = 2.0 * (facts.tilt_max_rad / alpha.x.min(alpha.y)).sqrt();
        let tilting_s = facts.position_period_s + reaction_s + turning_s;
        let push = lateral_m_s2 * tilting_s;
        Self {
            acceleration_b_rad_s2: alpha.into(),
            reaction_s,
            kick_b_rad_s: kick.into(),
            stopping_b_rad: stopping.into(),
            lateral_m_s2,
            tilting_s,
            push_m_s: [push; 3],
            stopping_m: 1.5 * push * tilting_s,
        }
    }
}
