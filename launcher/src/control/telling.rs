//! Sentences and figures about what goes on in a slot, for whoever asked and for the recording.

use super::protocol::{Done, Figures, Progress};
use crate::candidate::Slot;
use slot::{GateFigures, Outcome, Seat, Step};

/// Puts the names of instances where a sentence speaks of seats.
pub(super) fn with_names(text: &str, name: impl Fn(Seat) -> String) -> String {
    Seat::ALL
        .into_iter()
        .fold(text.to_owned(), |text, seat| text.replace(&seat.to_string(), &name(seat)))
}

/// The first word to whoever asked.
pub(super) fn accepted(slot: Slot) -> Progress {
    said(slot, "accepted", None, "under way")
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
                ..said(slot, "gate", None, &text)
            };
        }
        Step::Forced(..) => ("forced", None),
        Step::FlipsAt { at_ns, .. } => ("flips", Some(*at_ns)),
        Step::Flipped { at_ns, .. } => ("flipped", Some(*at_ns)),
        Step::TriedAgain { .. } => ("tried again", None),
        Step::TookOver { .. } => ("took over", None),
        Step::Ownerless(..) => ("ownerless", None),
        Step::Replaced(..) => ("replaced", None),
        Step::Commands(_) => ("commands", None),
        Step::StandbyLost(..) => ("standby lost", None),
        Step::StandbyGivenUp(_) => ("standby given up", None),
        Step::Left(_) => ("left", None),
    };
    said(slot, word, at_ns, &text)
}

fn said(slot: Slot, step: &str, at_ns: Option<u64>, text: &str) -> Progress {
    let text = format!("{} slot: {text}", slot.label());
    Progress { slot: slot.label().to_owned(), step: step.to_owned(), at_ns, text, figures: None }
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

fn worst(axes: impl Iterator<Item = f64>) -> f64 {
    axes.fold(0.0, f64::max)
}

fn measured(of_gate: &GateFigures) -> String {
    let GateFigures { tracked, free, tracking_worst, free_worst, free_rms, missed, .. } = of_gate;
    let percent = |share: f64| format!("{:.3} %", 100.0 * share);
    let tracking = match tracked {
        0 => String::new(),
        n => {
            let worst = percent(worst(tracking_worst.iter().map(|axis| axis.value)));
            format!("one step ahead at most {worst} of the largest command in {n} instants; ")
        }
    };
    let rms = percent(worst(free_rms.iter().copied()));
    let free_worst = percent(worst(free_worst.iter().map(|axis| axis.value)));
    format!(
        "{tracking}running free at most {free_worst}, {rms} rms in {free} instants; {missed} deadlines missed"
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
    }
}
