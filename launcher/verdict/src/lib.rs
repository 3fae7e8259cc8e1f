//! The verdict about a flight, the same in every output.
//!
//! [`Outcome`] holds what was measured, [`Thresholds`] the limits; [`judge`] compares them and returns a
//! [`Verdict`] with its reasons, the worst first. Everything here is a plain number or a text: nothing reads
//! a clock, a file or a topic. Each source (a flight, a recording, a campaign) fills an outcome from samples,
//! so that the same samples have the same verdict, word for word.

mod check;
mod outcome;
mod reason;
mod thresholds;

pub use check::{CHECKS, Check, Unit};
pub use outcome::{Clipping, Contact, End, Misses, Outcome, SafeMode, Tracking, worst};
pub use reason::Reason;
pub use thresholds::{Basis, LOST_M, LOST_RAD, Threshold, Thresholds};

use core::fmt;
use serde::Serialize;
use serde::ser::{SerializeStruct, Serializer};

/// Grade of a flight, the best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Grade {
    /// It was flown to its end, and every measurement is within its limit.
    Passed,
    /// It was not flown, or not recorded, to its end, so that the rest is unknown.
    Incomplete,
    /// A measurement exceeds its limit.
    Failed,
    /// The vehicle was lost: its rotors were cut, or it ended far from its path or its set point.
    Lost,
    /// A process failed permanently and ended the flight.
    Crashed,
}

impl Grade {
    /// All grades, the best first.
    pub const ALL: [Self; 5] =
        [Self::Passed, Self::Incomplete, Self::Failed, Self::Lost, Self::Crashed];

    /// The word that every output begins with.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Passed => "PASSED",
            Self::Incomplete => "INCOMPLETE",
            Self::Failed => "FAILED",
            Self::Lost => "LOST",
            Self::Crashed => "CRASHED",
        }
    }
}

impl fmt::Display for Grade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

impl Serialize for Grade {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.word())
    }
}

/// Grade of a flight, with the reasons for it and the limits by which it was judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    grade: Grade,
    reasons: Vec<Reason>,
    thresholds: Thresholds,
}

/// Compares the measurements of a flight with its limits. A measurement that is not a number exceeds every
/// limit.
#[must_use]
pub fn judge(outcome: &Outcome, thresholds: &Thresholds) -> Verdict {
    let mut reasons = reason::of_the_end(outcome);
    let measured = CHECKS.iter().filter_map(|check| {
        let (measured, limit) = ((check.measure)(outcome)?, thresholds.limit(check.key)?);
        let kept = measured <= limit;
        (!kept).then(|| reason::of_a_check(check, outcome, measured, limit))
    });
    reasons.extend(measured);
    // The sort is stable, so that reasons of the same grade stay in the order of the checks.
    reasons.sort_by_key(|reason| core::cmp::Reverse(reason.grade));
    let grade = reasons.first().map_or(Grade::Passed, |reason| reason.grade);
    if reasons.is_empty() {
        reasons.push(reason::of_success(outcome, thresholds));
    }
    Verdict { grade, reasons, thresholds: thresholds.clone() }
}

impl Verdict {
    /// How good the flight was.
    #[must_use]
    pub const fn grade(&self) -> Grade {
        self.grade
    }

    /// True if there is no reason against the flight.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.grade == Grade::Passed
    }

    /// Why, the worst first; at least one. Of a flight that passed it is the evidence that it did.
    #[must_use]
    pub fn reasons(&self) -> &[Reason] {
        &self.reasons
    }

    /// By what it was judged.
    #[must_use]
    pub const fn thresholds(&self) -> &Thresholds {
        &self.thresholds
    }

    /// The first reason, and how many more there are.
    #[must_use]
    pub fn reason(&self) -> String {
        let first = self.reasons.first().map_or("", |reason| reason.text.as_str());
        match self.reasons.len().saturating_sub(1) {
            0 => first.to_owned(),
            1 => format!("{first}; and 1 reason more"),
            more => format!("{first}; and {more} reasons more"),
        }
    }

    /// The line that every output about the flight of a scenario begins with.
    #[must_use]
    pub fn line(&self, scenario: &str) -> String {
        format!("{}  {scenario}: {}", self.grade, self.reason())
    }
}

impl Serialize for Verdict {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serializer.serialize_struct("Verdict", 3)?;
        object.serialize_field("verdict", &self.grade)?;
        object.serialize_field("reasons", &self.reasons)?;
        object.serialize_field("thresholds", &self.thresholds)?;
        object.end()
    }
}
