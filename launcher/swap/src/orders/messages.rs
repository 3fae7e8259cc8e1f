//! Sentences and figures about what goes on in a slot, for the client that asked and for the recording.

use protocol::control::protocol::{Done, Figures, Progress};
use shared_types::Slot;
use slot::{GateFigures, Outcome, Seat, Step};

/// Puts the names of instances where a sentence names seats.
pub(super) fn with_names(text: &str, name: impl Fn(Seat) -> String) -> String {
    Seat::ALL
        .into_iter()
        .fold(text.to_owned(), |text, seat| text.replace(&seat.to_string(), &name(seat)))
}

/// The first reply to the client that asked.
pub(super) fn accepted(slot: Slot) -> Progress {
    progress_of(slot, "accepted", None, "under way")
}

/// A step on the way, with the names of instances.
pub(super) fn progress(slot: Slot, step: &Step, name: impl Fn(Seat) -> String) -> Progress {
    let text = with_names(&step.to_string(), name);
    let (word, at_ns) = match step {
        Step::Joined { at_ns, .. } => ("joined", Some(*at_ns)),
        Step::RunsFree(_) => ("shadowing", None),
        Step::Passed(_, of_gate) => {
            let text = format!("{text}: {}", measured(of_gate));
            return Progress {
                figures: Some(figures_of(of_gate)),
                ..progress_of(slot, "gate", None, &text)
            };
        }
        Step::Forced(..) | Step::RehearsalForced(..) => ("forced", None),
        Step::Rehearses(..) => ("rehearses", None),
        Step::Rehearsed(..) => ("rehearsed", None),
        Step::FallbackStays { .. } => ("fallback stays", None),
        Step::WithoutFallback(_) => ("without fallback", None),
        Step::FlipsAt { at_ns, .. } => ("flips", Some(*at_ns)),
        Step::Flipped { at_ns, .. } => ("flipped", Some(*at_ns)),
        Step::TriedAgain { .. } => ("tried again", None),
        Step::TookOver { .. } => ("took over", None),
        Step::Ownerless(..) => ("ownerless", None),
        Step::Replaced(..) => ("replaced", None),
        Step::Commands(_) => ("commands", None),
        Step::FallbackLost { .. } => ("fallback lost", None),
        Step::StandbyLost(..) => ("standby lost", None),
        Step::StandbyGivenUp(_) | Step::StandbyUntrusted(_) => ("standby given up", None),
        Step::Left(_) => ("left", None),
    };
    progress_of(slot, word, at_ns, &text)
}

fn progress_of(slot: Slot, step: &str, at_ns: Option<u64>, text: &str) -> Progress {
    let text = format!("{} slot: {text}", slot.label());
    let (slot, step) = (slot.label().to_owned(), step.to_owned());
    Progress { slot, step, at_ns, text, figures: None, course: Vec::new() }
}

/// How a candidate failed that was flown ahead.
pub(super) fn failed(slot: Slot, course: Vec<[f64; 8]>) -> Progress {
    Progress { course, ..progress_of(slot, "fails", None, "its rehearsal fails") }
}

/// The end of an order.
pub(super) fn done(slot: Slot, outcome: Outcome, name: &str) -> Done {
    let word = match outcome {
        Outcome::Swapped => "swapped",
        Outcome::RolledBack => "rolled back",
        Outcome::DryRun => "dry run",
        Outcome::StandsBy => "stands by",
        Outcome::Retired => "retired",
    };
    let text = format!("{} slot: {name}: {outcome}", slot.label());
    Done { slot: slot.label().to_owned(), outcome: word.to_owned(), text }
}

/// The axis that comes closest to its limit: figure and limit.
fn tightest(figures: [f64; 4], limits: [f64; 4]) -> (f64, f64) {
    let share = |(figure, limit): &(f64, f64)| figure / limit.max(f64::MIN_POSITIVE);
    let axes = figures.into_iter().zip(limits);
    axes.max_by(|a, b| share(a).total_cmp(&share(b))).unwrap_or_default()
}

fn measured(of_gate: &GateFigures) -> String {
    let GateFigures { tracked, free, free_rms, free_rms_max, missed, missed_max, .. } = of_gate;
    let shown = |(figure, limit): (f64, f64)| {
        format!("{:.3} % ({:.3} % allowed)", 100.0 * figure, 100.0 * limit)
    };
    let tracking = match tracked {
        0 => String::new(),
        n => {
            let worst = of_gate.tracking_worst.map(|axis| axis.value);
            let worst = shown(tightest(worst, of_gate.tracking_worst_max));
            format!("one step ahead at most {worst} of the largest command in {n} instants; ")
        }
    };
    let rms = shown(tightest(*free_rms, *free_rms_max));
    let worst = of_gate.free_worst.map(|axis| axis.value);
    let worst = shown(tightest(worst, of_gate.free_worst_max));
    format!(
        "{tracking}running free at most {worst}, {rms} rms in {free} instants; {missed} deadlines missed ({missed_max} allowed)"
    )
}

fn figures_of(of_gate: &GateFigures) -> Figures {
    Figures {
        tracked: of_gate.tracked,
        free: of_gate.free,
        tracking_worst: of_gate.tracking_worst.map(|axis| axis.value),
        free_worst: of_gate.free_worst.map(|axis| axis.value),
        free_rms: of_gate.free_rms,
        slope: of_gate.slope.map(|slope| Some(slope?.value)),
        missed: of_gate.missed,
        tracking_worst_max: of_gate.tracking_worst_max,
        free_worst_max: of_gate.free_worst_max,
        free_rms_max: of_gate.free_rms_max,
        missed_max: of_gate.missed_max,
    }
}
