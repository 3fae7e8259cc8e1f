//! Each arrow of the drawing, and what random events must never do.

use super::*;
use crate::gate::{GateFigures, Refusal};
use proptest::prelude::*;

const MS: u64 = 1_000_000;
const SEAT: [Seat; 4] = Seat::ALL;

fn instance(layout: u64) -> Instance {
    // 100 Hz, effective 1 ms after the release.
    Instance { layout, millihertz: 100_000, latency_ns: MS }
}

const fn order(shadow_ns: u64) -> Order {
    Order { shadow_ns, rollback_ns: 500 * MS, force: false, dry_run: false }
}

/// A slot and what it has asked for.
struct Desk {
    slot: Slot,
    now: Now,
    actions: Vec<Action>,
}

impl Desk {
    /// In flight with an owner of layout 7 on seat 0.
    fn new(config: SlotConfig) -> Self {
        let now = Now { logical_ns: 0, allowed_ns: 0 };
        let slot = Slot::new(config, SEAT[0], Program(0));
        let mut desk = Self { slot, now, actions: Vec::new() };
        assert!(desk.slot.holds_time());
        desk.on(Event::Ready(SEAT[0], instance(7)));
        assert_eq!(desk.record().effective_ns, 0, "the first record counts from the start");
        desk.confirm();
        assert!(desk.slot.is_quiet());
        desk
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

    /// The consumer does as the newest record says.
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
        self.on(Event::Request(Request::Swap(Target::New(Program(1)), order(200 * MS))));
        assert!(
            self.has(|action| *action == Action::Spawn(SEAT[1], Program(1))),
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
        let mut desk = Self::new(config);
        desk.at(1000 * MS).swap(7).confirm().wait().pass(SEAT[1]).confirm();
        assert!(matches!(desk.slot.phase, Phase::Window { .. }));
        desk
    }

    /// Seat 0 commands and seat 1 stands by.
    fn with_standby(config: SlotConfig) -> Self {
        let mut desk = Self::new(config);
        desk.on(Event::Request(Request::Standby(Program(2), 100 * MS)));
        desk.on(Event::Ready(SEAT[1], instance(7))).confirm().wait().pass(SEAT[1]);
        assert_eq!(desk.record().fallback, Some(SEAT[1]));
        desk.confirm();
        desk
    }
}

fn failed() -> Refusal {
    Refusal::MissedDeadlines { missed: 3, limit: 0, at_ns: 5 }
}

#[test]
fn a_same_kind_swap_in_lockstep_follows_the_script_to_the_nanosecond() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.at(4200 * MS).swap(7);
    let joined = desk.record();
    assert_eq!((joined.owner, joined.effective_ns), (SEAT[0], 4200 * MS), "only the roll changes");
    let handed = Action::HandOver {
        seat: SEAT[1],
        state_of: Some(SEAT[0]),
        join_ns: 4200 * MS,
        track_until_ns: 4200 * MS,
    };
    assert!(desk.has(|action| *action == handed), "{:?}", desk.actions);
    desk.confirm();
    assert_eq!(desk.slot.deadline_ns(), Some(4400 * MS));
    desk.wait();
    assert!(desk.slot.holds_time(), "time stands still until the gate has spoken");
    desk.pass(SEAT[1]);
    // Releases at 4.40 s take effect at 4.401 s: the first effective instant not yet allowed.
    let flip = desk.record();
    assert_eq!((flip.owner, flip.fallback), (SEAT[1], Some(SEAT[0])));
    assert_eq!(flip.effective_ns, 4401 * MS);
    assert!(!flip.kind_changed);
    desk.confirm();
    assert_eq!(desk.slot.deadline_ns(), Some(4901 * MS));
    desk.wait();
    assert!(desk.has(|action| *action == Action::AwaitExit(SEAT[0])));
    assert!(desk.has(|action| *action == Action::Report(Report::Done(SEAT[1], Outcome::Swapped))));
    assert_eq!(desk.record().fallback, None);
    desk.confirm().on(Event::Died(SEAT[0]));
    assert!(desk.slot.is_quiet() && !desk.slot.is_taken(SEAT[0]));
}

#[test]
fn another_kind_tracks_first_and_its_flip_says_so() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.at(1000 * MS).swap(8);
    let tracks = |action: &Action| {
        matches!(action, Action::HandOver { state_of: None, join_ns, track_until_ns, .. }
            if *join_ns == 1000 * MS && *track_until_ns == 1100 * MS)
    };
    assert!(desk.has(tracks), "{:?}", desk.actions);
    desk.confirm().wait();
    assert!(desk.has(|action| *action == Action::Report(Report::Step(Step::RunsFree(SEAT[1])))));
    desk.wait().pass(SEAT[1]);
    assert!(desk.record().kind_changed);
}

#[test]
fn in_realtime_a_flip_is_two_periods_of_the_slower_one_ahead() {
    let mut desk = Desk::new(SlotConfig::REALTIME);
    desk.at(1000 * MS).swap(7).confirm().wait();
    let asked_ns = desk.now.logical_ns;
    desk.pass(SEAT[1]);
    let ahead_ns = desk.record().effective_ns - asked_ns;
    assert!((20 * MS..30 * MS).contains(&ahead_ns), "{ahead_ns}");
    assert_eq!(desk.record().effective_ns % (10 * MS), MS, "an effective instant of the candidate");
}

#[test]
fn a_candidate_is_refused_with_its_reason_and_the_owner_flies_on() {
    for (fault, event) in [
        (Some(Fault::Died), Event::Died(SEAT[1])),
        (Some(Fault::NeverReady), Event::Misbehaved(SEAT[1], Fault::NeverReady)),
        (Some(Fault::WrongLayout), Event::Misbehaved(SEAT[1], Fault::WrongLayout)),
    ] {
        let mut desk = Desk::new(SlotConfig::LOCKSTEP);
        desk.on(Event::Request(Request::Swap(Target::New(Program(1)), order(MS))));
        desk.on(event);
        assert_eq!(desk.refusal(), fault.map(Reason::Fault).as_ref());
        assert_eq!(desk.refusal().map(Reason::exit_code), Some(1));
        assert_eq!((desk.record().epoch, desk.record().owner), (1, SEAT[0]), "untouched");
        assert!(desk.slot.is_quiet());
    }
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.swap(7).confirm().wait().on(Event::Verdict(SEAT[1], Err(failed())));
    assert_eq!(desk.refusal(), Some(&Reason::Gate(failed())));
    assert_eq!(desk.record().owner, SEAT[0]);
    assert!(desk.has(|action| *action == Action::AwaitExit(SEAT[1])), "a healthy one may leave");
}

#[test]
fn force_overrules_disagreement_and_nothing_else() {
    let phase = crate::gate::Phase::Free;
    let far = Refusal::TooFarOnTheWhole { phase, axis: "τx", value: 0.5, limit: 0.1, at_ns: 1 };
    for (refusal, flips) in [(far, true), (failed(), false)] {
        let mut desk = Desk::new(SlotConfig::LOCKSTEP);
        let forced = Order { force: true, ..order(MS) };
        desk.on(Event::Request(Request::Swap(Target::New(Program(1)), forced)));
        desk.on(Event::Ready(SEAT[1], instance(7))).confirm().wait();
        desk.on(Event::Verdict(SEAT[1], Err(refusal)));
        assert_eq!(desk.record().owner == SEAT[1], flips);
    }
}

#[test]
fn a_dry_run_judges_and_sends_away() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    let dry = Order { dry_run: true, ..order(MS) };
    desk.on(Event::Request(Request::Swap(Target::New(Program(1)), dry)));
    desk.on(Event::Ready(SEAT[1], instance(7))).confirm().wait().pass(SEAT[1]);
    assert!(desk.has(|action| *action == Action::Report(Report::Done(SEAT[1], Outcome::DryRun))));
    assert_eq!(desk.record().owner, SEAT[0]);
}

#[test]
fn a_verdict_that_nobody_asked_for_lets_nobody_through() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.swap(7).on(Event::Verdict(SEAT[1], Ok(Box::<GateFigures>::default())));
    assert_eq!((desk.record().owner, desk.actions.len()), (SEAT[0], 0));
}

#[test]
fn what_makes_no_sense_is_refused_with_its_exit_code() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    let to = |target| Event::Request(Request::Swap(target, order(MS)));
    for (event, code) in [
        (to(Target::Seated(SEAT[0])), 2),
        (to(Target::Seated(SEAT[2])), 2),
        (Event::Request(Request::Rollback), 2),
        (Event::Request(Request::Retire(SEAT[0])), 2),
        (Event::Request(Request::Retire(SEAT[3])), 2),
    ] {
        desk.on(event);
        assert_eq!(desk.refusal().map(Reason::exit_code), Some(code), "{:?}", desk.actions);
        assert_eq!(desk.actions.len(), 1, "and nothing else happens");
    }
    desk.on(to(Target::New(Program(1)))).on(to(Target::New(Program(1))));
    assert_eq!(desk.refusal(), Some(&Reason::Busy(SEAT[1])));
    assert_eq!(desk.refusal().map(Reason::exit_code), Some(3));
}

#[test]
fn a_record_that_is_refused_or_never_confirmed_is_written_again_for_later() {
    let mut desk = Desk::new(SlotConfig::REALTIME);
    desk.at(1000 * MS).swap(7).confirm().wait().pass(SEAT[1]);
    let first = desk.record();
    desk.on(Event::RecordRefused { epoch: first.epoch });
    let second = desk.record();
    assert_eq!((second.epoch, second.owner), (first.epoch + 1, SEAT[1]));
    assert!(second.effective_ns > first.effective_ns);
    desk.on(Event::RecordRefused { epoch: first.epoch });
    assert_eq!(desk.record(), second, "an old complaint is answered already");
    desk.wait();
    assert!(desk.record().effective_ns > second.effective_ns);
    for _ in 0..SlotConfig::REALTIME.tries_max {
        desk.wait();
    }
    assert_eq!(desk.record().owner, SEAT[0], "taken back");
    desk.confirm();
    assert!(desk.has(|action| *action == Action::AwaitExit(SEAT[1])));
}

#[test]
fn a_rollback_gives_the_slot_back_and_sends_the_new_one_away() {
    let mut desk = Desk::in_window(SlotConfig::LOCKSTEP);
    desk.on(Event::Request(Request::Rollback));
    assert_eq!((desk.record().owner, desk.record().fallback), (SEAT[0], Some(SEAT[1])));
    desk.confirm();
    assert!(
        desk.has(|action| *action == Action::Report(Report::Done(SEAT[0], Outcome::RolledBack)))
    );
    assert!(desk.has(|action| *action == Action::AwaitExit(SEAT[1])));
}

#[test]
fn a_new_owner_that_dies_or_falls_silent_in_the_window_is_rolled_back() {
    let mut desk = Desk::in_window(SlotConfig::LOCKSTEP);
    let at_ns = desk.now.logical_ns + 30 * MS;
    desk.at(at_ns).on(Event::Died(SEAT[1]));
    assert_eq!((desk.record().owner, desk.record().fallback), (SEAT[0], None));
    assert!(desk.record().effective_ns >= at_ns + 500 * MS, "beyond anything allowed");
    let mut desk = Desk::in_window(SlotConfig::LOCKSTEP);
    let epoch = desk.record().epoch;
    desk.on(Event::FellOver { epoch, at_ns });
    assert_eq!(desk.record().owner, SEAT[0]);
    assert!(desk.has(|action| *action == Action::Kill(SEAT[1])));
}

#[test]
fn the_old_owner_may_die_in_the_window_or_before_it() {
    let mut desk = Desk::in_window(SlotConfig::LOCKSTEP);
    desk.on(Event::Died(SEAT[0]));
    assert!(desk.has(|action| *action == Action::Report(Report::Done(SEAT[1], Outcome::Swapped))));
    assert_eq!((desk.record().owner, desk.record().fallback), (SEAT[1], None));
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.swap(7).confirm().wait().pass(SEAT[1]).on(Event::Died(SEAT[0]));
    desk.confirm();
    assert_eq!((desk.record().owner, desk.record().fallback), (SEAT[1], None));
    assert!(matches!(desk.slot.phase, Phase::Steady { .. }));
}

#[test]
fn a_fail_over_is_answered_and_the_standby_replaced() {
    let mut desk = Desk::with_standby(SlotConfig::LOCKSTEP);
    let epoch = desk.record().epoch;
    desk.at(1000 * MS).on(Event::FellOver { epoch, at_ns: 1000 * MS });
    assert_eq!((desk.record().epoch, desk.record().owner), (epoch + 1, SEAT[1]));
    assert_eq!(desk.record().effective_ns, 1501 * MS);
    assert!(desk.has(|action| *action == Action::Kill(SEAT[0])));
    desk.on(Event::Died(SEAT[0]));
    desk.confirm().wait();
    assert!(desk.has(|action| *action == Action::Spawn(SEAT[0], Program(2))), "{:?}", desk.actions);
}

#[test]
fn an_owner_without_a_fallback_is_started_again_on_its_own_seat() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.at(2000 * MS).on(Event::Died(SEAT[0]));
    assert_eq!(desk.slot.deadline_ns(), Some(2100 * MS));
    desk.on(Event::Request(Request::Rollback));
    desk.wait();
    assert!(desk.has(|action| *action == Action::Restart(SEAT[0], Program(0))));
    assert!(desk.slot.holds_time());
    desk.on(Event::Ready(SEAT[0], instance(7)));
    let from_its_state = |action: &Action| {
        matches!(action, Action::HandOver { state_of, join_ns, .. }
            if *state_of == Some(SEAT[0]) && *join_ns == 2100 * MS)
    };
    assert!(desk.has(from_its_state), "{:?}", desk.actions);
    desk.confirm();
    assert!(desk.slot.is_quiet());
}

#[test]
fn an_owner_that_dies_again_while_starting_is_started_again() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.at(2000 * MS).on(Event::Died(SEAT[0])).wait().on(Event::Died(SEAT[0])).wait();
    assert!(desk.has(|action| *action == Action::Restart(SEAT[0], Program(0))));
}

/// An owner of another program than the flight began with, and no fallback.
fn newcomer() -> Desk {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.swap(9).confirm().wait().wait().pass(SEAT[1]).confirm().wait();
    desk.on(Event::Died(SEAT[0]));
    desk.confirm();
    assert_eq!((desk.record().owner, desk.record().fallback), (SEAT[1], None));
    desk
}

#[test]
fn a_newcomer_that_is_lost_again_at_once_makes_room_for_whom_the_flight_began_with() {
    let mut desk = newcomer();
    desk.on(Event::Died(SEAT[1])).wait();
    assert!(desk.has(|action| *action == Action::Restart(SEAT[1], Program(1))));
    desk.on(Event::Ready(SEAT[1], instance(9))).confirm();
    desk.on(Event::Died(SEAT[1])).wait();
    assert!(desk.has(|action| *action == Action::Spawn(SEAT[1], Program(0))), "{:?}", desk.actions);
    // It begins from nothing, sees what is applied for a period, and commands.
    desk.on(Event::Ready(SEAT[1], instance(7)));
    let from_nothing = |action: &Action| {
        matches!(action, Action::HandOver { state_of: None, join_ns, track_until_ns, .. }
            if *track_until_ns == join_ns + 10 * MS)
    };
    assert!(desk.has(from_nothing), "{:?}", desk.actions);
    desk.confirm();
    assert!(desk.slot.is_quiet());
}

#[test]
fn a_newcomer_that_gives_nothing_to_obey_makes_room() {
    let mut desk = newcomer();
    let epoch = desk.record().epoch;
    let since_ns = desk.now.logical_ns;
    let unguided = |at_ns: u64| Event::Unguided { epoch, since_ns, at_ns };
    desk.on(unguided(since_ns + 229 * MS));
    assert_eq!(desk.slot.deadline_ns(), None, "200 ms and three periods are its own");
    desk.on(unguided(since_ns + 230 * MS));
    assert_eq!(desk.slot.deadline_ns(), Some(since_ns + 730 * MS));
    desk.wait();
    assert!(desk.has(|action| *action == Action::Kill(SEAT[1])));
    desk.on(Event::Died(SEAT[1])).wait();
    assert!(desk.has(|action| *action == Action::Spawn(SEAT[1], Program(0))));
}

#[test]
fn a_standby_that_dies_comes_back_and_one_that_keeps_dying_does_not() {
    let mut desk = Desk::with_standby(SlotConfig::LOCKSTEP);
    desk.at(1000 * MS).on(Event::Died(SEAT[1]));
    assert_eq!(desk.record().fallback, None);
    desk.confirm();
    let mut spawned = 0;
    while desk.slot.deadline_ns().is_some() {
        desk.wait();
        spawned += 1;
        desk.on(Event::Died(SEAT[1]));
    }
    assert_eq!(spawned, SlotConfig::LOCKSTEP.standby_losses_max - 1);
}

#[test]
fn the_standby_takes_the_slot_when_asked() {
    let mut desk = Desk::with_standby(SlotConfig::LOCKSTEP);
    desk.on(Event::Request(Request::Swap(Target::Seated(SEAT[1]), order(50 * MS))));
    desk.wait().pass(SEAT[1]);
    assert_eq!((desk.record().owner, desk.record().fallback), (SEAT[1], Some(SEAT[0])));
}

#[test]
fn an_owner_lost_while_somebody_shadows_ends_the_swap() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.swap(7).confirm().on(Event::Died(SEAT[0]));
    assert_eq!(desk.refusal(), Some(&Reason::OwnerLost));
    assert!(desk.has(|action| *action == Action::Kill(SEAT[1])));
    assert!(matches!(desk.slot.phase, Phase::Ownerless { .. }));
}

#[test]
fn a_retired_standby_leaves_and_stays_away() {
    let mut desk = Desk::with_standby(SlotConfig::LOCKSTEP);
    desk.on(Event::Request(Request::Retire(SEAT[1])));
    assert!(desk.has(|action| *action == Action::AwaitExit(SEAT[1])));
    assert_eq!(desk.record().fallback, None);
    desk.on(Event::Died(SEAT[1])).confirm();
    assert_eq!(desk.slot.deadline_ns(), None);
}

#[test]
fn a_new_supervisor_goes_on_from_the_record_and_sends_strangers_away() {
    let before = Desk::with_standby(SlotConfig::REALTIME);
    let mut seated = [None; SEATS];
    for place in seated.iter_mut().take(3) {
        *place = Some((Program(9), instance(7)));
    }
    let now = before.now;
    let (slot, actions) =
        Slot::adopt(SlotConfig::REALTIME, now, &before.record(), Program(0), seated);
    let record = *slot.record().unwrap();
    assert_eq!(record.epoch, before.record().epoch + 1);
    assert_eq!((record.owner, record.fallback), (SEAT[0], Some(SEAT[1])));
    assert!(actions.contains(&Action::AwaitExit(SEAT[2])));
    seated[0] = None;
    let (slot, _) = Slot::adopt(SlotConfig::REALTIME, now, &before.record(), Program(0), seated);
    assert_eq!(slot.record().unwrap().owner, SEAT[1], "the owner is not there any more");
}

fn any_event() -> impl Strategy<Value = Event> {
    let seat = (0..4_usize).prop_map(|i| SEAT[i]);
    let epoch = 0..12_u64;
    let order =
        (0..3_u64, 0..3_u64, any::<bool>(), any::<bool>()).prop_map(|(a, b, force, dry_run)| {
            Order { shadow_ns: a * MS, rollback_ns: b * MS, force, dry_run }
        });
    prop_oneof![
        order.clone().prop_map(|o| Event::Request(Request::Swap(Target::New(Program(1)), o))),
        (seat.clone(), order)
            .prop_map(|(s, o)| Event::Request(Request::Swap(Target::Seated(s), o))),
        Just(Event::Request(Request::Rollback)),
        seat.clone().prop_map(|s| Event::Request(Request::Retire(s))),
        Just(Event::Request(Request::Standby(Program(2), MS))),
        (seat.clone(), 7..9_u64).prop_map(|(s, layout)| Event::Ready(s, instance(layout))),
        seat.clone().prop_map(|s| Event::Verdict(s, Ok(Box::default()))),
        seat.clone().prop_map(|s| Event::Verdict(s, Err(failed()))),
        Just(Event::Time),
        (epoch.clone(), seat.clone()).prop_map(|(epoch, seat)| Event::Acknowledged {
            epoch,
            seat,
            at_ns: 0
        }),
        epoch.clone().prop_map(|epoch| Event::RecordRefused { epoch }),
        epoch.prop_map(|epoch| Event::FellOver { epoch, at_ns: 0 }),
        seat.clone().prop_map(Event::Died),
        seat.prop_map(|s| Event::Misbehaved(s, Fault::Stalled)),
    ]
}

proptest! {
    #[test]
    fn no_events_in_any_order_break_it(
        events in prop::collection::vec((any_event(), 0..4 * MS), 0..120),
        lockstep in any::<bool>(),
    ) {
        let config = if lockstep { SlotConfig::LOCKSTEP } else { SlotConfig::REALTIME };
        let mut slot = Slot::new(config, SEAT[0], Program(0));
        let mut t = 0;
        let mut newest: Option<Record> = None;
        for (event, later_ns) in events {
            t += later_ns;
            for action in slot.on(Now { logical_ns: t, allowed_ns: t }, event) {
                let Action::Publish(record) = action else { continue };
                if let Some(before) = newest {
                    prop_assert!(record.epoch > before.epoch);
                    prop_assert!(record.effective_ns >= before.effective_ns);
                }
                prop_assert!(record.is_taken(record.owner), "an owner that is there");
                prop_assert_ne!(record.fallback, Some(record.owner));
                prop_assert!(record.fallback.is_none_or(|seat| record.is_taken(seat)));
                newest = Some(record);
            }
        }
    }
}
