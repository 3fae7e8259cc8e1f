//! From what was measured to a verdict, for a running flight, a recording and a case of a campaign alike.

use super::facts::Facts;
use super::loops::{missed, seat_name};
use super::metrics::Metrics;
use ::verdict::{End, Grade, Misses, Outcome, Verdict, judge};
use host::exit;
use shared_types::LoopStats;

/// Of a recording's summary: how the flight ended.
pub const ENDED: &str = "ended";
/// Of a recording's summary: logical time through which every loop is complete \[ns\].
pub const FLOWN_NS: &str = "flown_ns";
/// The text for a flight that ended at the instant planned.
const PLANNED: &str = "as planned";
/// The text for a flight that the user ended.
const INTERRUPTED: &str = "interrupted";
/// What comes before the reason of a crash.
const CRASHED: &str = "crashed: ";

/// What no sample shows of a flight.
#[derive(Debug, Clone, Default)]
pub struct Closing {
    /// How it ended.
    pub end: End,
    /// Logical time through which every loop is complete \[ns\].
    pub flown_ns: u64,
    /// Samples and states that the recorder lost, and their writers.
    pub dropped: (u64, String),
    /// Hashes of a recording that are not those of its flight.
    pub altered: u64,
    /// Why the recording is incomplete.
    pub unrecorded: Option<String>,
    /// Only what cannot be contradicted any more counts of the commands: the topics of a file that is cut end at
    /// different instants.
    pub is_cut: bool,
}

/// How a flight ended, as a recording keeps it.
#[must_use]
pub fn describe_end(end: &End) -> String {
    match end {
        End::Planned => PLANNED.to_owned(),
        End::Interrupted => INTERRUPTED.to_owned(),
        End::Cut(why) => why.clone(),
        End::Crashed(why) => format!("{CRASHED}{why}"),
    }
}

/// Reads back what [`describe_end`] has written.
#[must_use]
pub fn read(text: &str) -> End {
    match text.strip_prefix(CRASHED) {
        Some(why) => End::Crashed(why.to_owned()),
        None if text == PLANNED => End::Planned,
        None if text == INTERRUPTED => End::Interrupted,
        None => End::Cut(text.to_owned()),
    }
}

/// Exit code of a flight: 0 if it passed, 4 for a crash, 130 for an interrupt, 3 for an incomplete recording, 1
/// for everything else.
#[must_use]
pub fn exit_code(closing: &Closing, verdict: &Verdict) -> u8 {
    match (&closing.end, verdict.grade()) {
        (End::Crashed(_), _) => exit::CRASHED,
        (End::Interrupted, _) => exit::INTERRUPTED,
        _ if closing.unrecorded.is_some() => exit::UNFIT,
        (_, Grade::Passed) => exit::PASS,
        _ => exit::FAILED,
    }
}

impl Metrics {
    /// Judges what has been seen; call [`Metrics::finish`] first.
    #[must_use]
    pub fn judge(&self, closing: &Closing) -> Verdict {
        judge(&self.outcome(closing), &self.rules().thresholds)
    }

    /// The line that every output about this flight begins with.
    #[must_use]
    pub fn line(&self, verdict: &Verdict) -> String {
        verdict.line(&self.rules().scenario)
    }

    /// The facts of the flight; call [`Metrics::finish`] first.
    #[must_use]
    pub fn facts(&self, closing: &Closing) -> Facts {
        Facts::of(self, &self.outcome(closing))
    }

    /// What has been measured; call [`Metrics::finish`] first.
    #[must_use]
    pub fn outcome(&self, closing: &Closing) -> Outcome {
        let Closing { end, flown_ns, dropped, altered, unrecorded, is_cut } = closing.clone();
        let evidence = self.evidence();
        let commands = if is_cut { self.settled_commands() } else { self.commands() };
        let turned_rad = self.attitude_error_rad();
        let (cut_s, cut_at_s) = evidence.cut_s();
        let loops = self.loops();
        Outcome {
            end,
            flown_s: flown_ns as f64 * 1e-9,
            planned_s: self.rules().planned_ns as f64 * 1e-9,
            tracking: evidence.tracking(self.tracking().last_second_m),
            turned_rad,
            contact: evidence.contact(),
            tilt_rad: evidence.tilt_rad(),
            safe_mode: evidence.safe_mode(),
            clipping: evidence.clipping(),
            cut_s,
            cut_at_s,
            violations: self.violations(),
            unsolved: self.unsolved(),
            missed: worst_of(&loops, missed),
            late: worst_of(&loops, |stats| stats.late_samples),
            wrong_owner: commands.wrong_owner,
            duplicated: commands.duplicated,
            dropped: dropped.0,
            dropped_of: dropped.1,
            altered,
            unrecorded,
        }
    }
}

/// What the loop has missed that missed the largest share of its releases; the first of several.
fn worst_of(loops: &[LoopStats], count: impl Fn(&LoopStats) -> u64) -> Misses {
    let mut worst = Misses::default();
    for stats in loops {
        let count = count(stats);
        let share = count as f64 / stats.steps.saturating_add(stats.skipped).max(1) as f64;
        if count > 0 && share > worst.share {
            let of = seat_name(stats);
            worst = Misses { count, share, of };
        }
    }
    worst
}
