//! The list of all measurements that have a limit.

use crate::{Grade, Outcome};
use core::fmt::Write as _;

/// Unit of a measurement and its limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    Metre,
    Second,
    Radian,
    /// A share from 0 to 1, displayed in per cent.
    Share,
    /// A whole number without a unit.
    Count,
}

/// One measurement with a limit.
#[derive(Debug, Clone, Copy)]
pub struct Check {
    /// Name of the limit, as in a scenario's `[verdict]`.
    pub key: &'static str,
    /// Name of the measurement in messages.
    pub name: &'static str,
    /// Unit of measurement and limit.
    pub unit: Unit,
    /// Grade of a flight that exceeds the limit.
    pub grade: Grade,
    /// Takes the measurement from an outcome; `None` if the outcome has no such measurement.
    pub measure: fn(&Outcome) -> Option<f64>,
    /// Text that states when or where the measurement was taken.
    pub detail: fn(&Outcome) -> String,
}

/// The detail of a measurement without place or instant.
fn nowhere(_: &Outcome) -> String {
    String::new()
}

fn at(t_s: f64) -> String {
    format!(" at {t_s:.3} s")
}

fn from(t_s: f64) -> String {
    format!(" from {t_s:.3} s on")
}

fn of(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!(" of {name}") }
}

/// Every check, in the order in which reasons of the same grade are listed.
pub const CHECKS: [Check; 23] = [
    Check {
        key: "cut_max_s",
        name: "rotors cut",
        unit: Unit::Second,
        grade: Grade::Lost,
        measure: |o| Some(o.cut_s),
        detail: |o| from(o.cut_at_s),
    },
    Check {
        key: "lost_m",
        name: "mean distance off its path in the last second",
        unit: Unit::Metre,
        grade: Grade::Lost,
        measure: |o| o.tracking.map(|t| t.end_m),
        detail: nowhere,
    },
    Check {
        key: "lost_rad",
        name: "angle off its set point at the end",
        unit: Unit::Radian,
        grade: Grade::Lost,
        measure: |o| o.turned_rad,
        detail: nowhere,
    },
    Check {
        key: "contact_max_s",
        name: "ground contact",
        unit: Unit::Second,
        grade: Grade::Failed,
        measure: |o| Some(o.contact.total_s),
        detail: |o| from(o.contact.from_s),
    },
    Check {
        key: "tracking_max_m",
        name: "tracking error",
        unit: Unit::Metre,
        grade: Grade::Failed,
        measure: |o| o.tracking.map(|t| t.max_m),
        detail: |o| o.tracking.map_or_else(String::new, |t| at(t.max_at_s)),
    },
    Check {
        key: "tracking_sustained_max_m",
        name: "mean tracking error over a second",
        unit: Unit::Metre,
        grade: Grade::Failed,
        measure: |o| o.tracking.map(|t| t.sustained_m),
        detail: |o| o.tracking.map_or_else(String::new, |t| at(t.sustained_at_s)),
    },
    Check {
        key: "recovery_max_m",
        name: "tracking error during a recovery",
        unit: Unit::Metre,
        grade: Grade::Failed,
        measure: |o| o.tracking.map(|t| t.recovering_m),
        detail: |o| o.tracking.map_or_else(String::new, |t| at(t.recovering_at_s)),
    },
    Check {
        key: "tracking_rms_max_m",
        name: "tracking error, rms",
        unit: Unit::Metre,
        grade: Grade::Failed,
        measure: |o| o.tracking.map(|t| t.rms_m),
        detail: nowhere,
    },
    Check {
        key: "heading_max_rad",
        name: "heading error",
        unit: Unit::Radian,
        grade: Grade::Failed,
        measure: |o| o.tracking.map(|t| t.heading_rad),
        detail: |o| o.tracking.map_or_else(String::new, |t| at(t.heading_at_s)),
    },
    Check {
        key: "attitude_end_max_rad",
        name: "attitude error at the end",
        unit: Unit::Radian,
        grade: Grade::Failed,
        measure: |o| o.turned_rad,
        detail: nowhere,
    },
    Check {
        key: "tilt_max_rad",
        name: "tilt",
        unit: Unit::Radian,
        grade: Grade::Failed,
        measure: |o| Some(o.tilt_rad),
        detail: nowhere,
    },
    Check {
        key: "safe_mode_max",
        name: "unexplained safe-mode episodes",
        unit: Unit::Count,
        grade: Grade::Failed,
        measure: |o| Some(o.safe_mode.unexplained as f64),
        detail: |o| from(o.safe_mode.unexplained_from_s),
    },
    Check {
        key: "safe_mode_max_s",
        name: "longest safe-mode episode",
        unit: Unit::Second,
        grade: Grade::Failed,
        measure: |o| Some(o.safe_mode.longest_s),
        detail: |o| from(o.safe_mode.longest_from_s),
    },
    Check {
        key: "clipped_max_s",
        name: "rotors clipped without a break",
        unit: Unit::Second,
        grade: Grade::Failed,
        measure: |o| Some(o.clipping.longest_s),
        detail: |o| from(o.clipping.longest_from_s),
    },
    Check {
        key: "clipped_max_share",
        name: "ticks with clipped rotors",
        unit: Unit::Share,
        grade: Grade::Failed,
        measure: |o| Some(o.clipping.share),
        detail: nowhere,
    },
    Check {
        key: "violations_max",
        name: "commands outside their bounds",
        unit: Unit::Count,
        grade: Grade::Failed,
        measure: |o| Some(o.violations as f64),
        detail: nowhere,
    },
    Check {
        key: "unsolved_max_share",
        name: "steps without a solved optimum",
        unit: Unit::Share,
        grade: Grade::Failed,
        measure: |o| Some(o.unsolved.share),
        detail: |o| of(&o.unsolved.of),
    },
    Check {
        key: "wrong_owner_max",
        name: "ticks commanded by a wrong owner",
        unit: Unit::Count,
        grade: Grade::Failed,
        measure: |o| Some(o.wrong_owner as f64),
        detail: nowhere,
    },
    Check {
        key: "duplicated_max",
        name: "ticks with two commands",
        unit: Unit::Count,
        grade: Grade::Failed,
        measure: |o| Some(o.duplicated as f64),
        detail: nowhere,
    },
    Check {
        key: "missed_max_share",
        name: "missed releases and deadlines",
        unit: Unit::Share,
        grade: Grade::Failed,
        measure: |o| Some(o.missed.share),
        detail: |o| of(&o.missed.of),
    },
    Check {
        key: "late_max_share",
        name: "samples after their step",
        unit: Unit::Share,
        grade: Grade::Failed,
        measure: |o| Some(o.late.share),
        detail: |o| of(&o.late.of),
    },
    Check {
        key: "dropped_max",
        name: "samples that the recorder lost",
        unit: Unit::Count,
        grade: Grade::Failed,
        measure: |o| Some(o.dropped as f64),
        detail: |o| {
            if o.dropped_of.is_empty() { String::new() } else { format!(" ({})", o.dropped_of) }
        },
    },
    Check {
        key: "altered_max",
        name: "hashes of the recording that are not the flight's",
        unit: Unit::Count,
        grade: Grade::Failed,
        measure: |o| Some(o.altered as f64),
        detail: nowhere,
    },
];

impl Unit {
    /// Symbol of the unit as displayed: % for a share, empty for a count.
    #[must_use]
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Second => "s",
            Self::Radian => "rad",
            Self::Share => "%",
            Self::Count => "",
        }
    }

    /// A value in this unit as text with its symbol; a share is converted to per cent.
    #[must_use]
    pub fn text(self, value: f64) -> String {
        self.with_digits(value, self.digits())
    }

    /// A measurement and the limit that it exceeds as text, with enough digits to show the difference.
    #[must_use]
    pub fn text_of_both(self, measured: f64, limit: f64) -> (String, String) {
        // Seventeen digits distinguish any two numbers of this size.
        let both = |digits| (self.with_digits(measured, digits), self.with_digits(limit, digits));
        (self.digits()..17).map(both).find(|(m, l)| m != l).unwrap_or_else(|| both(17))
    }

    const fn digits(self) -> usize {
        match self {
            Self::Count => 0,
            Self::Share => 2,
            Self::Metre | Self::Second | Self::Radian => 3,
        }
    }

    fn with_digits(self, value: f64, digits: usize) -> String {
        if value.is_nan() {
            return "not a number".to_owned();
        }
        let shown = if self == Self::Share { 100.0 * value } else { value };
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = write!(text, "{shown:.digits$}");
        if digits > 0 && value.is_finite() {
            text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
        }
        if self != Self::Count {
            text.push(' ');
            text.push_str(self.symbol());
        }
        text
    }
}
