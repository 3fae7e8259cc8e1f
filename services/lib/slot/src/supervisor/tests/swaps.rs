//! Swaps, verdicts, rollbacks.

use super::*;
use crate::gate::GateFigures;

#[test]
fn a_same_kind_swap_in_lockstep_follows_the_script_to_the_nanosecond() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.at(4200 * MS).swap(7);
    let joined = desk.record();
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

/// Otherwise the window would end wherever allowed time has got before the confirmation is heard.
#[test]
fn time_stops_where_the_window_may_end_before_the_flip_is_confirmed() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.at(4200 * MS).swap(7).confirm().wait().pass(SEAT[1]);
    assert_eq!(desk.record().effective_ns, 4401 * MS);
    // The flip cannot be confirmed before now, which is 4.4 s.
    assert_eq!(desk.slot.deadline_ns(), Some(4900 * MS));
    desk.wait();
    let again = Some(4901 * MS);
    assert_eq!(desk.slot.deadline_ns(), again, "its record is to be written again then");
    desk.on(Event::Acknowledged { epoch: desk.record().epoch, seat: SEAT[1], at_ns: 4850 * MS });
    assert_eq!(desk.slot.deadline_ns(), Some(5350 * MS));
}

#[test]
fn without_a_window_no_time_is_waited_for_that_has_come_already() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    let at_once = Order { rollback_ns: 0, ..order(201 * MS) };
    desk.at(4200 * MS).on(Event::Request(Request::Swap(Target::New(Program(1)), at_once)));
    desk.on(Event::Ready(SEAT[1], instance(7))).confirm().wait().pass(SEAT[1]);
    assert_eq!((desk.record().effective_ns, desk.now.allowed_ns), (4401 * MS, 4401 * MS));
    assert_eq!(desk.slot.deadline_ns(), Some(4411 * MS), "in steps of its period");
    desk.wait();
    assert_eq!(desk.slot.deadline_ns(), Some(4421 * MS));
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
fn a_verdict_that_was_not_asked_for_lets_no_candidate_through() {
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
fn a_candidate_that_does_not_command_yet_is_not_rolled_back_but_told_of() {
    let mut desk = Desk::new(SlotConfig::LOCKSTEP);
    desk.at(1000 * MS);
    desk.on(Event::Request(Request::Rollback));
    assert_eq!(desk.refusal(), Some(&Reason::NothingToRollBack));
    desk.swap(7);
    for _ in ["joining", "shadowing"] {
        desk.on(Event::Request(Request::Rollback));
        assert_eq!(desk.refusal(), Some(&Reason::NotInCommand(SEAT[1])));
        desk.confirm();
    }
    desk.wait().pass(SEAT[1]).confirm();
    assert_eq!(desk.record().owner, SEAT[1], "the swap went on");
}
