//! The criteria about the position loop: where the vehicle goes, against the reference and the ground, and what the
//! position slot's owner asks for.

use super::{Judge, Moment, Setpoint};
use crate::finding::Finding;
use crate::limits::{Braking, moved, stopping};
use crate::swings::Oscillation;
use nalgebra::Vector3;
use shared_types::TripCause;
use vehicle::{VehicleParameters, quaternion_from_euler, wrap_pi};

/// Oscillations of the set point: three whole periods from 0.75 Hz on, as position loops are slower than attitude loops,
/// and two reversals from 2 Hz on, where no position loop has a use for them.
const OF_SETPOINT: [Oscillation; 2] = [
    Oscillation { reversals: 2, window_ns: 250_000_000 },
    Oscillation { reversals: 6, window_ns: 4_000_000_000 },
];
/// Time constant with which the acceleration by wind and other forces is averaged \[s\].
const PUSH_MEMORY_S: f64 = 0.5;
/// Share of the horizontal acceleration that is left for braking in any wind.
const MIN_BRAKING: f64 = 0.3;
/// How much farther the fallback lets the vehicle go than it could be stopped \[m\]: it continues from what was applied,
/// and returns to its path rather than braking as hard as it can (`swap_table` of the catalogue compares both).
const FALLBACK_M: f64 = 0.1;
/// How long a set point may ask for another heading than the reference \[s\], and three periods of its loop longer: it is
/// as much older.
const HEADING_S: f64 = 0.1;
/// Depth below the reference from which the height above ground is checked \[m\]. A vehicle that lands stays
/// close to its descending reference and is not checked.
const SUNK_M: f64 = 0.3;

impl Judge {
    /// Checks what the position slot's owner asks for: the tilt and its oscillations, the thrust, and the heading.
    pub(super) fn asked(&mut self, moment: &Moment) -> Option<Finding> {
        // Only a flight with a reference has a position loop; on a rig any set point is permitted.
        let reference = moment.reference?;
        let Setpoint { gamma_rad: asked, thrust_n } = moment.asked?;
        let tilt = libm::acos(libm::cos(asked.x) * libm::cos(asked.y));
        let limit = self.limits.swing_tilt_rad;
        let [least_n, most_n] =
            self.limits.setpoint_thrust_weights.map(|weights| weights * self.vehicle.weight_n());
        let bound_n = if thrust_n < least_n { least_n } else { most_n };
        let is_beyond = !(least_n..=most_n).contains(&thrust_n);
        let thrust = Finding::of(TripCause::ThrustBeyond, thrust_n, bound_n);
        let turned = wrap_pi(asked.z - reference.yaw_rad).abs();
        let is_astray = turned > self.limits.heading_rad;
        let lasted_s =
            if is_astray { self.memory.heading_astray_s + moment.elapsed_s } else { 0.0 };
        self.memory.heading_astray_s = lasted_s;
        let heading = Finding {
            lasted_s,
            ..Finding::of(TripCause::HeadingAstray, turned, self.limits.heading_rad)
        };
        let mut found =
            Finding::beyond(TripCause::SetpointBeyond, tilt, self.limits.setpoint_tilt_rad)
                .or(is_beyond.then_some(thrust))
                .or((lasted_s > HEADING_S + 3.0 * moment.asked_every_s).then_some(heading));
        for (swings, angle) in self.asked.iter_mut().zip([asked.x, asked.y]) {
            swings.see(moment.now_ns, angle, limit);
            let now = OF_SETPOINT.iter().find(|oscillation| swings.are(oscillation, moment.now_ns));
            found = found.or(now
                .map(|now| Finding::oscillates(TripCause::SetpointOscillates, angle, limit, now)));
        }
        found
    }

    /// What the rotors can give of a thrust \[N\].
    pub(super) fn possible_n(&self, thrust_n: f64) -> f64 {
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
        let across = (most - pushed).clamp(MIN_BRAKING * most, most);
        let stopping_s = turning_s + 0.5 * speed / across;
        error + velocity * kept_s + acceleration * (0.5 * kept_s * kept_s) + then * stopping_s
    }

    /// Compares the position with the reference and with the ground.
    pub(super) fn moved(&mut self, moment: &Moment, braking: &Braking) -> Option<Finding> {
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
        let excursion = self.memory.moved_m + going_m[0].max(going_m[1]) + FALLBACK_M;

        let delay_s = self.delay_s + braking.tilting_s;
        let sinking = stopping(-moment.velocity_w_m_s.z, delay_s, braking.up_m_s2);
        let height = moment.position_w_m.z - self.limits.height_m;
        let has_sunk = error.z < -SUNK_M && moment.velocity_w_m_s.z < 0.0;
        let sinks = Finding::beyond(TripCause::Sinks, sinking, height).filter(|_| has_sunk);

        let memory = &mut self.memory;
        // A vehicle that oscillates about its reference exceeds the limit only part of the time, so that the
        // time within the limit may take back only half of what has accumulated.
        let limit = self.limits.off_course_m;
        let spent_s = if distance > limit { moment.elapsed_s } else { -0.5 * moment.elapsed_s };
        memory.off_course_s = (memory.off_course_s + spent_s).max(0.0);
        let lasted_s = memory.off_course_s;
        let is_off = (lasted_s > self.limits.off_course_s).then_some(Finding {
            lasted_s,
            ..Finding::of(TripCause::PositionDeparts, distance.max(limit), limit)
        });
        let departs =
            Finding::beyond(TripCause::PositionDeparts, excursion, self.limits.excursion_m);
        sinks.or(departs).or(is_off)
    }
}
