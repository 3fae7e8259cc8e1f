//! Processes that die, fall silent or are sent away, and standbys.

use super::*;

#[test]
fn a_new_owner_that_dies_or_falls_silent_in_the_window_is_rolled_back() {
    let mut bench = Bench::in_window(SlotConfig::LOCKSTEP);
    let at_ns = bench.now.logical_ns + 30 * MS;
    bench.at(at_ns).on(Event::Died(SEAT[1]));
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[0], None));
    assert!(bench.record().effective_ns >= at_ns + 500 * MS, "beyond anything allowed");
    let mut bench = Bench::in_window(SlotConfig::LOCKSTEP);
    let epoch = bench.record().epoch;
    bench.on(Event::FailedOver { epoch, at_ns });
    assert_eq!(bench.record().owner, SEAT[0]);
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])), "it may still run");
}

#[test]
fn the_old_owner_may_die_in_the_window_or_before_it() {
    let lost = Step::FallbackLost { seat: SEAT[0], owner: SEAT[1], fault: Fault::Died };
    let lost = Action::Report(Report::Step(lost));
    let mut bench = Bench::in_window(SlotConfig::LOCKSTEP);
    bench.on(Event::Died(SEAT[0]));
    assert!(bench.has(|action| *action == lost));
    assert!(bench.has(|action| *action == Action::Report(Report::Done(SEAT[1], Outcome::Swapped))));
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[1], None));
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.swap(7).confirm().wait().pass(SEAT[1]).on(Event::Died(SEAT[0]));
    assert!(bench.has(|action| *action == lost));
    bench.confirm();
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[1], None));
    assert!(matches!(bench.slot.phase, Phase::Steady { .. }));
}

#[test]
fn a_fail_over_is_answered_and_the_standby_replaced() {
    let mut bench = Bench::with_standby(SlotConfig::LOCKSTEP);
    let epoch = bench.record().epoch;
    bench.at(1000 * MS).on(Event::FailedOver { epoch, at_ns: 1000 * MS });
    assert_eq!((bench.record().epoch, bench.record().owner), (epoch + 1, SEAT[1]));
    assert_eq!(bench.record().effective_ns, 1501 * MS);
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[0])), "it may still run");
    bench.on(Event::Died(SEAT[0]));
    bench.confirm().wait();
    assert!(
        bench.has(|action| *action == Action::Spawn(SEAT[0], program(2))),
        "{:?}",
        bench.actions
    );
}

#[test]
fn an_owner_without_a_fallback_is_started_again_on_its_own_seat() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.at(2000 * MS).on(Event::Died(SEAT[0]));
    assert_eq!(bench.slot.deadline_ns(), Some(2100 * MS));
    bench.on(Event::Request(Request::Rollback));
    bench.wait();
    assert!(bench.has(|action| *action == Action::Restart(SEAT[0], program(0))));
    assert!(bench.slot.holds_time());
    bench.on(Event::Ready(SEAT[0], instance(7)));
    let from_its_state = |action: &Action| {
        matches!(action, Action::HandOver { state_of, join_ns, .. }
            if *state_of == Some(SEAT[0]) && *join_ns == 2100 * MS)
    };
    assert!(bench.has(from_its_state), "{:?}", bench.actions);
    bench.confirm();
    assert!(bench.slot.is_quiet());
}

#[test]
fn an_owner_that_dies_again_while_starting_is_started_again() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.at(2000 * MS).on(Event::Died(SEAT[0])).wait().on(Event::Died(SEAT[0])).wait();
    assert!(bench.has(|action| *action == Action::Restart(SEAT[0], program(0))));
}

/// An owner of another program than the flight began with, and no fallback.
fn newcomer() -> Bench {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.swap(9).confirm().wait().wait().pass(SEAT[1]).confirm().wait();
    bench.on(Event::Died(SEAT[0]));
    bench.confirm();
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[1], None));
    bench
}

#[test]
fn a_newcomer_that_is_lost_again_at_once_makes_room_for_the_initial_controller() {
    let mut bench = newcomer();
    bench.on(Event::Died(SEAT[1])).wait();
    assert!(bench.has(|action| *action == Action::Restart(SEAT[1], program(1))));
    bench.on(Event::Ready(SEAT[1], instance(9))).confirm();
    bench.on(Event::Died(SEAT[1])).wait();
    assert!(
        bench.has(|action| *action == Action::Spawn(SEAT[1], program(0))),
        "{:?}",
        bench.actions
    );
    // It begins from nothing, sees what is applied for a period, and commands.
    bench.on(Event::Ready(SEAT[1], instance(7)));
    let from_nothing = |action: &Action| {
        matches!(action, Action::HandOver { state_of: None, join_ns, track_until_ns, .. }
            if *track_until_ns == join_ns + 10 * MS)
    };
    assert!(bench.has(from_nothing), "{:?}", bench.actions);
    bench.confirm();
    assert!(bench.slot.is_quiet());
}

#[test]
fn a_newcomer_that_gives_nothing_to_follow_makes_room() {
    let mut bench = newcomer();
    let epoch = bench.record().epoch;
    let since_ns = bench.now.logical_ns;
    let unguided = |at_ns: u64| Event::Unguided { epoch, since_ns, at_ns };
    bench.on(unguided(since_ns + 229 * MS));
    assert_eq!(bench.slot.deadline_ns(), None, "200 ms and three periods are its own");
    bench.on(unguided(since_ns + 230 * MS));
    assert_eq!(bench.slot.deadline_ns(), Some(since_ns + 730 * MS));
    bench.wait();
    assert!(bench.has(|action| *action == Action::Kill(SEAT[1])));
    bench.on(Event::Died(SEAT[1])).wait();
    assert!(bench.has(|action| *action == Action::Spawn(SEAT[1], program(0))));
}

#[test]
fn a_standby_that_dies_comes_back_and_one_that_keeps_dying_does_not() {
    let mut bench = Bench::with_standby(SlotConfig::LOCKSTEP);
    bench.at(1000 * MS).on(Event::Died(SEAT[1]));
    assert_eq!(bench.record().fallback, None);
    bench.confirm();
    let mut spawned = 0;
    while bench.slot.deadline_ns().is_some() {
        bench.wait();
        spawned += 1;
        bench.on(Event::Died(SEAT[1]));
    }
    assert_eq!(spawned, SlotConfig::LOCKSTEP.standby_losses_max - 1);
}

#[test]
fn the_standby_takes_the_slot_when_asked() {
    let mut bench = Bench::with_standby(SlotConfig::LOCKSTEP);
    bench.on(Event::Request(Request::Swap(Target::Seated(SEAT[1]), order(50 * MS))));
    bench.wait().pass(SEAT[1]);
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[1], Some(SEAT[0])));
}

#[test]
fn an_owner_lost_while_a_candidate_shadows_ends_the_swap() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.swap(7).confirm().on(Event::Died(SEAT[0]));
    assert_eq!(bench.refusal(), Some(&Reason::OwnerLost));
    assert!(bench.has(|action| *action == Action::Kill(SEAT[1])));
    assert!(matches!(bench.slot.phase, Phase::Ownerless { .. }));
}

#[test]
fn a_retired_standby_leaves_and_stays_away() {
    let mut bench = Bench::with_standby(SlotConfig::LOCKSTEP);
    bench.on(Event::Request(Request::Retire(SEAT[1])));
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])));
    assert_eq!(bench.record().fallback, None);
    bench.on(Event::Died(SEAT[1])).confirm();
    assert_eq!(bench.slot.deadline_ns(), None);
}

#[test]
fn a_new_supervisor_goes_on_from_the_record_and_sends_strangers_away() {
    let before = Bench::with_standby(SlotConfig::REALTIME);
    let mut seated = [None; SEATS];
    for place in seated.iter_mut().take(3) {
        *place = Some((program(9), instance(7)));
    }
    let now = before.now;
    let (slot, actions) =
        SlotMachine::adopt(SlotConfig::REALTIME, now, &before.record(), [program(0); 2], seated);
    let record = *slot.record().unwrap();
    assert_eq!(record.epoch, before.record().epoch + 1);
    assert_eq!((record.owner, record.fallback), (SEAT[0], Some(SEAT[1])));
    assert!(actions.contains(&Action::AwaitExit(SEAT[2])));
    seated[0] = None;
    let (slot, _) =
        SlotMachine::adopt(SlotConfig::REALTIME, now, &before.record(), [program(0); 2], seated);
    assert_eq!(slot.record().unwrap().owner, SEAT[1], "the owner is not there any more");
}
