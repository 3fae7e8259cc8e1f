//! Capabilities of the vehicle, from which the size of the challenges and of the tube follow.

use shared_types::{PerSlot, Slot};
use vehicle::{Agility, MorphAngle, VehicleParameters};

/// Replaces an error that is not a number, because JSON cannot represent NaN.
pub(crate) const NOT_FINITE: f64 = f64::MAX;

/// Parameters of the vehicle, its loops and its plan that a rehearsal depends on.
#[derive(Debug, Clone, Copy)]
pub struct Facts {
    /// Nominal parameters, which the controllers use as their model.
    pub vehicle: VehicleParameters,
    /// Morph angle β at the beginning \[rad\].
    pub morph_angle_rad: f64,
    /// Bound of the position controller on roll and pitch \[rad\].
    pub tilt_max_rad: f64,
    /// Period of the loop in a slot \[s\].
    pub period_s: PerSlot<f64>,
    /// Sum of the latencies of the attitude set point and of the wrench command \[s\].
    pub latency_s: f64,
    /// Largest speed of the reference during the rehearsal \[m/s\].
    pub speed_m_s: f64,
    /// Largest acceleration of the reference during the rehearsal \[m/s²\].
    pub acceleration_m_s2: f64,
    /// True on a rig, which has no position loop: the pilot publishes attitude set points.
    pub is_rig: bool,
    /// True if there is ground at z = 0.
    pub ground: bool,
}

/// Bounds that follow from [`Facts`].
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Largest angular acceleration about each body axis within the torque bounds of hover \[rad/s²\].
    pub acceleration_b_rad_s2: [f64; 3],
    /// Reaction time from a kick to full torque \[s\]: control period, latencies and rotor lag.
    pub reaction_s: f64,
    /// Change of the body rate about each body axis by a kick \[rad/s\].
    pub kick_b_rad_s: [f64; 3],
    /// Angle that such a kick causes until full torque has stopped it, per body axis \[rad\].
    pub stopping_b_rad: [f64; 3],
    /// Horizontal acceleration at the tilt bound \[m/s²\].
    pub lateral_m_s2: f64,
    /// Time from a deviation in position until the vehicle has reached the commanded tilt \[s\].
    pub tilting_s: f64,
    /// Change of the velocity along each world axis by a push \[m/s\].
    pub push_m_s: [f64; 3],
    /// Distance that such a push causes until a tilt at the bound has stopped it \[m\].
    pub stopping_m: f64,
}

/// Duration of a push \[s\].
pub(crate) const PUSH_S: f64 = 0.05;

impl Limits {
    /// Derives the bounds for a vehicle and its loops.
    ///
    /// A kick is half of what full torque does within the reaction time t of the loop: Δω = α t/2. Full
    /// torque stops it in another t/2, so that the angle reached is Δω t + Δω²/2α = 5/8 α t². A push is its
    /// counterpart for the position loop: Δv = a t with a = g tan θmax and the time t until the commanded
    /// tilt is reached, which leads to the distance Δv t + Δv²/2a = 3/2 a t².
    #[must_use]
    pub fn of(facts: &Facts) -> Self {
        let vehicle = &facts.vehicle;
        let beta =
            MorphAngle::saturating_from_rad(facts.morph_angle_rad).unwrap_or(MorphAngle::MIN);
        let agility = Agility::at(vehicle, beta, facts.tilt_max_rad);
        let Agility { acceleration_b_rad_s2: alpha, lateral_m_s2 } = agility;
        let reaction_s = facts.period_s[Slot::Attitude] + facts.latency_s + vehicle.rotor_lag_s;
        let kick = alpha * (0.5 * reaction_s);
        let stopping = kick * (1.25 * reaction_s);
        let turning_s = agility.tilting_s(facts.tilt_max_rad);
        let tilting_s = facts.period_s[Slot::Position] + reaction_s + turning_s;
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
