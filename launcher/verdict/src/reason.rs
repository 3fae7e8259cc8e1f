//! The reasons of a verdict, as sentences that name a measurement and its limit.

use crate::{Check, End, Grade, Outcome, Thresholds, Unit};
use serde::Serialize;

/// One reason of a verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reason {
    /// Grade that follows from this reason.
    pub grade: Grade,
    /// Key of the limit: one of `[verdict]`, `flown_s` or `recording`.
    pub key: &'static str,
    /// The measurement, in the unit of the key; null in JSON if it is not finite.
    #[serde(serialize_with = "finite")]
    pub measured: f64,
    /// The limit, in the same unit; null in JSON if it is not finite.
    #[serde(serialize_with = "finite")]
    pub limit: f64,
    /// Measurement and limit as a sentence without its full stop.
    pub text: String,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde calls")]
fn finite<S: serde::Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    value.is_finite().then_some(*value).serialize(serializer)
}

pub(crate) fn of_a_check(check: &Check, outcome: &Outcome, measured: f64, limit: f64) -> Reason {
    let (value, limit_text) = check.unit.text_of_both(measured, limit);
    let text = format!("{} {value}{}, limit {limit_text}", check.name, (check.detail)(outcome));
    Reason { grade: check.grade, key: check.key, measured, limit, text }
}

/// Reasons against a flight that ended early or whose recording is incomplete.
pub(crate) fn of_the_end(outcome: &Outcome) -> Vec<Reason> {
    let Outcome { end, flown_s, planned_s, unrecorded, .. } = outcome;
    let ended = |grade, why: &str| {
        let text = format!("flown {flown_s:.3} s of {planned_s:.3} s planned: {why}");
        Reason { grade, key: "flown_s", measured: *flown_s, limit: *planned_s, text }
    };
    // An end that differs by the rounding of an instant still counts as the planned end.
    let is_whole = *flown_s >= *planned_s - 1e-6;
    let end = match end {
        End::Planned if is_whole => None,
        End::Planned => Some(ended(Grade::Incomplete, "it ended before its time")),
        End::Interrupted => Some(ended(Grade::Incomplete, "interrupted")),
        End::Cut(why) => Some(ended(Grade::Incomplete, why)),
        End::Crashed(why) => Some(ended(Grade::Crashed, why)),
    };
    let unrecorded = unrecorded.as_ref().map(|why| Reason {
        grade: Grade::Incomplete,
        key: "recording",
        measured: 1.0,
        limit: 0.0,
        text: format!("1 recording incomplete, limit 0: {why}"),
    });
    end.into_iter().chain(unrecorded).collect()
}

/// The reason for a flight that kept every limit: its error with the limit.
pub(crate) fn of_success(outcome: &Outcome, thresholds: &Thresholds) -> Reason {
    let limit = |key| thresholds.limit(key).unwrap_or(f64::INFINITY);
    let (key, name, unit, measured) = match (&outcome.tracking, outcome.turned_rad) {
        (Some(tracking), _) => ("tracking_max_m", "tracking error", Unit::Metre, tracking.max_m),
        (None, Some(turned_rad)) => {
            ("attitude_end_max_rad", "attitude error at the end", Unit::Radian, turned_rad)
        }
        (None, None) => ("tilt_max_rad", "tilt", Unit::Radian, outcome.tilt_rad),
    };
    let (limit, flown_s) = (limit(key), outcome.flown_s);
    // The larger one of a flight that was disturbed by a fault is not to be left out.
    let recovering = outcome.tracking.as_ref().map(|tracking| tracking.recovering_m);
    let recovering = recovering.filter(|error_m| *error_m > measured);
    let recovering = recovering
        .map_or(String::new(), |error_m| format!(" ({} while it recovered)", unit.text(error_m)));
    let (measured_text, limit_text) = (unit.text(measured), unit.text(limit));
    let text =
        format!("flown {flown_s:.3} s, {name} {measured_text}{recovering}, limit {limit_text}");
    Reason { grade: Grade::Passed, key, measured, limit, text }
}
