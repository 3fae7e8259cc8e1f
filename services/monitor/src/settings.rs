//! The section `[monitor]` of a scenario.

use crate::limits::Limits;
use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Least and largest thrust that a shipped position controller may ask for unless the scenario sets another, in
/// weights of the vehicle.
const SHIPPED_WEIGHTS: [f64; 2] = [0.3, 2.0];
/// How much thrust beyond what a position controller may ask for is none of a healthy one, in weights of the vehicle.
const BEYOND_WEIGHTS: f64 = 0.1;

/// Which controller is the fallback while an owner is watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fallback {
    /// The previous owner, for as long as the new one is watched.
    Auto,
    /// None: after a trip the actuation gate levels the vehicle for 1.5 s at most, or the attitude controller follows the
    /// reference by itself, until the initial controller has been started in the owner's place.
    None,
}

/// How owners that have not proven themselves are watched. [`Limits`] explains where the default of each threshold comes
/// from.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Whether the monitor runs; without it no owner is ever tripped.
    #[garde(skip)]
    pub enabled: bool,
    /// Which controller takes over after a trip.
    #[garde(skip)]
    pub fallback: Fallback,
    /// Loop rate \[Hz\]: how often an owner is judged.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// How far the vehicle may turn away from its set point about roll and pitch, predicted \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub turn_away_rad: f64,
    /// Largest tilt, predicted \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub tilt_rad: f64,
    /// How far the heading may turn away from its set point, predicted \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub heading_rad: f64,
    /// Attitude error that may be exceeded for at most `astray_s` \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub astray_rad: f64,
    /// How long `astray_rad` may be exceeded \[s\].
    #[garde(range(min = 0.01, max = 60.0))]
    pub astray_s: f64,
    /// Amplitude of the body rate about roll or pitch that counts as a swing of an oscillation \[rad/s\].
    #[garde(range(min = 0.01, max = 100.0))]
    pub swing_rate_rad_s: f64,
    /// Amplitude of roll or pitch of the set point that counts as a swing of an oscillation \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub swing_tilt_rad: f64,
    /// Largest tilt of a set point \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub setpoint_tilt_rad: f64,
    /// Least thrust of a set point, in weights of the vehicle; if left out, 0.2, or a tenth less than the
    /// position controllers may ask for where that is less than 0.3.
    #[garde(range(min = 0.0, max = 1.0))]
    pub setpoint_thrust_min_weights: Option<f64>,
    /// Largest thrust of a set point, in weights of the vehicle; if left out, 2.1, or a tenth more than the
    /// position controllers may ask for where that is more than 2.
    #[garde(range(min = 1.0, max = 100.0))]
    pub setpoint_thrust_max_weights: Option<f64>,
    /// How long the rotors may be clipped without a break \[s\].
    #[garde(range(min = 0.01, max = 60.0))]
    pub clipped_s: f64,
    /// Largest vertical speed gained by applying another thrust than the set point asks for \[m/s\].
    #[garde(range(min = 0.01, max = 100.0))]
    pub thrust_speed_m_s: f64,
    /// How far the vehicle may move away from its reference, predicted \[m\]; 0.1 m of it are what the fallback adds.
    #[garde(range(min = 0.15, max = 1000.0))]
    pub excursion_m: f64,
    /// Distance from the reference that may be exceeded for at most `off_course_s` \[m\].
    #[garde(range(min = 0.01, max = 1000.0))]
    pub off_course_m: f64,
    /// How long `off_course_m` may be exceeded \[s\].
    #[garde(range(min = 0.01, max = 60.0))]
    pub off_course_s: f64,
    /// Height above the ground at which a vehicle that sinks below its reference must come to rest \[m\].
    #[garde(range(min = 0.0, max = 1000.0))]
    pub height_m: f64,
}

impl Default for Settings {
    fn default() -> Self {
        let usual = Limits::default();
        Self {
            enabled: true,
            fallback: Fallback::Auto,
            rate_hz: 100.0,
            turn_away_rad: usual.turn_away_rad,
            tilt_rad: usual.tilt_rad,
            heading_rad: usual.heading_rad,
            astray_rad: usual.astray_rad,
            astray_s: usual.astray_s,
            swing_rate_rad_s: usual.swing_rate_rad_s,
            swing_tilt_rad: usual.swing_tilt_rad,
            setpoint_tilt_rad: usual.setpoint_tilt_rad,
            setpoint_thrust_min_weights: None,
            setpoint_thrust_max_weights: None,
            clipped_s: usual.clipped_s,
            thrust_speed_m_s: usual.thrust_speed_m_s,
            excursion_m: usual.excursion_m,
            off_course_m: usual.off_course_m,
            off_course_s: usual.off_course_s,
            height_m: usual.height_m,
        }
    }
}

impl Settings {
    /// The thresholds. `asked_weights` are the least and the largest thrust that the position controllers of the scenario
    /// may ask for, in weights of the vehicle, from which the thresholds of the thrust follow where they are left out.
    #[must_use]
    pub fn limits(&self, asked_weights: [f64; 2]) -> Limits {
        let [least, most] = Limits::default().setpoint_thrust_weights;
        let [asked_least, asked_most] = asked_weights;
        let least = if asked_least < SHIPPED_WEIGHTS[0] {
            (asked_least - BEYOND_WEIGHTS).max(0.0)
        } else {
            least
        };
        let most = if asked_most > SHIPPED_WEIGHTS[1] { asked_most + BEYOND_WEIGHTS } else { most };
        Limits {
            turn_away_rad: self.turn_away_rad,
            tilt_rad: self.tilt_rad,
            heading_rad: self.heading_rad,
            astray_rad: self.astray_rad,
            astray_s: self.astray_s,
            swing_rate_rad_s: self.swing_rate_rad_s,
            swing_tilt_rad: self.swing_tilt_rad,
            setpoint_tilt_rad: self.setpoint_tilt_rad,
            setpoint_thrust_weights: [
                self.setpoint_thrust_min_weights.unwrap_or(least),
                self.setpoint_thrust_max_weights.unwrap_or(most),
            ],
            clipped_s: self.clipped_s,
            thrust_speed_m_s: self.thrust_speed_m_s,
            excursion_m: self.excursion_m,
            off_course_m: self.off_course_m,
            off_course_s: self.off_course_s,
            height_m: self.height_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_enables_the_monitor_with_default_limits() {
        let settings: Settings = toml::from_str("").unwrap();
        assert!(settings.validate().is_ok() && settings.enabled);
        assert_eq!(settings.limits([0.3, 1.7]), Limits::default());
    }

    #[test]
    fn a_position_controller_that_may_ask_for_more_thrust_is_not_tripped_for_it() {
        let settings = Settings::default();
        let [least, most] = settings.limits([0.0, 3.0]).setpoint_thrust_weights;
        assert!(least <= 0.0 && (most - 3.1).abs() < 1e-12, "{least} {most}");
    }

    #[test]
    fn a_threshold_in_the_scenario_replaces_its_default_and_keeps_the_others() {
        let settings: Settings = toml::from_str("tilt_rad = 0.8\nfallback = \"none\"").unwrap();
        assert_eq!(settings.fallback, Fallback::None);
        assert_eq!(settings.limits([0.3, 1.7]), Limits { tilt_rad: 0.8, ..Limits::default() });
    }
}
