//! Swaps, verdicts, rollbacks.

use super::*;
use crate::gate::GateFigures;

#[test]
fn a_same_kind_swap_in_lockstep_follows_the_script_to_the_nanosecond() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.at(4200 * MS).swap(7);
    let joined = bench.record();
    assert_eq!(
        (joined.owner, joined.effective_ns),
        (SEAT[0], 4200 * MS),
        "only the members change"
    );
    let handed = Action::HandOver {
        seat: SEAT[1],
        state_of: Some(SEAT[0]),
        join_ns: 4200 * MS,
        track_until_ns: 4200 * MS,
    };
    assert!(bench.has(|action| *action == handed), "{:?}", bench.actions);
    bench.confirm();
    assert_eq!(bench.slot.deadline_ns(), Some(4400 * MS));
    bench.wait();
    assert!(bench.slot.holds_time(), "time stands still until the gate has spoken");
    bench.pass(SEAT[1]);
    // Releases at 4.40 s take effect at 4.401 s: the first effective instant not yet allowed.
    let flip = bench.record();
    assert_eq!((flip.owner, flip.fallback), (SEAT[1], Some(SEAT[0])));
    assert_eq!(flip.effective_ns, 4401 * MS);
    assert!(!flip.kind_changed);
    bench.confirm();
    assert_eq!(bench.slot.deadline_ns(), Some(4901 * MS));
    bench.wait();
    let closing = bench.record();
    assert_eq!((closing.fallback, closing.watched), (Some(SEAT[0]), false));
    assert_eq!(closing.effective_ns, 4901 * MS);
    assert!(bench.has(|action| *action == Action::Report(Report::Done(SEAT[1], Outcome::Swapped))));
    bench.confirm();
    assert_eq!(bench.slot.deadline_ns(), Some(5001 * MS));
    bench.wait();
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[0])));
    assert_eq!(bench.record().fallback, None);
    bench.confirm().on(Event::Died(SEAT[0]));
    assert!(bench.slot.is_quiet() && !bench.slot.is_taken(SEAT[0]));
}

/// The record that ends the window is older than the trip, and must not give the slot back to the owner that has tripped.
#[test]
fn a_trip_just_before_the_end_of_the_window_of_a_trusted_owner_counts() {
    let mut bench = Bench::in_window(SlotConfig::LOCKSTEP);
    let mut consumer = crate::Consumer::new(crate::REJECTED_AFTER_TRIP_NS);
    let window = bench.record();
    consumer.take_record(&window);
    consumer.advance(window.effective_ns);
    bench.wait();
    let (closing, ends_ns) = (bench.record(), bench.record().effective_ns);
    let tripped = consumer.trip(window.epoch, SEAT[1], ends_ns - MS);
    assert_eq!(tripped, crate::Tripped::ToFallback);
    consumer.take_record(&closing);
    consumer.advance(ends_ns);
    assert!(consumer.tripped(), "it was judged by the record before");
    assert_eq!(consumer.decide(ends_ns, true, true), crate::Source::Fallback);
    // Not confirmed in time, or with the trip: the old owner stays until the consumer has answered.
    bench.wait();
    assert_eq!(bench.record().fallback, Some(SEAT[0]));
    bench.on(Event::Acknowledged { epoch: closing.epoch, seat: SEAT[0], at_ns: ends_ns });
    bench.on(Event::Tripped { epoch: closing.epoch, at_ns: ends_ns });
    let step = Step::TookOver { seat: SEAT[0], from: SEAT[1], fault: Fault::Tripped };
    assert!(bench.has(|action| *action == Action::Report(Report::Step(step.clone()))));
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[0], None));
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])));
}

#[test]
fn the_fallback_of_a_window_that_is_over_may_be_swapped_to_retired_or_lost_at_once() {
    let over = || {
        let mut bench = Bench::in_window(SlotConfig::LOCKSTEP);
        bench.wait().confirm();
        assert_eq!(bench.record().fallback, Some(SEAT[0]));
        bench
    };
    let mut bench = over();
    bench.on(Event::Request(Request::Swap(Target::Seated(SEAT[0]), order(200 * MS))));
    bench.wait().wait().pass(SEAT[0]);
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[0], Some(SEAT[1])));
    // Until then it is the fallback all the same.
    let mut bench = over();
    let epoch = bench.record().epoch;
    bench.on(Event::Request(Request::Swap(Target::Seated(SEAT[0]), order(200 * MS))));
    bench.on(Event::Tripped { epoch, at_ns: bench.now.logical_ns });
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[0], None));
    assert!(!bench.has(|action| *action == Action::Kill(SEAT[0])), "{:?}", bench.actions);
    let mut bench = over();
    let dry_run = SwapTerms { dry_run: true, ..order(200 * MS) };
    bench.on(Event::Request(Request::Swap(Target::Seated(SEAT[0]), dry_run)));
    bench.wait().wait().pass(SEAT[0]);
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[0])), "{:?}", bench.actions);
    let mut bench = over();
    bench.on(Event::Request(Request::Swap(Target::New(program(1)), order(200 * MS))));
    assert!(bench.has(|action| *action == Action::Spawn(SEAT[2], program(1))), "at once");
    bench.on(Event::Ready(SEAT[2], instance(7))).confirm().wait();
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[0])), "{:?}", bench.actions);
    for event in [Event::Request(Request::Retire(SEAT[0])), Event::Died(SEAT[0])] {
        let mut bench = over();
        bench.on(event);
        assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[1], None));
        assert_eq!(bench.confirm().slot.deadline_ns(), None);
    }
    // The new owner may be lost as well.
    let mut bench = over();
    bench.on(Event::Died(SEAT[1]));
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[0], None));
    assert_eq!(bench.confirm().slot.deadline_ns(), None);
}

/// Otherwise the window would end wherever allowed time has got before the confirmation is received.
#[test]
fn time_stops_where_the_window_may_end_before_the_flip_is_confirmed() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.at(4200 * MS).swap(7).confirm().wait().pass(SEAT[1]);
    assert_eq!(bench.record().effective_ns, 4401 * MS);
    // The flip cannot be confirmed before now, which is 4.4 s.
    assert_eq!(bench.slot.deadline_ns(), Some(4900 * MS));
    bench.wait();
    let again = Some(4901 * MS);
    assert_eq!(bench.slot.deadline_ns(), again, "its record is to be written again then");
    bench.on(Event::Acknowledged { epoch: bench.record().epoch, seat: SEAT[1], at_ns: 4850 * MS });
    assert_eq!(bench.slot.deadline_ns(), Some(5350 * MS));
}

#[test]
fn without_a_window_no_time_is_waited_for_that_has_come_already() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    let at_once = SwapTerms { rollback_ns: 0, ..order(201 * MS) };
    bench.at(4200 * MS).on(Event::Request(Request::Swap(Target::New(program(1)), at_once)));
    bench.on(Event::Ready(SEAT[1], instance(7))).confirm().wait().pass(SEAT[1]);
    assert_eq!((bench.record().effective_ns, bench.now.allowed_ns), (4401 * MS, 4401 * MS));
    assert_eq!(bench.slot.deadline_ns(), Some(4411 * MS), "in steps of its period");
    bench.wait();
    assert_eq!(bench.slot.deadline_ns(), Some(4421 * MS));
}

#[test]
fn another_kind_tracks_first_and_its_flip_names_that() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.at(1000 * MS).swap(8);
    let tracks = |action: &Action| {
        matches!(action, Action::HandOver { state_of: None, join_ns, track_until_ns, .. }
            if *join_ns == 1000 * MS && *track_until_ns == 1100 * MS)
    };
    assert!(bench.has(tracks), "{:?}", bench.actions);
    bench.confirm().wait();
    assert!(bench.has(|action| *action == Action::Report(Report::Step(Step::RunsFree(SEAT[1])))));
    bench.wait().pass(SEAT[1]);
    assert!(bench.record().kind_changed);
}

#[test]
fn in_realtime_a_flip_is_two_periods_of_the_slower_one_ahead() {
    let mut bench = Bench::new(SlotConfig::REALTIME);
    bench.at(1000 * MS).swap(7).confirm().wait();
    let asked_ns = bench.now.logical_ns;
    bench.pass(SEAT[1]);
    let ahead_ns = bench.record().effective_ns - asked_ns;
    assert!((20 * MS..30 * MS).contains(&ahead_ns), "{ahead_ns}");
    assert_eq!(
        bench.record().effective_ns % (10 * MS),
        MS,
        "an effective instant of the candidate"
    );
}

#[test]
fn a_candidate_is_refused_with_its_reason_and_the_owner_flies_on() {
    for (fault, event) in [
        (Some(Fault::Died), Event::Died(SEAT[1])),
        (Some(Fault::NeverReady), Event::Misbehaved(SEAT[1], Fault::NeverReady)),
        (Some(Fault::WrongLayout), Event::Misbehaved(SEAT[1], Fault::WrongLayout)),
    ] {
        let mut bench = Bench::new(SlotConfig::LOCKSTEP);
        bench.on(Event::Request(Request::Swap(Target::New(program(1)), order(MS))));
        bench.on(event);
        assert_eq!(bench.refusal(), fault.map(Reason::Fault).as_ref());
        assert_eq!(bench.refusal().map(Reason::exit_code), Some(1));
        assert_eq!((bench.record().epoch, bench.record().owner), (1, SEAT[0]), "untouched");
        assert!(bench.slot.is_quiet());
    }
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.swap(7).confirm().wait().on(Event::Verdict(SEAT[1], Err(failed())));
    assert_eq!(bench.refusal(), Some(&Reason::Gate(failed())));
    assert_eq!(bench.record().owner, SEAT[0]);
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])), "a healthy one may leave");
}

#[test]
fn force_overrules_disagreement_and_nothing_else() {
    let phase = crate::gate::Phase::Free;
    let far = Refusal::TooFarOnTheWhole { phase, axis: "τx", value: 0.5, limit: 0.1, at_ns: 1 };
    for (refusal, flips) in [(far, true), (failed(), false)] {
        let mut bench = Bench::new(SlotConfig::LOCKSTEP);
        let forced = SwapTerms { force: true, ..order(MS) };
        bench.on(Event::Request(Request::Swap(Target::New(program(1)), forced)));
        bench.on(Event::Ready(SEAT[1], instance(7))).confirm().wait();
        bench.on(Event::Verdict(SEAT[1], Err(refusal)));
        assert_eq!(bench.record().owner == SEAT[1], flips);
    }
}

#[test]
fn a_dry_run_judges_and_sends_away() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    let dry = SwapTerms { dry_run: true, ..order(MS) };
    bench.on(Event::Request(Request::Swap(Target::New(program(1)), dry)));
    bench.on(Event::Ready(SEAT[1], instance(7))).confirm().wait().pass(SEAT[1]);
    assert!(bench.has(|action| *action == Action::Report(Report::Done(SEAT[1], Outcome::DryRun))));
    assert_eq!(bench.record().owner, SEAT[0]);
}

#[test]
fn a_verdict_that_was_not_asked_for_lets_no_candidate_through() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.swap(7).on(Event::Verdict(SEAT[1], Ok(Box::<GateFigures>::default())));
    assert_eq!((bench.record().owner, bench.actions.len()), (SEAT[0], 0));
}

#[test]
fn what_makes_no_sense_is_refused_with_its_exit_code() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    let to = |target| Event::Request(Request::Swap(target, order(MS)));
    for (event, code) in [
        (to(Target::Seated(SEAT[0])), 2),
        (to(Target::Seated(SEAT[2])), 2),
        (Event::Request(Request::Rollback), 2),
        (Event::Request(Request::Retire(SEAT[0])), 2),
        (Event::Request(Request::Retire(SEAT[3])), 2),
    ] {
        bench.on(event);
        assert_eq!(bench.refusal().map(Reason::exit_code), Some(code), "{:?}", bench.actions);
        assert_eq!(bench.actions.len(), 1, "and nothing else happens");
    }
    bench.on(to(Target::New(program(1)))).on(to(Target::New(program(1))));
    assert_eq!(bench.refusal(), Some(&Reason::Busy(SEAT[1])));
    assert_eq!(bench.refusal().map(Reason::exit_code), Some(3));
}

#[test]
fn a_record_that_is_refused_or_never_confirmed_is_written_again_for_later() {
    let mut bench = Bench::new(SlotConfig::REALTIME);
    bench.at(1000 * MS).swap(7).confirm().wait().pass(SEAT[1]);
    let first = bench.record();
    bench.on(Event::RecordRefused { epoch: first.epoch });
    let second = bench.record();
    assert_eq!((second.epoch, second.owner), (first.epoch + 1, SEAT[1]));
    assert!(second.effective_ns > first.effective_ns);
    bench.on(Event::RecordRefused { epoch: first.epoch });
    assert_eq!(bench.record(), second, "an old complaint is answered already");
    bench.wait();
    assert!(bench.record().effective_ns > second.effective_ns);
    for _ in 0..SlotConfig::REALTIME.tries_max {
        bench.wait();
    }
    assert_eq!(bench.record().owner, SEAT[0], "taken back");
    bench.confirm();
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])));
}

#[test]
fn a_rollback_gives_the_slot_back_and_sends_the_new_one_away() {
    let mut bench = Bench::in_window(SlotConfig::LOCKSTEP);
    bench.on(Event::Request(Request::Rollback));
    assert_eq!((bench.record().owner, bench.record().fallback), (SEAT[0], Some(SEAT[1])));
    bench.confirm();
    assert!(
        bench.has(|action| *action == Action::Report(Report::Done(SEAT[0], Outcome::RolledBack)))
    );
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])));
}

#[test]
fn a_candidate_that_does_not_command_yet_is_not_rolled_back_but_reported() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    bench.at(1000 * MS);
    bench.on(Event::Request(Request::Rollback));
    assert_eq!(bench.refusal(), Some(&Reason::NothingToRollBack));
    bench.swap(7);
    for _ in ["joining", "shadowing"] {
        bench.on(Event::Request(Request::Rollback));
        assert_eq!(bench.refusal(), Some(&Reason::NotInCommand(SEAT[1])));
        bench.confirm();
    }
    bench.wait().pass(SEAT[1]).confirm();
    assert_eq!(bench.record().owner, SEAT[1], "the swap went on");
}
