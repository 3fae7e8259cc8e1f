//! Why a verdict is what it is, in sentences that name a number and its limit.

use crate::{Check, End, Grade, Outcome, Thresholds, Unit};
use serde::Serialize;

/// One reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reason {
    /// What it makes of the flight.
    pub grade: Grade,
    /// The limit that was not kept, or that was; as in `[verdict]`, or `flown_s` and `recording`.
    pub key: &'static str,
    /// What was measured; not there if it is no number.
    #[serde(serialize_with = "finite")]
    pub measured: f64,
    /// What it was compared with.
    #[serde(serialize_with = "finite")]
    pub limit: f64,
    /// Both of it as a sentence without its full stop.
    pub text: String,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde calls")]
fn finite<S: serde::Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    value.is_finite().then_some(*value).serialize(serializer)
}

pub(crate) fn of_a_check(check: &Check, outcome: &Outcome, measured: f64, limit: f64) -> Reason {
    let (told, told_limit) = check.unit.tell_both(measured, limit);
    let text = format!("{} {told}{}, limit {told_limit}", check.name, (check.detail)(outcome));
    Reason { grade: check.grade, key: check.key, measured, limit, text }
}

/// What the end of the flight and of its recording say against it.
pub(crate) fn of_the_end(outcome: &Outcome) -> Vec<Reason> {
    let Outcome { end, flown_s, planned_s, unrecorded, .. } = outcome;
    let ended = |grade, why: &str| {
        let text = format!("flown {flown_s:.3} s of {planned_s:.3} s planned: {why}");
        Reason { grade, key: "flown_s", measured: *flown_s, limit: *planned_s, text }
    };
    // Rounding of an instant is no time that is missing.
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

/// What speaks for a flight that kept every limit.
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
    let text =
        format!("flown {flown_s:.3} s, {name} {}, limit {}", unit.tell(measured), unit.tell(limit));
    Reason { grade: Grade::Passed, key, measured, limit, text }
}
