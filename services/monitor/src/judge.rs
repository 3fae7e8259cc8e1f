//! The criteria of the monitor: the motion of the vehicle against its set point and its reference, and
//! against what can still be recovered from.
//!
//! A vehicle that turns or moves away from its target is judged by its predicted stopping point. At a speed
//! v away from the target, with the delay `t_d` until another command acts and the deceleration a, it comes
//! to rest at
//!
//! ```text
//!   s = d + v t_d + v² / 2a          d: distance or angle by which it has moved away so far
//! ```
//!
//! d is the integral of the vehicle's own speed away from the target, limited to the range from zero to the
//! present error. A step of the set point therefore changes the error but not d, and a vehicle that turns
//! towards its set point has d = 0, however large the step. The speed away that it has only because the set point
//! stepped to its other side is not counted as long as it is being braked. So one number separates a wrong sign, a frozen
//! output or an unstable gain or delay from a controller that answers a large step, long before the error
//! itself is large. The same number finds a vehicle that turns towards its set point so fast that it will
//! overshoot. Torque that is full for longer than one command, where it turns the vehicle beyond its set point, shows
//! sooner still, as the rotors lag behind it. Slower faults show as persistent errors, as oscillations, and as a thrust
//! that differs from the commanded one.
//!
//! Frames are world ENU and body FLU; quaternions are Hamilton, scalar first, from body to world.

mod attitude;
mod position;

use crate::finding::Finding;
use crate::limits::{Braking, Limits};
use crate::swings::{SwingMemory, Swings};
use controller::preview::Target;
use nalgebra::{UnitQuaternion, Vector3};
use vehicle::{MorphAngle, VehicleParameters};

/// Set point of the attitude loop, as its consumer reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Roll, pitch and yaw \[rad\], intrinsic z-y-x.
    pub gamma_rad: Vector3<f64>,
    /// Collective thrust \[N\].
    pub thrust_n: f64,
}

/// Command that the plant applied to the rotors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Applied {
    /// Collective thrust \[N\].
    pub thrust_n: f64,
    /// True if a controller gave the command, false if the actuation guard replaced it.
    pub is_commanded: bool,
    /// For how long commands have asked the rotors for more than they give, without a break \[s\].
    pub clipped_s: f64,
    /// For how long roll and pitch torque have been as large as the laws of the slot ask for, to one side, without a break
    /// and by more than one command \[s\], with the sign of the torque.
    pub full_s: [f64; 2],
    /// Roll and pitch torque behind the lag of the rotors \[N m\].
    pub lagged_nm: [f64; 2],
}

/// Inputs of the criteria at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The instant \[ns\].
    pub now_ns: u64,
    /// Time since the previous moment \[s\].
    pub elapsed_s: f64,
    /// Morph angle β.
    pub morph_angle: MorphAngle,
    /// Attitude: rotates vectors from body FLU to world ENU.
    pub q_wb: UnitQuaternion<f64>,
    /// Angular velocity of the body against the world, in body axes \[rad/s\].
    pub rate_b_rad_s: Vector3<f64>,
    /// Position in the world frame \[m\].
    pub position_w_m: Vector3<f64>,
    /// Velocity in the world frame \[m/s\].
    pub velocity_w_m_s: Vector3<f64>,
    /// Set point of the attitude loop; `None` before the first one.
    pub setpoint: Option<Setpoint>,
    /// What the position slot's owner asks for, whatever the attitude loop makes of it; `None` before the first one.
    pub asked: Option<Setpoint>,
    /// Period of the loop that asks \[s\].
    pub asked_every_s: f64,
    /// Command that the plant applied; `None` before the first one.
    pub applied: Option<Applied>,
    /// Whether the attitude and the position slot's owner have been replaced lately: where the vehicle is and how it
    /// leans then is their doing.
    pub recovers: [bool; 2],
    /// Whether the proven owner of the position slot has been silent lately: where the vehicle is then is its doing.
    pub is_unsteered: bool,
    /// What the reference asks for; `None` on a rig.
    pub reference: Option<Target>,
}

shared_types::memory! {
    /// State of a [`Judge`] as plain numbers, for the hand-over to a new process.
    #[derive(PartialEq)]
    pub struct JudgeMemory {
        /// Angle about roll and pitch by which the vehicle has turned away from its set point \[rad\].
        pub turned_rad: f64,
        /// Where the set point wants body z to point in the world frame.
        pub towards_w: [f64; 3],
        /// Whether there was one.
        pub has_target: bool,
        /// What is left of the attitude error that steps of the set point have made \[rad\].
        pub stepped_rad: f64,
        /// Rate away from the set point that the vehicle may still have because it stepped \[rad/s\].
        pub inherited_rad_s: f64,
        /// When the set point has last moved by more than the noise of an attitude \[ns\].
        pub retargeted_ns: u64,
        /// Angle by which the heading has turned away from its set point \[rad\].
        pub heading_rad: f64,
        /// Distance by which the vehicle has moved away from its reference \[m\].
        pub moved_m: f64,
        /// Acceleration by wind and other forces in the world frame \[m/s²\].
        pub push_w_m_s2: [f64; 3],
        /// Velocity at the moment before in the world frame \[m/s\].
        pub velocity_w_m_s: [f64; 3],
        /// Whether there was one.
        pub has_velocity: bool,
        /// Time that the vehicle has lately been far from its reference \[s\]; it decreases at half speed
        /// while the vehicle is close.
        pub off_course_s: f64,
        /// How long the set point has asked for another heading than the reference \[s\].
        pub heading_astray_s: f64,
        /// How long the attitude error has been too large \[s\].
        pub astray_s: f64,
        /// Vertical speed gained by applying another thrust than the set point asks for \[m/s\].
        pub thrust_speed_m_s: f64,
        /// Recent peak of the attitude error, decaying exponentially \[rad\].
        pub error_of_late_rad: f64,
        /// Oscillation counters of the body rate about roll and pitch.
        pub body: [SwingMemory; 2],
        /// Oscillation counters of roll and pitch of the set point.
        pub asked: [SwingMemory; 2],
    }
}

/// What is found about each of the two loops; `None` where nothing exceeds its limit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Findings {
    /// What an attitude controller is to blame for.
    pub attitude: Option<Finding>,
    /// What a position controller is to blame for.
    pub position: Option<Finding>,
    /// What a position controller asks for and may not, for which nothing else is to blame.
    pub asked: Option<Finding>,
    /// What an attitude controller commands and may not, for which nothing else is to blame.
    pub commanded: Option<Finding>,
}

/// Applies the criteria to one flight. It has a fixed size, and none of its functions allocates or panics,
/// because the monitor runs in realtime.
#[derive(Debug, Clone)]
pub struct Judge {
    limits: Limits,
    vehicle: VehicleParameters,
    /// Delay until another command acts \[s\]: period of the monitor, latency of its trip, rotor lag.
    delay_s: f64,
    memory: JudgeMemory,
    body: [Swings; 2],
    asked: [Swings; 2],
}

impl Judge {
    /// A judge of this vehicle; `command_s` is the time from a change in the estimate to the effect of its
    /// trip \[s\]: period of the monitor and latency of the trip.
    #[must_use]
    pub fn new(limits: Limits, vehicle: &VehicleParameters, command_s: f64) -> Self {
        Self {
            limits,
            vehicle: *vehicle,
            delay_s: command_s + vehicle.rotor_lag_s,
            memory: JudgeMemory::default(),
            body: [Swings::default(); 2],
            asked: [Swings::default(); 2],
        }
    }

    /// Resets the state after a change of owner, since the new owner did not cause what came before. `of_position`: the
    /// position slot has another owner, so that how far the vehicle is from its path and what has been asked for is not
    /// its doing either.
    pub fn forget(&mut self, of_position: bool) {
        self.forget_attitude();
        if of_position {
            self.asked = [Swings::default(); 2];
            self.memory.moved_m = 0.0;
            self.memory.off_course_s = 0.0;
            self.memory.heading_astray_s = 0.0;
        }
    }

    /// Resets what concerns the attitude alone, of which another one than the owner has disposed.
    pub fn forget_attitude(&mut self) {
        let before = self.memory;
        // Neither the wind nor the way is any attitude controller's doing.
        self.memory = JudgeMemory {
            push_w_m_s2: before.push_w_m_s2,
            velocity_w_m_s: before.velocity_w_m_s,
            has_velocity: before.has_velocity,
            moved_m: before.moved_m,
            off_course_s: before.off_course_s,
            heading_astray_s: before.heading_astray_s,
            ..JudgeMemory::default()
        };
        self.body = [Swings::default(); 2];
    }

    /// Judges the next moment. A moment with a number that is not finite is skipped: a failed estimate is
    /// not the controller's fault.
    pub fn see(&mut self, moment: &Moment) -> Findings {
        let numbers = moment.rate_b_rad_s.iter().chain(&moment.position_w_m);
        let attitude = moment.q_wb.coords.iter();
        if !numbers.chain(&moment.velocity_w_m_s).chain(attitude).all(|n| n.is_finite()) {
            return Findings::default();
        }
        let braking = Braking::at(&self.vehicle, moment.morph_angle);
        let tilt = self.tilt(moment, &braking);
        let turned = self.turned(moment, &braking);
        let swings = self.swings(moment);
        let thrust = self.thrust(moment);
        let asked = self.asked(moment);
        let moved = self.moved(moment, &braking).filter(|_| !moment.is_unsteered);
        // If the attitude followed its set point, the set point led the vehicle there, and the position
        // controller, which gave it, is to blame.
        let followed = self.memory.error_of_late_rad < self.limits.astray_rad;
        let of_attitude = turned.or(swings).or(thrust).or(self.clipped(moment));
        let [after_attitude, after_position] = moment.recovers;
        let course = tilt.filter(|_| !after_attitude).or(moved).filter(|_| !after_position);
        let of_position = followed || after_attitude;
        let commanded = self.commanded(moment, &braking).filter(|_| !after_position);
        Findings {
            attitude: of_attitude.or(course.filter(|_| !of_position)),
            position: course.filter(|_| of_position),
            asked,
            commanded,
        }
    }

    /// Largest tilt, predicted \[rad\].
    pub(crate) fn tilt_limit_rad(&self) -> f64 {
        self.limits.tilt_rad
    }

    /// State between two steps.
    #[must_use]
    pub fn memory(&self) -> JudgeMemory {
        JudgeMemory {
            body: self.body.map(Swings::memory),
            asked: self.asked.map(Swings::memory),
            ..self.memory
        }
    }

    /// Continues from a state as the original would, bit for bit.
    pub fn restore(&mut self, memory: &JudgeMemory) {
        self.memory = *memory;
        self.body = memory.body.each_ref().map(Swings::restored);
        self.asked = memory.asked.each_ref().map(Swings::restored);
        // The counters live in `body` and `asked` alone; a second copy here would go stale.
        self.memory.body = Default::default();
        self.memory.asked = Default::default();
    }
}

#[cfg(test)]
mod tests;
