//! What is reported of a slot: sentences for the flight's log, answers to the client that asked, the table of swaps.

use super::{News, Place, Slots, SwapEnd};
use shared_types::Slot;
use shared_types::time::s_from_ns;
use slot::{Action, Outcome, Reason, Report, Seat, Step};

impl Slots {
    pub(super) fn report(&mut self, slot: Slot, report: &Report) {
        let text = self.orders.notify(slot, report);
        let begun = self.machines.get(&slot).and_then(|m| m.record()).is_none_or(|r| r.epoch > 1);
        if matches!(report, Report::Step(Step::Commands(_))) && !begun {
            // Which program begins is in the scenario, and no news.
            return;
        }
        let warning = match report {
            Report::Refused(_) => true,
            Report::Aborted(seat, reason) => {
                if let Reason::Rehearsal(refusal) = reason {
                    self.refuse_rehearsed(slot, &refusal.to_string());
                }
                let ended = self.how_aborted(slot, *seat, reason);
                let outcome = match (reason, self.orders.end_of(slot, *seat)) {
                    (Reason::Fault(_), Some(how)) => format!("{reason}: {how}"),
                    _ => reason.to_string(),
                };
                self.end(slot, &outcome, (ended, false));
                true
            }
            Report::Done(_, outcome) => {
                let ended = match outcome {
                    Outcome::RolledBack => SwapEnd::Withdrawn,
                    _ => SwapEnd::Kept,
                };
                if *outcome != Outcome::Retired {
                    self.end(slot, &text, (ended, true));
                }
                false
            }
            Report::Step(step) => {
                self.note(slot, step);
                matches!(
                    step,
                    Step::Forced(..)
                        | Step::RehearsalForced(..)
                        | Step::WithoutFallback(_)
                        | Step::TriedAgain { .. }
                        | Step::TookOver { .. }
                        | Step::Ownerless(..)
                        | Step::Replaced(..)
                        | Step::FallbackLost { .. }
                        | Step::StandbyLost(..)
                        | Step::StandbyGivenUp(_)
                        | Step::StandbyUntrusted(_)
                )
            }
        };
        self.add_news(text, warning);
    }

    /// Writes a step into the report of the swap that is going on.
    pub(super) fn note(&mut self, slot: Slot, step: &Step) {
        match step {
            Step::TookOver { from, fault, .. } => {
                return self.take_back(slot, *from, &fault.to_string());
            }
            Step::Replaced(seat, _) => {
                return self.take_back(slot, *seat, "it was lost again");
            }
            _ => {}
        }
        let Some(state) = self.states.get_mut(&slot) else { return };
        if let (Step::FlipsAt { at_ns, .. }, Some(gate)) = (step, &mut state.gate) {
            gate.flips_at(*at_ns);
        }
        match step {
            Step::Flipped { seat, .. } => state.commanding[seat.index()] = state.current,
            // Another process has the seat next.
            Step::Left(seat) | Step::Joined { seat, .. } => state.commanding[seat.index()] = None,
            _ => {}
        }
        let Some(report) = state.current.and_then(|at| self.reports.get_mut(at)) else { return };
        match step {
            Step::Joined { same_kind, at_ns, .. } => {
                report.joined_s = Some(s_from_ns(*at_ns));
                report.same_kind = Some(*same_kind);
            }
            Step::Rehearsed(_, verdict) => report.rehearsal = Some(verdict.clone()),
            Step::RehearsalForced(_, refusal) => {
                report.rehearsal = Some(format!("overruled: {refusal}"));
            }
            Step::Flipped { epoch, at_ns, .. } => {
                report.flipped_s = Some(s_from_ns(*at_ns));
                report.epoch = Some(*epoch);
            }
            _ => {}
        }
    }

    /// How a swap to the process on a seat has ended that came to nothing.
    fn how_aborted(&self, slot: Slot, seat: Seat, reason: &Reason) -> SwapEnd {
        let state = self.states.get(&slot);
        let struck = state.map_or(&[][..], |state| &state.struck);
        let is_meant = match reason {
            Reason::RolledBack | Reason::Retired => true,
            Reason::OwnerLost => !struck.is_empty(),
            Reason::Fault(_) => struck.contains(&seat),
            _ => false,
        };
        let report = state.and_then(|state| self.reports.get(state.current?));
        match report {
            _ if is_meant => SwapEnd::Withdrawn,
            Some(report) if report.flipped_s.is_some() => SwapEnd::TakenBack,
            _ => SwapEnd::Refused,
        }
    }

    /// Writes down that the owner on `seat` has lost the slot after its swap had ended well.
    fn take_back(&mut self, slot: Slot, seat: Seat, why: &str) {
        let Some(state) = self.states.get_mut(&slot) else { return };
        let is_meant = state.struck.contains(&seat);
        let commanding = state.commanding[seat.index()].take();
        let report = commanding.and_then(|at| self.reports.get_mut(at));
        if let Some(report) = report.filter(|report| report.done) {
            report.outcome = format!("taken back: {why}");
            report.ended = if is_meant { SwapEnd::Withdrawn } else { SwapEnd::TakenBack };
        }
    }

    fn refuse_rehearsed(&mut self, slot: Slot, refusal: &str) {
        let current = self.states.get(&slot).and_then(|state| state.current);
        if let Some(report) = current.and_then(|at| self.reports.get_mut(at)) {
            report.rehearsal = Some(refusal.to_owned());
        }
    }

    /// Writes down how what was going on ended.
    pub(super) fn end(&mut self, slot: Slot, outcome: &str, (ended, done): (SwapEnd, bool)) {
        let Some(state) = self.states.get_mut(&slot) else { return };
        let gate = state.gate.take();
        let report = state.current.take().and_then(|at| self.reports.get_mut(at));
        let Some(report) = report else { return };
        if let Some(gate) = &gate {
            report.measured(gate);
        }
        outcome.clone_into(&mut report.outcome);
        (report.ended, report.done) = (ended, done);
    }

    /// A fault of the script strikes the process on a seat: what becomes of a swap by that is meant to.
    pub(super) fn strike(&mut self, place: Place) {
        let slot = self.slot_of(place.role).and_then(|slot| self.states.get_mut(&slot));
        if let (Some(state), Some(seat)) = (slot, Seat::new(place.index)) {
            state.struck.push(seat);
        }
    }

    pub(super) fn add_news(&mut self, text: String, warning: bool) {
        self.news.push(News { text, warning });
    }

    /// A swap that has been refused at once ends there.
    pub(super) fn end_last(&mut self, actions: &[Action]) {
        let reason = actions.iter().find_map(|action| match action {
            Action::Report(Report::Refused(reason)) => Some(reason),
            _ => None,
        });
        if let (Some(report), Some(reason)) = (self.reports.last_mut(), reason) {
            report.refuse(reason);
        }
    }

    /// The flight is over: what is still going on ends as it is.
    pub fn finish(&mut self) {
        for slot in Slot::ALL {
            self.end_tripped(slot);
            self.end(slot, "the flight ended first", (SwapEnd::Open, false));
        }
    }

    /// An owner that has tripped has lost its slot, although the flight ended before its successor was confirmed.
    fn end_tripped(&mut self, slot: Slot) {
        let Some((seat, state)) = self.unconfirmed_trip(slot).zip(self.states.get(&slot)) else {
            return;
        };
        let why = "the monitor tripped it, and the flight ended";
        if state.current.is_some() && state.current == state.commanding[seat.index()] {
            self.end(slot, why, (SwapEnd::TakenBack, false));
        } else {
            self.take_back(slot, seat, why);
        }
    }
}
