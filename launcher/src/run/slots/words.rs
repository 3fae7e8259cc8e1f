//! What happens in a slot, in sentences.

use super::ledger::seconds;
use slot::record::Seat;
use slot::supervisor::{Program, Step};

/// How to call whoever is meant.
pub(super) struct Names<'a> {
    /// Whoever sits on a seat, with the seat.
    pub(super) on: &'a dyn Fn(Seat) -> String,
    /// A program.
    pub(super) of: &'a dyn Fn(Program) -> String,
}

/// A step in words, and whether something did not go as asked for.
pub(super) fn words(step: &Step, names: &Names<'_>) -> (String, bool) {
    let name = |seat: &Seat| (names.on)(*seat);
        match step {
            Step::Joined { seat, same_kind, at_ns } => {
                let how = if *same_kind {
                    "restores its predecessor's state"
                } else {
                    "is of another kind (its state has another layout) and tracks what is applied"
                };
                (format!("{} joined at {:.6} s and {how}", name(seat), seconds(*at_ns)), false)
            }
            Step::RunsFree(seat) => (format!("{} runs free", name(seat)), false),
            Step::Passed(seat, figures) => {
                let worst = |worst: &[slot::gate::Worst; 4]| {
                    100.0 * worst.iter().map(|w| w.value).fold(0.0, f64::max)
                };
                let text = format!(
                    "{} passed the gate: {} commands one step ahead, at most {:.3} % apart; {} running free, at most {:.3} %",
                    name(seat),
                    figures.tracked,
                    worst(&figures.tracking_worst),
                    figures.free,
                    worst(&figures.free_worst),
                );
                (text, false)
            }
            Step::Forced(seat, refusal) => {
                (format!("{} goes on by force although {refusal}", name(seat)), true)
            }
            Step::FlipsAt { seat, epoch, at_ns } => {
                let at_s = seconds(*at_ns);
                (format!("{} is to command from {at_s:.6} s on, epoch {epoch}", name(seat)), false)
            }
            Step::Flipped { seat, epoch, at_ns } => {
                let at_s = seconds(*at_ns);
                (format!("{} commands since {at_s:.6} s, epoch {epoch}", name(seat)), false)
            }
            Step::TriedAgain { epoch, tries } => {
                (format!("the owner record came too late; attempt {tries} is epoch {epoch}"), true)
            }
            Step::TookOver { seat, from, fault } => {
                (format!("{} took over from {from}: {fault}", name(seat)), true)
            }
            Step::Ownerless(seat, fault) => {
                (format!("nobody commands: {fault}; {} is started again", name(seat)), true)
            }
            Step::Commands(seat) => (format!("{} commands", name(seat)), false),
            Step::StandbyLost(seat, fault) => {
                (format!("{} no longer stands by: {fault}", name(seat)), true)
            }
            Step::StandbyGivenUp(program) => {
                (format!("{} is given up as a standby", (names.of)(*program)), true)
            }
            Step::Left(seat) => (format!("{} has left", name(seat)), false),
        }
    }

