//! What may be flown, derived from what the vehicle can do.

use vehicle::{MorphAngle, VehicleParameters};

/// Bound on the tilt that a position controller may ask for \[rad\].
pub use runtime::obey::setpoints::TILT_BOUND_RAD;

/// Thresholds of the criteria. Angles about roll and pitch are those between body z and where it should
/// point; predicted ones say where the vehicle stands still if it is braked from now on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// How far the vehicle may turn away from its set point about roll and pitch, predicted \[rad\].
    pub turn_away_rad: f64,
    /// Tilt that may be reached, predicted \[rad\].
    pub tilt_rad: f64,
    /// How far the heading may turn away from its set point, predicted \[rad\].
    pub heading_rad: f64,
    /// Attitude error that may last for `astray_s` \[rad\].
    pub astray_rad: f64,
    /// How long it may last \[s\].
    pub astray_s: f64,
    /// Body rate about roll or pitch that counts as a swing to its side \[rad/s\].
    pub swing_rate_rad_s: f64,
    /// Tilt of the set point that counts as one \[rad\].
    pub swing_tilt_rad: f64,
    /// Tilt that a set point may ask for \[rad\].
    pub setpoint_tilt_rad: f64,
    /// Vertical speed that may come of a thrust other than the one asked for \[m/s\].
    pub thrust_speed_m_s: f64,
    /// How far the vehicle may move away from its reference, predicted \[m\].
    pub excursion_m: f64,
    /// Distance from the reference that may last for `off_course_s` \[m\].
    pub off_course_m: f64,
    /// How long it may last \[s\].
    pub off_course_s: f64,
    /// Height above the ground that is kept when the vehicle sinks below its reference \[m\].
    pub height_m: f64,
}

impl Default for Limits {
    /// * `turn_away_rad`: 0.6 of the tilt bound. Whoever turns away by more than half of what may be asked for
    ///   in all has turned the wrong way, and one that diverges with each swing is found a swing earlier than
    ///   at the whole bound.
    /// * `tilt_rad`: 60°, where twice the weight just carries the vehicle: T cos φ = m g.
    /// * `heading_rad`: twice the tilt bound; yaw has a tenth of the torque of roll and pitch, and nothing
    ///   falls while it is off.
    /// * `astray_rad`, `astray_s`: half of the tilt bound, for as long as three time constants of an
    ///   attitude loop that is far slower than any shipped one (6 rad/s).
    /// * `swing_rate_rad_s`: half of the rate from which the gate levels by itself.
    /// * `swing_tilt_rad`: half of the tilt bound.
    /// * `setpoint_tilt_rad`: 1.5 times the tilt bound.
    /// * `thrust_speed_m_s`: what falling for a twentieth of a second with no thrust at all gives.
    /// * `excursion_m`: what a vehicle at the tilt bound covers in two thirds of a second,
    ///   g tan(0.35) t² / 2.
    /// * `off_course_m`, `off_course_s`: a bit less than half of it, for longer than that takes.
    /// * `height_m`: an arm's length with the arms spread.
    fn default() -> Self {
        Self {
            turn_away_rad: 0.6 * TILT_BOUND_RAD,
            tilt_rad: core::f64::consts::FRAC_PI_3,
            heading_rad: 2.0 * TILT_BOUND_RAD,
            astray_rad: 0.5 * TILT_BOUND_RAD,
            astray_s: 0.5,
            swing_rate_rad_s: 2.0,
            swing_tilt_rad: 0.5 * TILT_BOUND_RAD,
            setpoint_tilt_rad: 1.5 * TILT_BOUND_RAD,
            thrust_speed_m_s: 0.5,
            excursion_m: 0.75,
            off_course_m: 0.3,
            off_course_s: 1.0,
            height_m: 0.17,
        }
    }
}

/// How well a motion can be braked at a size of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Braking {
    /// Angular acceleration about roll and pitch at hover thrust \[rad/s²\].
    pub turn_rad_s2: f64,
    /// The same about yaw \[rad/s²\].
    pub yaw_rad_s2: f64,
    /// Horizontal acceleration at the tilt bound \[m/s²\].
    pub across_m_s2: f64,
    /// Vertical acceleration at twice the weight \[m/s²\].
    pub up_m_s2: f64,
    /// Time that the tilt takes from one bound to the other \[s\].
    pub tilting_s: f64,
}

impl Braking {
    /// At the arms' angle β.
    ///
    /// At hover thrust each pair of rotors carries half of the weight: τ = m g L(β) / 2 about roll and
    /// pitch, k m g about yaw (`VehicleParameters::largest_wrench`), so α = τ / I(β). A tilt is
    /// turned by Δ in 2 √(Δ/α), half the time with and half against the torque.
    #[must_use]
    pub fn at(vehicle: &VehicleParameters, beta: MorphAngle) -> Self {
        let inertia = vehicle.inertia_kg_m2(beta);
        let [_, roll_nm, pitch_nm, yaw_nm] = vehicle.largest_wrench(beta);
        let turn_rad_s2 = (roll_nm / inertia.x).min(pitch_nm / inertia.y);
        Self {
            turn_rad_s2,
            yaw_rad_s2: yaw_nm / inertia.z,
            across_m_s2: vehicle.gravity_m_s2 * libm::tan(TILT_BOUND_RAD),
            up_m_s2: vehicle.gravity_m_s2,
            tilting_s: 2.0 * (2.0 * TILT_BOUND_RAD / turn_rad_s2).sqrt(),
        }
    }
}

/// Way that a motion away still covers: at `speed` for `delay_s`, and then against `braking`.
#[must_use]
pub fn stopping(speed: f64, delay_s: f64, braking: f64) -> f64 {
    let away = speed.max(0.0);
    away * delay_s + 0.5 * away * away / braking
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_towards_the_goal_needs_no_way_to_stop() {
        assert!(stopping(-3.0, 0.1, 10.0).abs() < 1e-15);
        assert!((stopping(2.0, 0.1, 10.0) - 0.4).abs() < 1e-12);
    }

    #[test]
    fn the_braking_ability_is_that_of_the_published_vehicle() {
        let vehicle = VehicleParameters::default();
        let small = Braking::at(&vehicle, MorphAngle::MIN);
        // m g L / 2 I = 0.12 · 9.81 · 0.095 / (2 · 1e-4).
        assert!((small.turn_rad_s2 / 559.17 - 1.0).abs() < 1e-4, "{small:?}");
        let large = Braking::at(&vehicle, MorphAngle::MAX);
        assert!((large.turn_rad_s2 / 164.81 - 1.0).abs() < 1e-4, "{large:?}");
        assert!(large.tilting_s > small.tilting_s);
    }
}
