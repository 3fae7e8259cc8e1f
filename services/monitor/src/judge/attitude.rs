//! The criteria about the attitude loop: what the vehicle's attitude and the applied thrust are, against the set point.

use super::{Judge, Moment};
use crate::finding::Finding;
use crate::limits::{Braking, TILT_BOUND_RAD, moved, stopping};
use crate::swings::Oscillation;
use nalgebra::Vector3;
use shared_types::TripCause;
use vehicle::{euler_from_quaternion, quaternion_from_euler, wrap_pi};

/// Oscillation of the body's rate, from 3 Hz on: three whole periods. The response to a step or to a kick has one or two
/// reversals.
const OF_BODY: Oscillation = Oscillation { reversals: 6, window_ns: 1_000_000_000 };
/// Time constant of the leaky integrator of the thrust error \[s\].
const THRUST_MEMORY_S: f64 = 0.5;
/// Change of the set point from one moment to the next that is a step \[rad\]: a fifth of the tilt bound.
const STEP_RAD: f64 = 0.2 * TILT_BOUND_RAD;
/// Rate at which an error that a step has made has to vanish \[1/s\]: that of an attitude loop that is far slower than any
/// shipped one.
const MIN_DECAY_RATE_S: f64 = 6.0;
/// Share of the rotors' deceleration with which a turn has to be braked that the vehicle had as its set point stepped.
const BRAKED_SHARE: f64 = 0.5;
/// How long a torque is full before it counts \[s\], and longer than one command of its loop: one of the shipped loops.
const FULL_S: f64 = 0.01;
/// Distance from the set point below which no full torque is needed to come nearer \[rad\]; a set point that moves by more
/// between two moments has to be answered first.
const NEAR_RAD: f64 = 0.03;
/// How far beyond its set point the vehicle is bound to turn while the torque is still full \[rad\]: clear of the noise of
/// an estimate.
const BEYOND_RAD: f64 = 0.02;
/// Share of the rate that the torque behind the lag would have made of rest. One that only holds against a load makes none.
const TURNING_SHARE: f64 = 1.0 / 6.0;
/// Time constant with which the peak of the attitude error decays \[s\]; that peak decides which of the two
/// loops is to blame.
const BLAME_MEMORY_S: f64 = 0.3;

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

/// Where a set point wants body z to point, in the world frame. Roll and pitch are compared at the present heading, so that
/// a heading error does not count as tilt.
fn towards_w(moment: &Moment, asked: &Vector3<f64>) -> Vector3<f64> {
    let yaw = euler_from_quaternion(&moment.q_wb).z;
    quaternion_from_euler(&Vector3::new(asked.x, asked.y, yaw)) * Vector3::z()
}

impl Judge {
    pub(super) fn tilt(&self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let [tilt, away] = angle_from(moment, &Vector3::z());
        let reached = tilt + stopping(away, self.delay_s, braking.turn_rad_s2);
        Finding::beyond(TripCause::TiltBeyond, reached, self.limits.tilt_rad)
    }

    /// Compares roll, pitch and heading with their set points.
    pub(super) fn turned(&mut self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let asked = moment.setpoint?.gamma_rad;
        let towards = towards_w(moment, &asked);
        let [error, away] = angle_from(moment, &towards);
        self.step(moment, &towards, [error, away], braking);
        let (memory, elapsed_s) = (&mut self.memory, moment.elapsed_s);
        let own = if away > 0.0 { (away - memory.inherited_rad_s).max(0.0) } else { away };
        memory.turned_rad = moved(memory.turned_rad, own, elapsed_s, error);
        let late = memory.error_of_late_rad * libm::exp(-elapsed_s / BLAME_MEMORY_S);
        let own_error = (error - memory.stepped_rad).max(0.0);
        memory.error_of_late_rad = own_error.max(late);
        let is_astray = own_error > self.limits.astray_rad;
        memory.astray_s = if is_astray { memory.astray_s + elapsed_s } else { 0.0 };

        let yaw = euler_from_quaternion(&moment.q_wb).z;
        let heading = wrap_pi(yaw - asked.z);
        let turn = moment.rate_b_rad_s.z * heading.signum();
        memory.heading_rad = moved(memory.heading_rad, turn, elapsed_s, heading.abs());

        // Predicted overshoot counts like a departure. A growing oscillation, such as a delay causes, is
        // found half a period earlier by it.
        let overshoot = stopping(-away, self.delay_s, braking.turn_rad_s2) - error;
        let departure = memory.turned_rad + stopping(own, self.delay_s, braking.turn_rad_s2);
        let turned = departure.max(overshoot);
        let heading = memory.heading_rad + stopping(turn, self.delay_s, braking.yaw_rad_s2);
        let lasted_s = memory.astray_s;
        Finding::beyond(TripCause::AttitudeDeparts, turned, self.limits.turn_away_rad)
            .or(Finding::beyond(TripCause::HeadingDeparts, heading, self.limits.heading_rad))
            .or((lasted_s > self.limits.astray_s).then_some(Finding {
                lasted_s,
                ..Finding::of(TripCause::AttitudeAstray, error, self.limits.astray_rad)
            }))
    }

    /// Takes note of a step of the set point, which is not the attitude controller's doing: nor is the error that it makes,
    /// nor that the vehicle turns away from a set point towards which it did not turn before. Both are to vanish in time.
    fn step(
        &mut self,
        moment: &Moment,
        towards_w: &Vector3<f64>,
        [error, away]: [f64; 2],
        braking: &Braking,
    ) {
        let braked_rad_s2 = BRAKED_SHARE * braking.turn_rad_s2;
        let memory = &mut self.memory;
        memory.stepped_rad *= libm::exp(-MIN_DECAY_RATE_S * moment.elapsed_s);
        let inherited_rad_s = memory.inherited_rad_s - braked_rad_s2 * moment.elapsed_s;
        memory.inherited_rad_s = inherited_rad_s.max(0.0);
        // An owner that has just begun inherits what the vehicle does.
        let before = memory.has_target.then(|| Vector3::from(memory.towards_w));
        let step_rad = before.map_or(0.0, |before| before.angle(towards_w));
        if before.is_none() || step_rad > NEAR_RAD {
            memory.retargeted_ns = moment.now_ns;
        }
        if before.is_none() || step_rad > STEP_RAD {
            let [error_before, away_before] =
                before.map_or([error, 0.0], |before| angle_from(moment, &before));
            memory.stepped_rad = (memory.stepped_rad + error - error_before).clamp(0.0, error);
            let gained_rad_s = away - away_before.max(0.0);
            if gained_rad_s > 0.0 {
                // The share of the rate that the step has made is braked only when another command acts.
                let until_braked_rad_s = braked_rad_s2 * self.delay_s * gained_rad_s / away;
                let inherited_rad_s = memory.inherited_rad_s.max(until_braked_rad_s) + gained_rad_s;
                memory.inherited_rad_s = inherited_rad_s.min(away + until_braked_rad_s);
            }
        }
        memory.towards_w = (*towards_w).into();
        memory.has_target = true;
    }

    /// Whether full torque turns the vehicle to where it leaves its set point behind. What passes the lag of the rotors only
    /// later counts, so that this shows some hundredths of a second before the vehicle departs.
    pub(super) fn commanded(&self, moment: &Moment, braking: &Braking) -> Option<Finding> {
        let (setpoint, applied) = (moment.setpoint?, moment.applied?);
        // A rate that the vehicle has because its set point stepped to the other side is braked first.
        if self.memory.inherited_rad_s > 0.0 {
            return None;
        }
        let since_ns = moment.now_ns.saturating_sub(self.memory.retargeted_ns);
        let up = moment.q_wb.inverse_transform_vector(&towards_w(moment, &setpoint.gamma_rad));
        // A rotation by (−up_y, up_x, 0) brings body z to its set point, as far as angles are small.
        let beyond = [up.y, -up.x];
        let inertia = self.vehicle.inertia_kg_m2(moment.morph_angle);
        let lag_s = self.vehicle.rotor_lag_s;
        (0..2).find_map(|axis| {
            let full_s = applied.full_s[axis];
            let side = 1.0_f64.copysign(full_s);
            let lasted_s = full_s.abs().min(since_ns as f64 * 1e-9);
            let (beyond, rate) = (side * beyond[axis], side * moment.rate_b_rad_s[axis]);
            let accelerated = (side * applied.lagged_nm[axis] / inertia[axis]).max(0.0);
            let turning = TURNING_SHARE * accelerated * lasted_s.min(2.0 * FULL_S);
            if lasted_s < FULL_S || beyond < -NEAR_RAD || rate <= turning {
                return None;
            }
            let reached = beyond
                + rate * (self.delay_s - lag_s)
                + stopping(rate + accelerated * lag_s, lag_s, braking.turn_rad_s2);
            let finding = Finding::beyond(TripCause::TurnsBeyond, reached, BEYOND_RAD)?;
            Some(Finding { lasted_s, ..finding })
        })
    }

    pub(super) fn swings(&mut self, moment: &Moment) -> Option<Finding> {
        let limit = self.limits.swing_rate_rad_s;
        let rates = [moment.rate_b_rad_s.x, moment.rate_b_rad_s.y];
        let mut found = None;
        for (swings, rate) in self.body.iter_mut().zip(rates) {
            swings.see(moment.now_ns, rate, limit);
            if swings.are(&OF_BODY, moment.now_ns) {
                found = Some(Finding::oscillates(TripCause::RateOscillates, rate, limit, &OF_BODY));
            }
        }
        found
    }

    pub(super) fn clipped(&self, moment: &Moment) -> Option<Finding> {
        let lasted_s = moment.applied?.clipped_s;
        let finding = Finding { lasted_s, ..Finding::of(TripCause::RotorsClipped, 0.0, 0.0) };
        (lasted_s > self.limits.clipped_s).then_some(finding)
    }

    /// Integrates the difference between the commanded and the applied thrust to a vertical speed.
    pub(super) fn thrust(&mut self, moment: &Moment) -> Option<Finding> {
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
        Finding::beyond(TripCause::ThrustAstray, speed, self.limits.thrust_speed_m_s)
    }
}
