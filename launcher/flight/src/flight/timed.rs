//! A flight whose loops and samples take the time that a script sets: when its launcher decides, and when loops have
//! turns.
//!
//! What is decided between two stretches of the flight is decided as without processes: once all turns before it have been
//! taken, and all processes that come or go have come or gone.

use super::Flight;
use crate::turns::{Participant, Turns};
use record::Severity;
use runtime::clock::sleep_until;
use runtime::graph::CREDIT_NS;
use shared_types::Seat;
use swap::FAULT;

/// From one reminder of processes that others wait for to the next \[ns\].
const NUDGE_EVERY_NS: u64 = 5_000_000;

/// Wall time between two looks while processes come or go, or while a flight is held to a pace \[ns\].
const SHORT_NS: u64 = 500_000;

/// What there is beside a flight's own state if its clock is moved.
pub(super) struct Timed {
    turns: Turns,
    /// All turns before what is allowed have been taken.
    is_flown: bool,
    /// Seats of processes that the others wait for.
    held_by: Vec<Seat>,
    nudged_mono_ns: u64,
}

impl Timed {
    pub(super) fn new(turns: Turns) -> Self {
        Self { turns, is_flown: true, held_by: Vec::new(), nudged_mono_ns: 0 }
    }

    /// Turns that have been taken: what changes while the flight goes on.
    pub(super) fn taken(&self) -> u64 {
        self.turns.taken()
    }

    /// Seats of the processes that all others wait for.
    pub(super) fn held_by(&self) -> impl Iterator<Item = Seat> {
        self.held_by.iter().copied().chain(self.turns.awaited())
    }

    /// There are turns left to take, though nothing is to be decided before them.
    pub(super) fn resume(&mut self) {
        self.is_flown = false;
    }
}

impl Flight {
    /// True amid a stretch of the flight, in which nothing is decided.
    pub(super) fn is_amid_a_stretch(&self) -> bool {
        self.timed.as_ref().is_some_and(|timed| !timed.is_flown)
    }

    /// Goes on with the flight for a moment: allows the next stretch if the one before has been flown, and gives turns.
    pub(super) fn give_turns(&mut self, now_ns: u64) {
        let Some(mut timed) = self.timed.take() else { return };
        let participants = self.supervisor.participants();
        // What has been begun is always waited for, also while nothing new may begin.
        let has_answered = timed.turns.take_answer(&self.graph, &participants);
        let may_go_on = has_answered
            && self.is_settled(&mut timed, &participants, now_ns)
            && (!timed.is_flown || self.allow_more(&timed, now_ns));
        let until_ns = self.conductor.allowed_ns().min(self.conductor.paced_ns(now_ns));
        let end_ns = self.conductor.end_ns();
        let before = timed.turns.taken();
        if may_go_on {
            let is_flown = timed.turns.give_until(until_ns, end_ns, &self.graph, &participants);
            timed.is_flown = is_flown && until_ns >= self.conductor.allowed_ns();
        }
        self.announce_until(timed.turns.now_ns());
        let has_moved = timed.turns.taken() > before || (may_go_on && timed.is_flown);
        self.timed = Some(timed);
        if !has_moved {
            sleep_until(now_ns + SHORT_NS);
        }
    }

    /// Writes into the recording what of the script of times begins by an instant \[ns\].
    pub(super) fn announce_until(&mut self, now_ns: u64) {
        while let Some((from_ns, text)) = self.announcements.next_by(now_ns) {
            let text = format!("{FAULT}{text}");
            self.tap.sinks.note(from_ns, Severity::Info, "launcher", &text);
        }
    }

    /// True unless a process is about to come or to go, or has not given those that have come what it had published.
    fn is_settled(&mut self, timed: &mut Timed, participants: &[Participant], now_ns: u64) -> bool {
        let leaves = |participant: &&Participant| {
            let Seat { role, index } = participant.seat;
            let leave_ns = self.tap.marks.book_of(role).and_then(|book| book.released_ns(index));
            leave_ns.is_some_and(|at_ns| timed.turns.mark_ns(participant.seat) >= at_ns)
        };
        let leaving: Vec<_> =
            participants.iter().filter(|_| timed.is_flown).filter(leaves).collect();
        let unserved =
            participants.iter().filter(|one| !self.supervisor.has_served_all(one, &self.tap));
        let holding: Vec<_> = leaving.iter().copied().chain(unserved).collect();
        timed.held_by = holding.iter().map(|one| one.seat).collect();
        if now_ns >= timed.nudged_mono_ns.saturating_add(NUDGE_EVERY_NS) && !holding.is_empty() {
            timed.nudged_mono_ns = now_ns;
            for one in holding {
                timed.turns.nudge(one, leaving.iter().any(|leaving| leaving.seat == one.seat));
            }
        }
        timed.held_by.is_empty() && !self.supervisor.is_changing()
    }

    /// Allows the next stretch; false if something is to be done before, or time stands still.
    fn allow_more(&mut self, timed: &Timed, now_ns: u64) -> bool {
        let before_ns = self.conductor.allowed_ns();
        // What has been flown has not been looked at yet.
        let is_behind = self.drained_ns < before_ns;
        let is_due = self.script.is_due(&self.slots, self.logical_now(now_ns));
        if is_behind || is_due || self.supervisor.has_events() || self.slots.holds_time() {
            return false;
        }
        let end_ns = self.conductor.end_ns();
        let cap_ns = self.cap_ns(before_ns).min(end_ns);
        let mut allowed_ns = before_ns.saturating_add(CREDIT_NS).min(cap_ns);
        if allowed_ns <= before_ns {
            // A loop that is late gets there only if time goes on, and to its last turn beyond the end.
            let Some(turn_ns) = timed.turns.next_turn_ns() else { return false };
            allowed_ns = turn_ns.max(before_ns).saturating_add(1).min(end_ns);
        }
        self.conductor.allow(allowed_ns.max(before_ns));
        true
    }
}
