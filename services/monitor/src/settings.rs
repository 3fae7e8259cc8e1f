//! The section `[watch]` of a scenario.

use crate::limits::Limits;
use garde::Validate;
use serde::Deserialize;

/// Who stands by while an owner is watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fallback {
    /// The owner before it, for as long as it is watched.
    Auto,
    /// Nobody: a trip leaves the slot to the watched owner, and the gate levels the vehicle for it.
    None,
}

/// How owners that have not proven themselves are watched. Thresholds that are left out follow from the
/// vehicle, see [`Limits`].
#[derive(Debug, Clone, Copy, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Fly the monitor. Without it no owner ever trips.
    #[garde(skip)]
    pub enabled: bool,
    /// Who stands by.
    #[garde(skip)]
    pub fallback: Fallback,
    /// Loop rate \[Hz\]: how often an owner is judged.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// How far the vehicle may turn away from its set point about roll and pitch, predicted \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub turn_away_rad: Option<f64>,
    /// Tilt that may be reached, predicted \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub tilt_rad: Option<f64>,
    /// How far the heading may turn away from its set point, predicted \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub heading_rad: Option<f64>,
    /// Attitude error that may last for `astray_s` \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub astray_rad: Option<f64>,
    /// How long it may last \[s\].
    #[garde(range(min = 0.01, max = 60.0))]
    pub astray_s: Option<f64>,
    /// Body rate about roll or pitch that counts as a swing to its side \[rad/s\].
    #[garde(range(min = 0.01, max = 100.0))]
    pub swing_rate_rad_s: Option<f64>,
    /// Tilt of the set point that counts as one \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub swing_tilt_rad: Option<f64>,
    /// Tilt that a set point may ask for \[rad\].
    #[garde(range(min = 0.01, max = 3.2))]
    pub setpoint_tilt_rad: Option<f64>,
    /// Vertical speed that may come of a thrust other than the one asked for \[m/s\].
    #[garde(range(min = 0.01, max = 100.0))]
    pub thrust_speed_m_s: Option<f64>,
    /// How far the vehicle may move away from its reference, predicted \[m\].
    #[garde(range(min = 0.01, max = 1000.0))]
    pub excursion_m: Option<f64>,
    /// Distance from the reference that may last for `off_course_s` \[m\].
    #[garde(range(min = 0.01, max = 1000.0))]
    pub off_course_m: Option<f64>,
    /// How long it may last \[s\].
    #[garde(range(min = 0.01, max = 60.0))]
    pub off_course_s: Option<f64>,
    /// Height above the ground that is kept when the vehicle sinks below its reference \[m\].
    #[garde(range(min = 0.0, max = 1000.0))]
    pub height_m: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            enabled: true,
            fallback: Fallback::Auto,
            rate_hz: 100.0,
            turn_away_rad: None,
            tilt_rad: None,
            heading_rad: None,
            astray_rad: None,
            astray_s: None,
            swing_rate_rad_s: None,
            swing_tilt_rad: None,
            setpoint_tilt_rad: None,
            thrust_speed_m_s: None,
            excursion_m: None,
            off_course_m: None,
            off_course_s: None,
            height_m: None,
        }
    }
}

impl Settings {
    /// The thresholds, those of the scenario before those of the vehicle.
    #[must_use]
    pub fn limits(&self) -> Limits {
        let usual = Limits::default();
        Limits {
            turn_away_rad: self.turn_away_rad.unwrap_or(usual.turn_away_rad),
            tilt_rad: self.tilt_rad.unwrap_or(usual.tilt_rad),
            heading_rad: self.heading_rad.unwrap_or(usual.heading_rad),
            astray_rad: self.astray_rad.unwrap_or(usual.astray_rad),
            astray_s: self.astray_s.unwrap_or(usual.astray_s),
            swing_rate_rad_s: self.swing_rate_rad_s.unwrap_or(usual.swing_rate_rad_s),
            swing_tilt_rad: self.swing_tilt_rad.unwrap_or(usual.swing_tilt_rad),
            setpoint_tilt_rad: self.setpoint_tilt_rad.unwrap_or(usual.setpoint_tilt_rad),
            thrust_speed_m_s: self.thrust_speed_m_s.unwrap_or(usual.thrust_speed_m_s),
            excursion_m: self.excursion_m.unwrap_or(usual.excursion_m),
            off_course_m: self.off_course_m.unwrap_or(usual.off_course_m),
            off_course_s: self.off_course_s.unwrap_or(usual.off_course_s),
            height_m: self.height_m.unwrap_or(usual.height_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_watches_with_the_limits_of_the_vehicle() {
        let settings: Settings = toml::from_str("").unwrap();
        assert!(settings.validate().is_ok() && settings.enabled);
        assert_eq!(settings.limits(), Limits::default());
    }

    #[test]
    fn a_threshold_in_the_scenario_replaces_one_and_leaves_the_others() {
        let settings: Settings = toml::from_str("tilt_rad = 0.8\nfallback = \"none\"").unwrap();
        assert_eq!(settings.fallback, Fallback::None);
        assert_eq!(settings.limits(), Limits { tilt_rad: 0.8, ..Limits::default() });
    }
}
