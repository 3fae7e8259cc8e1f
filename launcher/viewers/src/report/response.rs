//! What followed each disturbance, swap, order and fault.

use crate::view::{Envelope, Gathered, Kind};
use serde::Serialize;

/// How long before and after is looked at \[s\].
const BEFORE_S: f64 = 1.0;
const AFTER_S: f64 = 2.0;
/// Most faults that are reported, so that a storm of them does not hide everything else.
const MAX_FAULTS: usize = 40;

/// The error around one instant. Of a flight on a path it is that of the position, of a rig that of the
/// attitude; each along its worst axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Response {
    /// When \[s\].
    pub at_s: f64,
    pub what: String,
    /// Unit of the errors.
    pub unit: &'static str,
    /// Largest error in the second before.
    pub before: f64,
    /// Largest error in the two seconds after.
    pub peak: f64,
    /// From then until the error stays within what it was before \[s\]; none if not in those two seconds.
    pub back_s: Option<f64>,
}

/// Errors of one axis over time.
type Errors = Vec<(f64, f64)>;

/// Around every mark of the time axis.
pub(super) fn responses(gathered: &Gathered) -> Vec<Response> {
    let (unit, axes) = errors(gathered);
    let mut faults = 0;
    let marks = gathered.happenings.iter().filter(|happening| {
        faults += usize::from(happening.is_mark && happening.kind == Kind::Fault);
        happening.is_mark && (happening.kind != Kind::Fault || faults <= MAX_FAULTS)
    });
    let around = marks.filter_map(|mark| {
        let within = |from: f64, to: f64| {
            axes.iter().flatten().copied().filter(move |(t, _)| (from..to).contains(t))
        };
        let worst = |from: f64, to: f64| within(from, to).map(|(_, e)| e).reduce(f64::max);
        let before = worst(mark.at_s - BEFORE_S, mark.at_s).unwrap_or(0.0);
        let peak = worst(mark.at_s, mark.at_s + AFTER_S)?;
        let outside = within(mark.at_s, mark.at_s + AFTER_S).filter(|(_, e)| *e > before);
        let last = outside.map(|(t, _)| t - mark.at_s).reduce(f64::max).unwrap_or(0.0);
        let seen_to =
            axes.iter().filter_map(|axis| axis.last()).map(|(t, _)| *t).fold(0.0, f64::max);
        // Outside until the last sample is not back; samples of the window's last twentieth may be those.
        let end = (mark.at_s + AFTER_S).min(seen_to) - mark.at_s;
        let back_s = (last < 0.95 * end).then_some(last);
        let what = mark.text.clone();
        Some(Response { at_s: mark.at_s, what, unit, before, peak, back_s })
    });
    around.collect()
}

/// Sizes of the errors, by axis.
fn errors(gathered: &Gathered) -> (&'static str, [Errors; 3]) {
    let panels = &gathered.panels;
    if !panels.error.is_empty() {
        let of = |i: usize| sizes(&panels.error.series[i].envelope, |_| 0.0);
        return ("mm", [of(0), of(1), of(2)]);
    }
    let of = |i: usize| {
        let wanted: Errors =
            panels.attitude.series[3 + i].envelope.intervals().map(|(t, _, v)| (t, v)).collect();
        let at = |t: f64| {
            let until = wanted.partition_point(|(from, _)| *from <= t);
            until.checked_sub(1).map_or(f64::NAN, |last| wanted[last].1)
        };
        sizes(&panels.attitude.series[i].envelope, at)
    };
    ("deg", [of(0), of(1), of(2)])
}

/// How far an envelope is from what was wanted, at most, in each of its intervals.
fn sizes(envelope: &Envelope, wanted: impl Fn(f64) -> f64) -> Errors {
    let bins = envelope.intervals();
    let sizes =
        bins.map(|(t, low, high)| (t, (low - wanted(t)).abs().max((high - wanted(t)).abs())));
    sizes.filter(|(_, error)| error.is_finite()).collect()
}
