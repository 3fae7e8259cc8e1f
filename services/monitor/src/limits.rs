//! Thresholds of the criteria, derived from the capabilities of the vehicle.

use vehicle::{Agility, MorphAngle, VehicleParameters};

/// Bound on the tilt that a position controller may ask for \[rad\].
pub use runtime::arbiter::setpoints::TILT_BOUND_RAD;

/// Thresholds of the criteria. Angles about roll and pitch are those between body z and its desired
/// direction; *predicted* values are those at which the vehicle comes to rest if it is braked from now on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// How far the vehicle may turn away from its set point about roll and pitch, predicted \[rad\].
    pub turn_away_rad: f64,
    /// Largest tilt, predicted \[rad\].
    pub tilt_rad: f64,
    /// How far the heading may turn away from its set point, predicted \[rad\].
    pub heading_rad: f64,
    /// Attitude error that may be exceeded for at most `astray_s` \[rad\].
    pub astray_rad: f64,
    /// How long `astray_rad` may be exceeded \[s\].
    pub astray_s: f64,
    /// Amplitude of the body rate about roll or pitch that counts as a swing of an oscillation \[rad/s\].
    pub swing_rate_rad_s: f64,
    /// Amplitude of roll or pitch of the set point that counts as a swing of an oscillation \[rad\].
    pub swing_tilt_rad: f64,
    /// Largest tilt of a set point \[rad\].
    pub setpoint_tilt_rad: f64,
    /// Least and largest thrust of a set point, in weights of the vehicle.
    pub setpoint_thrust_weights: [f64; 2],
    /// How long the rotors may be clipped without a break \[s\].
    pub clipped_s: f64,
    /// Largest vertical speed gained by applying another thrust than the set point asks for \[m/s\].
    pub thrust_speed_m_s: f64,
    /// How far the vehicle may move away from its reference, predicted \[m\].
    pub excursion_m: f64,
    /// Distance from the reference that may be exceeded for at most `off_course_s` \[m\].
    pub off_course_m: f64,
    /// How long `off_course_m` may be exceeded \[s\].
    pub off_course_s: f64,
    /// Height above the ground at which a vehicle that sinks below its reference must come to rest \[m\].
    pub height_m: f64,
}

impl Default for Limits {
    /// * `turn_away_rad`: 0.6 of the tilt bound. A vehicle that turns away by more than half of the largest
    ///   set point has turned the wrong way, and a growing oscillation is found one swing earlier than at
    ///   the whole bound.
    /// * `tilt_rad`: 60°, where a thrust of twice the weight just holds the height: T cos φ = m g.
    /// * `heading_rad`: twice the tilt bound; yaw has a tenth of the torque of roll and pitch, and the
    ///   vehicle does not fall because of a wrong heading.
    /// * `astray_rad`, `astray_s`: half of the tilt bound, for as long as three time constants of an
    ///   attitude loop that is far slower than any shipped one (6 rad/s).
    /// * `swing_rate_rad_s`: two thirds of the rate from which the actuation guard levels the vehicle by itself, a tenth more
    ///   than the slowest shipped attitude loop swings with in gusts, with rotors and inertia that it does not know
    ///   (`false_trips`).
    /// * `swing_tilt_rad`: half of the tilt bound.
    /// * `setpoint_tilt_rad`: 1.5 times the tilt bound.
    /// * `setpoint_thrust_weights`: a tenth of the weight beyond what any shipped position controller may ask for, 0.3 to
    ///   2 weights.
    /// * `clipped_s`: so that a trip is in effect before the half second that a verdict forgives.
    /// * `thrust_speed_m_s`: the speed after a free fall of a twentieth of a second.
    /// * `excursion_m`: about a tenth of a metre less than the half within which the vehicle is to stay of where it would have
    ///   been (`swap_table patient` of the catalogue). Beside a failing controller in the other slot a fallback takes up to
    ///   a tenth more than is predicted (`swap_table pairs`); but with 0.40 m a position controller trips in a push that it
    ///   would bear (`false_trips`).
    /// * `off_course_m`, `off_course_s`: some three quarters of `excursion_m`, for longer than the vehicle needs to cover that
    ///   distance.
    /// * `height_m`: the length of an arm, with the arms spread.
    fn default() -> Self {
        Self {
            turn_away_rad: 0.6 * TILT_BOUND_RAD,
            tilt_rad: core::f64::consts::FRAC_PI_3,
            heading_rad: 2.0 * TILT_BOUND_RAD,
            astray_rad: 0.5 * TILT_BOUND_RAD,
            astray_s: 0.5,
            swing_rate_rad_s: 2.75,
            swing_tilt_rad: 0.5 * TILT_BOUND_RAD,
            setpoint_tilt_rad: 1.5 * TILT_BOUND_RAD,
            setpoint_thrust_weights: [0.2, 2.1],
            clipped_s: 0.45,
            thrust_speed_m_s: 0.5,
            excursion_m: 0.405,
            off_course_m: 0.3,
            off_course_s: 1.0,
            height_m: 0.17,
        }
    }
}

/// How fast a motion can be braked at one morph angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Braking {
    /// Angular acceleration about roll and pitch at hover thrust \[rad/s²\].
    pub turn_rad_s2: f64,
    /// Angular acceleration about yaw at hover thrust \[rad/s²\].
    pub yaw_rad_s2: f64,
    /// Horizontal acceleration at the tilt bound \[m/s²\].
    pub across_m_s2: f64,
    /// Vertical acceleration at twice the weight \[m/s²\].
    pub up_m_s2: f64,
    /// Time that the tilt needs from one bound to the opposite one \[s\].
    pub tilting_s: f64,
}

impl Braking {
    /// Of a vehicle at the morph angle `beta`.
    ///
    /// See [`Agility`] for what hover thrust leaves for turning.
    #[must_use]
    pub fn at(vehicle: &VehicleParameters, beta: MorphAngle) -> Self {
        let agility = Agility::at(vehicle, beta, TILT_BOUND_RAD);
        Self {
            turn_rad_s2: agility.tilting_rad_s2(),
            yaw_rad_s2: agility.acceleration_b_rad_s2.z,
            across_m_s2: agility.lateral_m_s2,
            up_m_s2: vehicle.gravity_m_s2,
            tilting_s: agility.tilting_s(2.0 * TILT_BOUND_RAD),
        }
    }
}

/// Stopping distance of a motion away from the target: at `speed` for `delay_s`, then decelerated by
/// `braking`. Distance is in the unit of `speed` times seconds; 0 for a motion towards the target.
#[must_use]
pub fn stopping(speed: f64, delay_s: f64, braking: f64) -> f64 {
    let away = speed.max(0.0);
    away * delay_s + 0.5 * away * away / braking
}

/// Integrates the motion away from the target: `before` is the last value, `speed` the speed away over
/// `elapsed_s`, and the present `error` limits the result, so that a step of the target does not count.
pub(crate) fn moved(before: f64, speed: f64, elapsed_s: f64, error: f64) -> f64 {
    (before + speed * elapsed_s).clamp(0.0, error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_towards_the_target_has_no_stopping_distance() {
        assert!(stopping(-3.0, 0.1, 10.0).abs() < 1e-15);
        assert!((stopping(2.0, 0.1, 10.0) - 0.4).abs() < 1e-12);
    }

    #[test]
    fn the_braking_acceleration_is_that_of_the_published_vehicle() {
        let vehicle = VehicleParameters::default();
        let small = Braking::at(&vehicle, MorphAngle::MIN);
        // m g L / 2 I = 0.12 · 9.81 · 0.095 / (2 · 1e-4).
        assert!((small.turn_rad_s2 / 559.17 - 1.0).abs() < 1e-4, "{small:?}");
        let large = Braking::at(&vehicle, MorphAngle::MAX);
        assert!((large.turn_rad_s2 / 164.81 - 1.0).abs() < 1e-4, "{large:?}");
        assert!(large.tilting_s > small.tilting_s);
    }
}
