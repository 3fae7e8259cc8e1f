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
//! towards its set point has d = 0, however large the step. So one number separates a wrong sign, a frozen
//! output or an unstable gain or delay from a controller that answers a large step, long before the error
//! itself is large. The same number finds a vehicle that turns towards its set point so fast that it will
//! overshoot. Slower faults show as persistent errors, as oscillations, and as a thrust that differs from
//! the commanded one.
//!
//! Frames are world ENU and body FLU; quaternions are Hamilton, scalar first, from body to world.

use crate::limits::{Braking, Limits, stopping};
use crate::swings::{REVERSALS, SwingMemory, Swings};
use controller::preview::Target;
use nalgebra::{UnitQuaternion, Vector3};
use shared_types::TripCause;
use vehicle::{
    MorphAngle, VehicleParameters, euler_from_quaternion, quaternion_from_euler, wrap_pi,
};

/// Window in which an oscillation of the body is detected \[ns\]: with six reversals, from 3 Hz on.
const BODY_WINDOW_NS: u64 = 1_000_000_000;
/// Window in which an oscillation of the set point is detected \[ns\], from 0.75 Hz on: position loops are
/// slower than attitude loops.
const SETPOINT_WINDOW_NS: u64 = 4_000_000_000;
/// Time constant of the leaky integrator of the thrust error \[s\].
const THRUST_MEMORY_S: f64 = 0.5;
/// Time constant with which the acceleration by wind and other forces is averaged \[s\].
const PUSH_MEMORY_S: f64 = 0.5;
/// Share of the horizontal acceleration that is left for braking in any wind.
const LEAST_BRAKING: f64 = 0.3;
/// How long a set point may ask for another heading than the reference \[s\], and three periods of its loop longer: it is
/// as much older.
const HEADING_S: f64 = 0.1;
/// Depth below the reference from which the height above ground is checked \[m\]. A vehicle that lands stays
/// close to its descending reference and is not checked.
const SUNK_M: f64 = 0.3;
/// Time constant with which the peak of the attitude error decays \[s\]; that peak decides which of the two
/// loops is to blame.
const BLAME_MEMORY_S: f64 = 0.3;

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
    /// What the reference asks for; `None` on a rig.
    pub reference: Option<Target>,
}

/// A number beyond its limit. Its unit is that of the fields of `Trip` that belong to the cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finding {
    /// What went wrong.
    pub cause: TripCause,
    /// The measured or predicted number.
    pub value: f64,
    /// The limit that it exceeds.
    pub limit: f64,
    /// How long the fault has lasted \[s\]; 0 for criteria without a duration.
    pub lasted_s: f64,
}

shared_types::memory! {
    /// State of a [`Judge`] as plain numbers, for the hand-over to a new process.
    #[derive(PartialEq)]
    pub struct JudgeMemory {
        /// Angle about roll and pitch by which the vehicle has turned away from its set point \[rad\].
        pub turned_rad: f64,
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

/// Angle between body z and the unit vector `towards_w`, which is given in the world frame, and the rate of
/// that angle \[rad, rad/s\].
fn angle_from(moment: &Moment, towards_w: &Vector3<f64>) -> [f64; 2] {
    let up = moment.q_wb.inverse_transform_vector(towards_w);
    let across = libm::hypot(up.x, up.y);
    let angle = libm::atan2(across, up.z);
    let rate = &moment.rate_b_rad_s;
    // A rotation about ẑ × up = (−up_y, up_x, 0) brings body z to that direction.
    let away = if across > 1e-9 {
        (rate.x * up.y - rate.y * up.x) / across
    } else {
        libm::hypot(rate.x, rate.y)
    };
    [angle, away]
}

/// Integrates the motion away from the target: `before` is the last value, `speed` the speed away over
/// `elapsed_s`, and the present `error` limits the result, so that a step of the target does not count.
fn moved(before: f64, speed: f64, elapsed_s: f64, error: f64) -> f64 {
    (before + speed * elapsed_s).clamp(0.0, error)
}

fn beyond(cause: TripCause, value: f64, limit: f64) -> Option<Finding> {
    (value > limit).then_some(Finding { cause, value, limit, lasted_s: 0.0 })
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

    /// Resets the state after a change of owner, since the new owner did not cause what came before.
    pub fn forget(&mut self) {
        // The wind is no owner's doing.
        let JudgeMemory { push_w_m_s2, velocity_w_m_s, has_velocity, .. } = self.memory;
        self.memory =
            JudgeMemory { push_w_m_s2, velocity_w_m_s, has_velocity, ..JudgeMemory::default() };
        (self.body, self.asked) = ([Swings::default(); 2], [Swings::default(); 2]);
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
        let moved = self.moved(moment, &braking);
        // If the attitude followed its set point, the set point led the vehicle there, and the position
        // controller, which gave it, is to blame.
        let followed = self.memory.error_of_late_rad < self.limits.astray_rad;
        let of_attitude = turned.or(swings).or(thrust).or(self.clipped(moment));
        let [after_attitude, after_position] = moment.recovers;
        let course = tilt.filter(|_| !after_attitude).or(moved).filter(|_| !after_position);
        let of_position = followed || after_attitude;
        Findings {
            attitude: of_attitude.or(course.filter(|_| !of_position)),
            position: course.filter(|_| of_position),
            asked,
        }
    }

    fn tilt(&self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let [tilt, away] = angle_from(moment, &Vector3::z());
        let reached = tilt + stopping(away, self.delay_s, braking.turn_rad_s2);
        beyond(TripCause::TiltBeyond, reached, self.limits.tilt_rad)
    }

    /// Compares roll, pitch and heading with their set points.
    fn turned(&mut self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let asked = moment.setpoint?.gamma_rad;
        let yaw = euler_from_quaternion(&moment.q_wb).z;
        // Roll and pitch are compared at the present heading, so that a heading error does not count as tilt.
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

        // Predicted overshoot counts like a departure. A growing oscillation, such as a delay causes, is
        // found half a period earlier by it.
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

    fn clipped(&self, moment: &Moment) -> Option<Finding> {
        let lasted_s = moment.applied?.clipped_s;
        (lasted_s > self.limits.clipped_s).then_some(Finding {
            cause: TripCause::RotorsClipped,
            value: 0.0,
            limit: 0.0,
            lasted_s,
        })
    }

    /// Integrates the difference between the commanded and the applied thrust to a vertical speed.
    fn thrust(&mut self, moment: &Moment) -> Option<Finding> {
        let (Some(setpoint), Some(applied)) = (moment.setpoint, moment.applied) else {
            return None;
        };
        let lacking = if applied.is_commanded && setpoint.thrust_n.is_finite() {
            self.possible_n(setpoint.thrust_n) - applied.thrust_n
        } else {
            0.0
        };
        let kept = libm::exp(-moment.elapsed_s / THRUST_MEMORY_S);
        let gained = lacking / self.vehicle.mass_kg * moment.elapsed_s;
        self.memory.thrust_speed_m_s = self.memory.thrust_speed_m_s * kept + gained;
        let speed = self.memory.thrust_speed_m_s.abs();
        beyond(TripCause::ThrustAstray, speed, self.limits.thrust_speed_m_s)
    }

    /// Checks what the position slot's owner asks for: the tilt and its oscillations, the thrust, and the heading.
    fn asked(&mut self, moment: &Moment) -> Option<Finding> {
        // Only a flight with a reference has a position loop; on a rig any set point is permitted.
        let reference = moment.reference?;
        let Setpoint { gamma_rad: asked, thrust_n } = moment.asked?;
        let tilt = libm::acos(libm::cos(asked.x) * libm::cos(asked.y));
        let limit = self.limits.swing_tilt_rad;
        let [least_n, most_n] =
            self.limits.setpoint_thrust_weights.map(|weights| weights * self.vehicle.weight_n());
        let bound_n = if thrust_n < least_n { least_n } else { most_n };
        let is_beyond = !(least_n..=most_n).contains(&thrust_n);
        let thrust = Finding {
            cause: TripCause::ThrustBeyond,
            value: thrust_n,
            limit: bound_n,
            lasted_s: 0.0,
        };
        let turned = wrap_pi(asked.z - reference.yaw_rad).abs();
        let is_astray = turned > self.limits.heading_rad;
        let lasted_s =
            if is_astray { self.memory.heading_astray_s + moment.elapsed_s } else { 0.0 };
        self.memory.heading_astray_s = lasted_s;
        let heading = Finding {
            cause: TripCause::HeadingAstray,
            value: turned,
            limit: self.limits.heading_rad,
            lasted_s,
        };
        let mut found = beyond(TripCause::SetpointBeyond, tilt, self.limits.setpoint_tilt_rad)
            .or(is_beyond.then_some(thrust))
            .or((lasted_s > HEADING_S + 3.0 * moment.asked_every_s).then_some(heading));
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

    /// What the rotors can give of a thrust \[N\].
    fn possible_n(&self, thrust_n: f64) -> f64 {
        thrust_n.clamp(0.0, 4.0 * self.vehicle.rotor_thrust_max_n)
    }

    /// Acceleration by gravity and the rotors \[m/s²\] in the world frame, without wind and other forces: as the vehicle
    /// is, and as the position slot's owner asks for.
    fn accelerations_w_m_s2(&self, moment: &Moment) -> [Vector3<f64>; 2] {
        let VehicleParameters { mass_kg, gravity_m_s2, .. } = self.vehicle;
        let by = |up_w: Vector3<f64>, thrust_n: f64| {
            up_w * (thrust_n / mass_kg) - Vector3::z() * gravity_m_s2
        };
        let flown = moment.applied.map(|applied| by(moment.q_wb * Vector3::z(), applied.thrust_n));
        let flown = flown.unwrap_or_else(Vector3::zeros);
        let asked = moment.asked.map(|asked| {
            let up_w = quaternion_from_euler(&asked.gamma_rad) * Vector3::z();
            by(up_w, self.possible_n(asked.thrust_n))
        });
        [flown, asked.unwrap_or(flown)]
    }

    /// Acceleration by wind and other forces in the world frame \[m/s²\]: what the vehicle's velocity does beyond what
    /// gravity and the rotors, `flown`, explain, averaged over [`PUSH_MEMORY_S`].
    fn push_w_m_s2(
        &mut self,
        moment: &Moment,
        flown: &Vector3<f64>,
        braking: &Braking,
    ) -> Vector3<f64> {
        let memory = &mut self.memory;
        let push = Vector3::from(memory.push_w_m_s2);
        let before = Vector3::from(memory.velocity_w_m_s);
        memory.velocity_w_m_s = moment.velocity_w_m_s.into();
        let share = moment.elapsed_s / PUSH_MEMORY_S;
        if moment.elapsed_s <= 0.0 || !memory.has_velocity {
            memory.has_velocity = true;
            return push;
        }
        // A blow is over before it could be averaged.
        let seen = (moment.velocity_w_m_s - before) / moment.elapsed_s - flown;
        let next = push + (seen.cap_magnitude(braking.across_m_s2) - push) * share;
        if !next.iter().all(|number| number.is_finite()) {
            return push;
        }
        memory.push_w_m_s2 = next.into();
        next
    }

    /// Where the vehicle comes to rest, from the reference \[m\], if it keeps its acceleration until another command
    /// acts and for half of the time in which that turns the vehicle around. In the other half it does not brake yet,
    /// and then with what `push` leaves. Everything is relative to the reference, in the world frame.
    fn rest_w_m(
        &self,
        [error, velocity, acceleration, push]: [&Vector3<f64>; 4],
        braking: &Braking,
    ) -> Vector3<f64> {
        let turning_s = 0.5 * braking.tilting_s;
        let kept_s = self.delay_s + turning_s;
        let then = velocity + acceleration * kept_s;
        let speed = then.norm();
        let pushed = if speed > 1e-6 { push.dot(&then) / speed } else { 0.0 };
        // A head wind may drop.
        let most = braking.across_m_s2;
        let across = (most - pushed).clamp(LEAST_BRAKING * most, most);
        let stopping_s = turning_s + 0.5 * speed / across;
        error + velocity * kept_s + acceleration * (0.5 * kept_s * kept_s) + then * stopping_s
    }

    /// Compares the position with the reference and with the ground.
    fn moved(&mut self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let reference = moment.reference?;
        let error = moment.position_w_m - reference.position_w_m;
        let velocity = moment.velocity_w_m_s - reference.velocity_w_m_s;
        let distance = error.norm();
        let away = if distance > 1e-6 { velocity.dot(&error) / distance } else { velocity.norm() };
        let memory = &mut self.memory;
        memory.moved_m = moved(memory.moved_m, away, moment.elapsed_s, distance);
        let accelerations = self.accelerations_w_m_s2(moment);
        let push = self.push_w_m_s2(moment, &accelerations[0], braking);
        let going_m = accelerations.map(|acceleration| {
            let relative = acceleration + push - reference.acceleration_w_m_s2;
            let rest = self.rest_w_m([&error, &velocity, &relative, &push], braking);
            (rest.norm() - distance).max(0.0)
        });
        let excursion = self.memory.moved_m + going_m[0].max(going_m[1]);

        let delay_s = self.delay_s + braking.tilting_s;
        let sinking = stopping(-moment.velocity_w_m_s.z, delay_s, braking.up_m_s2);
        let height = moment.position_w_m.z - self.limits.height_m;
        let has_sunk = error.z < -SUNK_M && moment.velocity_w_m_s.z < 0.0;
        let sinks = beyond(TripCause::Sinks, sinking, height).filter(|_| has_sunk);

        let memory = &mut self.memory;
        // A vehicle that oscillates about its reference exceeds the limit only part of the time, so that the
        // time within the limit may take back only half of what has accumulated.
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

    /// Largest tilt, predicted \[rad\].
    pub(crate) fn tilt_limit_rad(&self) -> f64 {
        self.limits.tilt_rad
    }

    /// Number of reversals that count as an oscillation.
    #[must_use]
    pub fn reversals() -> u64 {
        REVERSALS as u64
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
