//! The criteria: what the vehicle does, against what it should do and what it can still be brought to.
//!
//! A vehicle that turns or moves away is judged by where it can be stopped. At a speed v away from
//! where it should be, with the delay `t_d` until another command acts and the braking a, it stands
//! still after
//!
//! ```text
//!   s = d + v t_d + v² / 2a          d: by how much it has moved away so far
//! ```
//!
//! *Away* counts only what the vehicle does itself: d grows and shrinks with its own motion, is never
//! below zero, and never more than the error there is. A set point that steps makes an error and no d,
//! and a vehicle that turns towards it has none either, however large the step. So one number tells a
//! wrong sign, a frozen output, a gain or a delay that diverges from a controller that is just busy, long
//! before the error itself is large. The same number tells of a vehicle that turns towards its set point so
//! fast that it will stand still only beyond it. Slower ailments show in errors that last, in swings from side to
//! side, and in a thrust that is not the one asked for.

use crate::limits::{Braking, Limits, stopping};
use crate::swings::{REVERSALS, SwingMemory, Swings};
use nalgebra::{UnitQuaternion, Vector3};
use shared_types::TripCause;
use vehicle::{
    MorphAngle, VehicleParameters, euler_from_quaternion, quaternion_from_euler, wrap_pi,
};

/// Window in which a body that swings is caught \[ns\]: with six reversals, from 3 Hz on.
const BODY_WINDOW_NS: u64 = 1_000_000_000;
/// Window in which a set point that swings is caught \[ns\], from 0.75 Hz on: position loops are slower.
const SETPOINT_WINDOW_NS: u64 = 4_000_000_000;
/// Time constant with which a difference in thrust is forgotten \[s\].
const THRUST_MEMORY_S: f64 = 0.5;
/// Depth below the reference from which height counts \[m\]: a vehicle that is to land sinks with it.
const SUNK_M: f64 = 0.3;
/// Time constant with which a past attitude error is forgotten \[s\], when one of two is to blame.
const BLAME_MEMORY_S: f64 = 0.3;

/// What the attitude loop is asked for, as its consumer tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Roll, pitch and yaw \[rad\], intrinsic z-y-x.
    pub gamma_rad: Vector3<f64>,
    /// Collective thrust \[N\].
    pub thrust_n: f64,
}

/// What the rotors were told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Applied {
    /// Collective thrust \[N\].
    pub thrust_n: f64,
    /// Somebody's command, and not what the gate makes up.
    pub is_commanded: bool,
}

/// What is known at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The instant \[ns\].
    pub now_ns: u64,
    /// Time since the moment before \[s\].
    pub elapsed_s: f64,
    /// β.
    pub morph_angle: MorphAngle,
    /// Attitude, body to world.
    pub q_wb: UnitQuaternion<f64>,
    /// Body rate \[rad/s\].
    pub rate_b_rad_s: Vector3<f64>,
    /// Position \[m\].
    pub position_w_m: Vector3<f64>,
    /// Velocity \[m/s\].
    pub velocity_w_m_s: Vector3<f64>,
    /// Set point of the attitude loop, once there is one.
    pub setpoint: Option<Setpoint>,
    /// What the rotors were told, once they were.
    pub applied: Option<Applied>,
    /// Position \[m\] and velocity \[m/s\] of the reference, if there is one.
    pub reference: Option<[Vector3<f64>; 2]>,
}

/// A number beyond its limit, in the unit that the cause's fields of `Trip` name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finding {
    /// What went wrong.
    pub cause: TripCause,
    /// The number.
    pub value: f64,
    /// Its limit.
    pub limit: f64,
    /// How long it has been so \[s\].
    pub lasted_s: f64,
}

shared_types::memory! {
    /// A [`Judge`] as plain numbers.
    #[derive(PartialEq)]
    pub struct JudgeMemory {
        /// By how much the vehicle has turned away about roll and pitch \[rad\].
        pub turned_rad: f64,
        /// The same of the heading \[rad\].
        pub heading_rad: f64,
        /// By how much it has moved away from its reference \[m\].
        pub moved_m: f64,
        /// How long the vehicle has been off its course of late \[s\].
        pub off_course_s: f64,
        /// How long the attitude error has been too large \[s\].
        pub astray_s: f64,
        /// Vertical speed of a thrust that was not the one asked for \[m/s\].
        pub thrust_speed_m_s: f64,
        /// Largest attitude error of late \[rad\].
        pub error_of_late_rad: f64,
        /// Body rate about roll and pitch.
        pub body: [SwingMemory; 2],
        /// Roll and pitch of the set point.
        pub asked: [SwingMemory; 2],
    }
}

/// What is found about each of the two loops.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Findings {
    /// What an attitude controller is to blame for.
    pub attitude: Option<Finding>,
    /// What a position controller is to blame for.
    pub position: Option<Finding>,
}

/// The judgement of one flight. Of fixed size; nothing here allocates or panics.
#[derive(Debug, Clone)]
pub struct Judge {
    limits: Limits,
    vehicle: VehicleParameters,
    /// Until another command acts: period of the judgement, latency of its trip, lag of the rotors \[s\].
    delay_s: f64,
    memory: JudgeMemory,
    body: [Swings; 2],
    asked: [Swings; 2],
}

/// Angle between body z and where `towards_w` points, and its rate \[rad, rad/s\].
fn angle_from(moment: &Moment, towards_w: &Vector3<f64>) -> [f64; 2] {
    let up = moment.q_wb.inverse_transform_vector(towards_w);
    let across = libm::hypot(up.x, up.y);
    let angle = libm::atan2(across, up.z);
    let rate = &moment.rate_b_rad_s;
    // Turning about ẑ × up = (−up_y, up_x, 0) brings body z there.
    let away = if across > 1e-9 {
        (rate.x * up.y - rate.y * up.x) / across
    } else {
        libm::hypot(rate.x, rate.y)
    };
    [angle, away]
}

/// How far a quantity has moved away by itself, with `speed` away over `elapsed_s`, at an error as large
/// as `error`.
fn moved(before: f64, speed: f64, elapsed_s: f64, error: f64) -> f64 {
    (before + speed * elapsed_s).clamp(0.0, error)
}

fn beyond(cause: TripCause, value: f64, limit: f64) -> Option<Finding> {
    (value > limit).then_some(Finding { cause, value, limit, lasted_s: 0.0 })
}

impl Judge {
    /// Judges a vehicle; `command_s` is the time from a judgement to its trip's effect, the period in
    /// which it is made included.
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

    /// Forgets what has been: it was another owner's doing.
    pub fn forget(&mut self) {
        self.memory = JudgeMemory::default();
        (self.body, self.asked) = ([Swings::default(); 2], [Swings::default(); 2]);
    }

    /// Judges the next moment. One with a number that is not finite is passed over.
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
        let moved = self.moved(moment, &braking);
        // With the attitude where it was asked to be, who asked is to blame for where that led.
        let followed = self.memory.error_of_late_rad < self.limits.astray_rad;
        let of_attitude = turned.or(swings).or(thrust);
        Findings {
            attitude: of_attitude.or(tilt.or(moved).filter(|_| !followed)),
            position: asked.or(tilt.or(moved).filter(|_| followed)),
        }
    }

    fn tilt(&self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let [tilt, away] = angle_from(moment, &Vector3::z());
        let reached = tilt + stopping(away, self.delay_s, braking.turn_rad_s2);
        beyond(TripCause::TiltBeyond, reached, self.limits.tilt_rad)
    }

    /// Roll, pitch and heading against their set points.
    fn turned(&mut self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let asked = moment.setpoint?.gamma_rad;
        let yaw = euler_from_quaternion(&moment.q_wb).z;
        // Roll and pitch are asked for at the heading that there is.
        let towards = quaternion_from_euler(&Vector3::new(asked.x, asked.y, yaw)) * Vector3::z();
        let [error, away] = angle_from(moment, &towards);
        let (memory, elapsed_s) = (&mut self.memory, moment.elapsed_s);
        memory.turned_rad = moved(memory.turned_rad, away, elapsed_s, error);
        let late = memory.error_of_late_rad * libm::exp(-elapsed_s / BLAME_MEMORY_S);
        memory.error_of_late_rad = error.max(late);
        let is_astray = error > self.limits.astray_rad;
        memory.astray_s = if is_astray { memory.astray_s + elapsed_s } else { 0.0 };

        let heading = wrap_pi(yaw - asked.z);
        let turn = moment.rate_b_rad_s.z * heading.signum();
        memory.heading_rad = moved(memory.heading_rad, turn, elapsed_s, heading.abs());

        // Too fast towards the set point to stand still there is as bad as away from it: what a late
        // controller that swings ever wider does, and half of a swing earlier.
        let overshoot = stopping(-away, self.delay_s, braking.turn_rad_s2) - error;
        let departure = memory.turned_rad + stopping(away, self.delay_s, braking.turn_rad_s2);
        let turned = departure.max(overshoot);
        let heading = memory.heading_rad + stopping(turn, self.delay_s, braking.yaw_rad_s2);
        let lasted_s = memory.astray_s;
        beyond(TripCause::AttitudeDeparts, turned, self.limits.turn_away_rad)
            .or(beyond(TripCause::HeadingDeparts, heading, self.limits.heading_rad))
            .or((lasted_s > self.limits.astray_s).then_some(Finding {
                cause: TripCause::AttitudeAstray,
                value: error,
                limit: self.limits.astray_rad,
                lasted_s,
            }))
    }

    fn swings(&mut self, moment: &Moment) -> Option<Finding> {
        let limit = self.limits.swing_rate_rad_s;
        let rates = [moment.rate_b_rad_s.x, moment.rate_b_rad_s.y];
        let mut found = None;
        for (swings, rate) in self.body.iter_mut().zip(rates) {
            if swings.see(moment.now_ns, rate, limit, BODY_WINDOW_NS) {
                let value = rate.abs();
                found = Some(Finding {
                    cause: TripCause::RateOscillates,
                    value,
                    limit,
                    lasted_s: BODY_WINDOW_NS as f64 * 1e-9,
                });
            }
        }
        found
    }

    /// The vertical speed that comes of a thrust other than the one asked for.
    fn thrust(&mut self, moment: &Moment) -> Option<Finding> {
        let (Some(setpoint), Some(applied)) = (moment.setpoint, moment.applied) else {
            return None;
        };
        let lacking = if applied.is_commanded && setpoint.thrust_n.is_finite() {
            let most = 4.0 * self.vehicle.rotor_thrust_max_n;
            setpoint.thrust_n.clamp(0.0, most) - applied.thrust_n
        } else {
            0.0
        };
        let kept = libm::exp(-moment.elapsed_s / THRUST_MEMORY_S);
        let gained = lacking / self.vehicle.mass_kg * moment.elapsed_s;
        self.memory.thrust_speed_m_s = self.memory.thrust_speed_m_s * kept + gained;
        let speed = self.memory.thrust_speed_m_s.abs();
        beyond(TripCause::ThrustAstray, speed, self.limits.thrust_speed_m_s)
    }

    /// What the set point asks for.
    fn asked(&mut self, moment: &Moment) -> Option<Finding> {
        // Only a flight with a reference has a position loop; on a rig any set point may be asked for.
        let _reference = moment.reference?;
        let asked = moment.setpoint?.gamma_rad;
        let tilt = libm::acos(libm::cos(asked.x) * libm::cos(asked.y));
        let limit = self.limits.swing_tilt_rad;
        let mut found = beyond(TripCause::SetpointBeyond, tilt, self.limits.setpoint_tilt_rad);
        for (swings, angle) in self.asked.iter_mut().zip([asked.x, asked.y]) {
            if swings.see(moment.now_ns, angle, limit, SETPOINT_WINDOW_NS) {
                found = found.or(Some(Finding {
                    cause: TripCause::SetpointOscillates,
                    value: angle.abs(),
                    limit,
                    lasted_s: SETPOINT_WINDOW_NS as f64 * 1e-9,
                }));
            }
        }
        found
    }

    /// Where the vehicle is against where it should be, and against the ground.
    fn moved(&mut self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let [place, speed] = moment.reference?;
        let error = moment.position_w_m - place;
        let velocity = moment.velocity_w_m_s - speed;
        let distance = error.norm();
        let away = if distance > 1e-6 { velocity.dot(&error) / distance } else { velocity.norm() };
        let memory = &mut self.memory;
        memory.moved_m = moved(memory.moved_m, away, moment.elapsed_s, distance);
        let delay_s = self.delay_s + braking.tilting_s;
        let excursion = memory.moved_m + stopping(away, delay_s, braking.across_m_s2);

        let sinking = stopping(-moment.velocity_w_m_s.z, delay_s, braking.up_m_s2);
        let height = moment.position_w_m.z - self.limits.height_m;
        let has_sunk = error.z < -SUNK_M && moment.velocity_w_m_s.z < 0.0;
        let sinks = beyond(TripCause::Sinks, sinking, height).filter(|_| has_sunk);

        // One that swings about its reference is off its course only part of the time.
        let limit = self.limits.off_course_m;
        let spent_s = if distance > limit { moment.elapsed_s } else { -0.5 * moment.elapsed_s };
        memory.off_course_s = (memory.off_course_s + spent_s).max(0.0);
        let lasted_s = memory.off_course_s;
        let is_off = (lasted_s > self.limits.off_course_s).then_some(Finding {
            cause: TripCause::PositionDeparts,
            value: distance.max(limit),
            limit,
            lasted_s,
        });
        let departs = beyond(TripCause::PositionDeparts, excursion, self.limits.excursion_m);
        sinks.or(departs).or(is_off)
    }

    /// Changes of side that make an oscillation.
    #[must_use]
    pub fn reversals() -> u64 {
        REVERSALS as u64
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> JudgeMemory {
        JudgeMemory {
            body: self.body.map(Swings::memory),
            asked: self.asked.map(Swings::memory),
            ..self.memory
        }
    }

    /// Continues from a memory, bit for bit.
    pub fn restore(&mut self, memory: &JudgeMemory) {
        self.memory = *memory;
        self.body = memory.body.each_ref().map(Swings::restored);
        self.asked = memory.asked.each_ref().map(Swings::restored);
        // What the arrays hold is kept there alone.
        self.memory.body = Default::default();
        self.memory.asked = Default::default();
    }
}

#[cfg(test)]
mod tests;
