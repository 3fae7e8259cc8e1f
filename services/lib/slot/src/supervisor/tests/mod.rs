//! Each arrow of the drawing, and what random events must never do.

mod events;
mod losses;
mod rehearsals;
mod swaps;

use super::*;
use crate::gate::Refusal;

const MS: u64 = 1_000_000;
const SEAT: [Seat; 4] = Seat::ALL;

fn instance(layout: u64) -> Instance {
    // 100 Hz, effective 1 ms after the release.
    Instance { layout, millihertz: 100_000, latency_ns: MS }
}

/// One that may command alone.
const fn program(number: u32) -> Program {
    Program { number, is_trusted: true }
}

/// One that a user brings.
const fn brought(number: u32) -> Program {
    Program { number, is_trusted: false }
}

const fn order(shadow_ns: u64) -> SwapTerms {
    SwapTerms { shadow_ns, rollback_ns: 500 * MS, force: false, rehearse: false, dry_run: false }
}

/// A slot and what it has asked for.
struct Bench {
    slot: SlotMachine,
    now: Now,
    actions: Vec<Action>,
}

impl Bench {
    /// In flight with an owner of layout 7 on seat 0.
    fn new(config: SlotConfig) -> Self {
        let now = Now { logical_ns: 0, allowed_ns: 0 };
        let slot = SlotMachine::new(config, SEAT[0], program(0));
        let mut bench = Self { slot, now, actions: Vec::new() };
        assert!(bench.slot.holds_time());
        bench.on(Event::Ready(SEAT[0], instance(7)));
        assert_eq!(bench.record().effective_ns, 0, "the first record counts from the start");
        bench.confirm();
        assert!(bench.slot.is_quiet());
        bench
    }

    fn at(&mut self, at_ns: u64) -> &mut Self {
        self.now = Now { logical_ns: at_ns, allowed_ns: at_ns };
        self
    }

    fn on(&mut self, event: Event) -> &mut Self {
        self.actions = self.slot.on(self.now, event);
        self
    }

    fn record(&self) -> Record {
        *self.slot.record().unwrap()
    }

    /// The consumer does as the newest record states.
    fn confirm(&mut self) -> &mut Self {
        let Record { epoch, owner, effective_ns, .. } = self.record();
        self.at(effective_ns.max(self.now.logical_ns));
        self.on(Event::Acknowledged { epoch, seat: owner, at_ns: effective_ns })
    }

    /// Time runs to the next instant that the slot has asked for.
    fn wait(&mut self) -> &mut Self {
        let at_ns = self.slot.deadline_ns().expect("a deadline");
        self.at(at_ns).on(Event::Time)
    }

    fn has(&self, wanted: impl Fn(&Action) -> bool) -> bool {
        self.actions.iter().any(wanted)
    }

    fn refusal(&self) -> Option<&Reason> {
        self.actions.iter().find_map(|action| match action {
            Action::Report(Report::Refused(reason) | Report::Aborted(_, reason)) => Some(reason),
            _ => None,
        })
    }

    fn swap(&mut self, layout: u64) -> &mut Self {
        self.on(Event::Request(Request::Swap(Target::New(program(1)), order(200 * MS))));
        assert!(
            self.has(|action| *action == Action::Spawn(SEAT[1], program(1))),
            "{:?}",
            self.actions
        );
        self.on(Event::Ready(SEAT[1], instance(layout)))
    }

    fn pass(&mut self, seat: Seat) -> &mut Self {
        assert!(self.has(|action| *action == Action::Judge(seat)), "{:?}", self.actions);
        self.on(Event::Verdict(seat, Ok(Box::default())))
    }

    /// Seat 1 commands and seat 0 is warm.
    fn in_window(config: SlotConfig) -> Self {
        let mut bench = Self::new(config);
        bench.at(1000 * MS).swap(7).confirm().wait().pass(SEAT[1]).confirm();
        assert!(matches!(bench.slot.phase, Phase::Window { .. }));
        bench
    }

    /// Seat 0 commands and seat 1 stands by.
    fn with_standby(config: SlotConfig) -> Self {
        let mut bench = Self::new(config);
        bench.on(Event::Request(Request::Standby(program(2), 100 * MS, false)));
        bench.on(Event::Ready(SEAT[1], instance(7))).confirm().wait().pass(SEAT[1]);
        assert_eq!(bench.record().fallback, Some(SEAT[1]));
        bench.confirm();
        bench
    }
}

fn failed() -> Refusal {
    Refusal::MissedDeadlines { missed: 3, limit: 0, at_ns: 5 }
}
