//! Candidates that are flown ahead, and owners that are watched.

use super::*;

const REHEARSED: SwapTerms = SwapTerms { rehearse: true, ..order(200 * MS) };

fn rehearsed(from_ns: u64) -> Rehearsed {
    Rehearsed { from_ns, left_tube: false, verdict: Ok("keeps to the tube".to_owned()) }
}

fn fails(from_ns: u64) -> Rehearsed {
    let refusal = RehearsalRefusal::Fails("would lose the vehicle".to_owned());
    Rehearsed { verdict: Err(refusal), ..rehearsed(from_ns) }
}

impl Bench {
    /// Seat 1 has passed the admission check and is flown ahead.
    fn rehearsing(config: SlotConfig, order: SwapTerms) -> Self {
        let mut bench = Self::new(config);
        bench.at(1000 * MS);
        bench.on(Event::Request(Request::Swap(Target::New(brought(1)), order)));
        bench.on(Event::Ready(SEAT[1], instance(8))).confirm().wait().wait().pass(SEAT[1]);
        assert!(bench.has(|action| *action == Action::Rehearse(SEAT[1])), "{:?}", bench.actions);
        bench
    }

    fn answer(&mut self, rehearsed: Rehearsed) -> &mut Self {
        self.on(Event::Rehearsed(SEAT[1], rehearsed))
    }

    /// Seat 1 commands, is not trusted, and its window is over.
    fn watched(config: SlotConfig) -> Self {
        let mut bench = Self::rehearsing(config, REHEARSED);
        let now_ns = bench.now.logical_ns;
        bench.answer(rehearsed(now_ns)).confirm().wait();
        bench
    }
}

#[test]
fn a_candidate_that_must_be_flown_ahead_gets_the_slot_only_after_that() {
    let mut bench = Bench::rehearsing(SlotConfig::LOCKSTEP, REHEARSED);
    assert_eq!(bench.slot.progress(), Progress::Rehearsing(SEAT[1]));
    assert!(bench.slot.holds_time(), "lockstep time stands still until the verdict");
    assert_eq!(bench.record().owner, SEAT[0]);
    let now_ns = bench.now.logical_ns;
    bench.answer(rehearsed(now_ns));
    assert_eq!(bench.record().owner, SEAT[1]);
    assert!(bench.record().watched, "a new owner is watched");
    assert_eq!(bench.slot.progress(), Progress::Flipping(SEAT[1]));
    bench.confirm();
    let progress = bench.slot.progress();
    assert_eq!((progress.label(), progress.seat()), ("window", Some(SEAT[1])));
    assert_eq!(progress.until_ns(), bench.slot.deadline_ns());
}

#[test]
fn a_candidate_that_fails_ahead_is_sent_away_and_one_by_force_is_not() {
    let mut bench = Bench::rehearsing(SlotConfig::REALTIME, REHEARSED);
    let now_ns = bench.now.logical_ns;
    bench.answer(fails(now_ns));
    assert!(matches!(bench.refusal(), Some(Reason::Rehearsal(RehearsalRefusal::Fails(_)))));
    assert_eq!((bench.record().owner, bench.record().period_ns[1]), (SEAT[0], 0));

    let forced = SwapTerms { force: true, ..REHEARSED };
    let mut bench = Bench::rehearsing(SlotConfig::REALTIME, forced);
    bench.answer(fails(now_ns));
    assert_eq!(bench.record().owner, SEAT[1]);
    assert!(
        bench.has(|action| matches!(
            action,
            Action::Report(Report::Step(Step::RehearsalForced(..)))
        ))
    );
}

#[test]
fn an_answer_about_a_flight_that_is_past_is_asked_for_once_more_and_not_twice() {
    for left_tube in [false, true] {
        let mut bench = Bench::rehearsing(SlotConfig::REALTIME, REHEARSED);
        let old = |bench: &Bench| {
            let now_ns = bench.now.logical_ns;
            let from_ns = if left_tube { now_ns } else { now_ns - 2001 * MS };
            Rehearsed { left_tube, ..rehearsed(from_ns) }
        };
        let later_ns = bench.now.logical_ns + 3000 * MS;
        bench.at(later_ns);
        let first = old(&bench);
        bench.answer(first);
        assert!(bench.has(|action| *action == Action::Rehearse(SEAT[1])), "{:?}", bench.actions);
        let second = old(&bench);
        bench.answer(second);
        let refused = Reason::Rehearsal(RehearsalRefusal::NotRehearsed(String::new()));
        let discriminant = std::mem::discriminant::<Reason>;
        assert_eq!(bench.refusal().map(discriminant), Some(discriminant(&refused)));
        assert_eq!(bench.record().owner, SEAT[0]);
    }
}

#[test]
fn an_answer_that_was_not_asked_for_changes_nothing() {
    let mut bench = Bench::new(SlotConfig::REALTIME);
    bench.at(1000 * MS).swap(7).confirm();
    bench.answer(rehearsed(1000 * MS));
    assert_eq!(bench.actions, []);
    bench.on(Event::Rehearsed(SEAT[3], rehearsed(1000 * MS)));
    assert_eq!(bench.actions, []);
}

#[test]
fn the_last_proven_owner_stays_as_the_fallback_of_one_that_is_not_trusted() {
    let mut bench = Bench::watched(SlotConfig::REALTIME);
    let record = bench.record();
    assert_eq!((record.owner, record.fallback), (SEAT[1], Some(SEAT[0])));
    assert!(record.watched && bench.confirm().slot.is_quiet());
    // The next one that is not trusted leaves the proven one where it is.
    bench.on(Event::Request(Request::Swap(Target::New(program(3)), order(200 * MS))));
    bench.on(Event::Request(Request::Retire(SEAT[2])));
    bench.on(Event::Died(SEAT[2]));
    bench.on(Event::Request(Request::Swap(Target::New(brought(3)), order(200 * MS))));
    bench.on(Event::Ready(SEAT[2], instance(8))).confirm().wait().pass(SEAT[2]).confirm();
    assert_eq!(bench.record().fallback, Some(SEAT[1]), "in its window it is the old owner");
    bench.wait();
    let record = bench.record();
    assert_eq!((record.owner, record.fallback), (SEAT[2], Some(SEAT[0])));
    assert_eq!(record.period_ns[1], 0, "the one between them leaves");
}

#[test]
fn a_trusted_owner_needs_no_fallback_and_one_that_is_not_wanted_is_not_kept() {
    let mut bench = Bench::watched(SlotConfig::REALTIME);
    bench.confirm();
    bench.on(Event::Request(Request::Swap(Target::New(program(0)), order(200 * MS))));
    bench.on(Event::Ready(SEAT[2], instance(8))).confirm().wait().pass(SEAT[2]).confirm().wait();
    bench.confirm().wait();
    let record = bench.record();
    assert_eq!((record.owner, record.fallback, record.watched), (SEAT[2], None, false));
    assert_eq!(record.period_ns[..2], [0, 0], "both have left");

    let config = SlotConfig { keeps_fallback: false, ..SlotConfig::REALTIME };
    let mut bench = Bench::rehearsing(config, REHEARSED);
    let now_ns = bench.now.logical_ns;
    bench.answer(rehearsed(now_ns));
    let reported = Action::Report(Report::Step(Step::WithoutFallback(SEAT[1])));
    assert!(
        bench.has(|action| *action == reported),
        "before the flip the message names what a trip will do"
    );
    let record = Bench::watched(config).record();
    assert_eq!((record.owner, record.fallback, record.watched), (SEAT[1], None, true));

    let mut bench = Bench::watched(SlotConfig::REALTIME);
    bench.confirm().on(Event::Request(Request::Retire(SEAT[0])));
    assert_eq!(bench.record().fallback, None, "until it is retired");
    let mut bench = Bench::in_window(SlotConfig::REALTIME);
    bench.on(Event::Request(Request::Retire(SEAT[0])));
    let record = bench.record();
    assert_eq!((record.owner, record.fallback), (SEAT[1], None), "also in the window");
    assert_eq!(record.period_ns[0], 0, "it has left");
}

#[test]
fn after_a_trip_the_fallback_is_owner_and_the_tripped_one_leaves_in_order() {
    let in_window = || Bench::in_window(SlotConfig::LOCKSTEP);
    let long_after = || {
        let mut bench = Bench::watched(SlotConfig::LOCKSTEP);
        bench.confirm();
        bench
    };
    for (mut bench, seen_ns) in [(in_window(), MS), (long_after(), 0), (long_after(), 200 * MS)] {
        let (epoch, at_ns) = (bench.record().epoch, bench.now.logical_ns + 3 * MS);
        // The answer's instant does not depend on when the trip was seen.
        bench.at(at_ns + seen_ns).on(Event::Tripped { epoch, at_ns });
        let record = bench.record();
        assert_eq!((record.owner, record.fallback, record.watched), (SEAT[0], None, false));
        assert_eq!(record.period_ns[1], 0);
        let answer_ns = at_ns + SlotConfig::LOCKSTEP.react_ns;
        assert_eq!(record.effective_ns, instance(7).effective_at_or_after(answer_ns));
        assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])), "{:?}", bench.actions);
        assert!(!bench.has(|action| matches!(action, Action::Kill(_))));
        // What the consumer reports about it later is no news.
        bench.on(Event::FailedOver { epoch, at_ns });
        assert_eq!(bench.actions, []);
        bench.confirm().on(Event::Died(SEAT[1]));
        assert!(bench.slot.is_quiet() && bench.slot.deadline_ns().is_none());
    }
}

#[test]
fn without_a_fallback_the_initial_controller_takes_the_place_of_a_tripped_one() {
    let config = SlotConfig { keeps_fallback: false, ..SlotConfig::LOCKSTEP };
    let mut bench = Bench::watched(config);
    bench.confirm();
    let (epoch, at_ns) = (bench.record().epoch, bench.now.logical_ns);
    bench.on(Event::Tripped { epoch, at_ns });
    assert_eq!(bench.actions, [], "it is answered when all that was allowed has been flown");
    bench.wait();
    assert!(bench.has(|action| *action == Action::Kill(SEAT[1])), "{:?}", bench.actions);
    bench.on(Event::Died(SEAT[1])).wait();
    assert!(
        bench.has(|action| *action == Action::Spawn(SEAT[1], program(0))),
        "{:?}",
        bench.actions
    );
}

#[test]
fn a_trip_of_an_owner_that_has_changed_since_is_ignored() {
    let mut bench = Bench::watched(SlotConfig::REALTIME);
    let epoch = bench.record().epoch;
    bench.confirm().on(Event::Died(SEAT[1])).confirm();
    assert_eq!(bench.record().owner, SEAT[0]);
    let before = bench.record();
    bench.on(Event::Tripped { epoch, at_ns: bench.now.logical_ns });
    assert_eq!((bench.record(), &bench.actions[..]), (before, &[][..]));
}

#[test]
fn an_unwatched_owner_leaves_in_order_for_its_fallback_and_stays_without_one() {
    let mut bench = Bench::watched(SlotConfig::REALTIME);
    bench.confirm().on(Event::Unwatched);
    assert_eq!(bench.record().owner, SEAT[0]);
    assert!(bench.has(|action| *action == Action::AwaitExit(SEAT[1])), "{:?}", bench.actions);
    // The one that follows has proven itself.
    let before = bench.record();
    bench.confirm().on(Event::Unwatched);
    assert_eq!((bench.record(), &bench.actions[..]), (before, &[][..]));
    let mut bench = Bench::watched(SlotConfig::REALTIME);
    bench.confirm().on(Event::Died(SEAT[0])).confirm();
    let before = bench.record();
    bench.on(Event::Unwatched);
    assert_eq!((bench.record(), &bench.actions[..]), (before, &[][..]));
}

impl Bench {
    /// Seat 0 commands, and a process that a user has brought stands by on seat 1.
    fn with_brought_standby(config: SlotConfig) -> Self {
        let mut bench = Self::new(config);
        bench.on(Event::Request(Request::Standby(brought(2), 100 * MS, false)));
        bench.on(Event::Ready(SEAT[1], instance(8))).confirm().wait().wait().pass(SEAT[1]);
        assert_eq!(bench.record().fallback, Some(SEAT[1]));
        bench.confirm();
        bench
    }

    /// The program that the flight began with joins on a seat, and is the fallback.
    fn home_joins(&mut self, seat: Seat) -> &mut Self {
        let spawned = Action::Spawn(seat, program(0));
        assert!(self.has(|action| *action == spawned), "{:?}", self.actions);
        self.on(Event::Ready(seat, instance(7))).confirm().wait().wait().pass(seat);
        assert_eq!(self.record().fallback, Some(seat));
        self.confirm()
    }
}

#[test]
fn an_untrusted_standby_is_watched_as_the_owner_and_gets_a_trusted_fallback() {
    let mut bench = Bench::with_brought_standby(SlotConfig::LOCKSTEP);
    bench.at(2000 * MS).on(Event::Died(SEAT[0]));
    let record = bench.record();
    assert_eq!((record.owner, record.fallback, record.watched), (SEAT[1], None, true));
    let given_up = Action::Report(Report::Step(Step::StandbyUntrusted(brought(2))));
    assert!(bench.has(|action| *action == given_up), "{:?}", bench.actions);
    bench.confirm().wait().home_joins(SEAT[0]);
    let record = bench.record();
    assert_eq!((record.owner, record.watched), (SEAT[1], true));
    let epoch = record.epoch;
    bench.on(Event::Tripped { epoch, at_ns: bench.now.logical_ns });
    assert_eq!((bench.record().owner, bench.record().watched), (SEAT[0], false));
}

#[test]
fn of_two_that_are_not_trusted_neither_is_the_fallback_of_the_other() {
    let mut bench = Bench::with_brought_standby(SlotConfig::REALTIME);
    bench.on(Event::Request(Request::Swap(Target::New(brought(3)), order(200 * MS))));
    bench.on(Event::Ready(SEAT[2], instance(9))).confirm().wait().wait().pass(SEAT[2]).confirm();
    assert_eq!(bench.record().fallback, Some(SEAT[0]), "in its window");
    bench.wait();
    let record = bench.record();
    assert_eq!((record.owner, record.fallback, record.watched), (SEAT[2], Some(SEAT[0]), true));
    assert_eq!(record.period_ns[1], 0, "the standby leaves");
}

#[test]
fn an_untrusted_owner_is_started_again_once_and_watched_then() {
    for keeps_fallback in [true, false] {
        let config = SlotConfig { keeps_fallback, ..SlotConfig::LOCKSTEP };
        let mut bench = Bench::watched(config);
        bench.confirm();
        if keeps_fallback {
            bench.on(Event::Request(Request::Retire(SEAT[0]))).confirm();
        }
        bench.on(Event::Died(SEAT[0])).on(Event::Died(SEAT[1])).wait();
        let restarted = Action::Restart(SEAT[1], brought(1));
        assert!(bench.has(|action| *action == restarted), "{:?}", bench.actions);
        bench.on(Event::Ready(SEAT[1], instance(8)));
        assert_eq!((bench.record().owner, bench.record().watched), (SEAT[1], true));
        bench.confirm();
        if keeps_fallback {
            bench.wait().home_joins(SEAT[0]);
            continue;
        }
        // However long it has flown since.
        let later_ns = bench.now.logical_ns + 60_000 * MS;
        bench.at(later_ns).on(Event::Died(SEAT[1])).wait();
        let spawned = Action::Spawn(SEAT[1], program(0));
        assert!(bench.has(|action| *action == spawned), "{:?}", bench.actions);
    }
}

#[test]
fn a_forced_controller_is_watched_after_a_restart_too_and_not_in_its_next_process() {
    let mut bench = Bench::new(SlotConfig::LOCKSTEP);
    let forced = SwapTerms { force: true, ..order(200 * MS) };
    bench.at(1000 * MS).on(Event::Request(Request::Swap(Target::New(program(1)), forced)));
    bench.on(Event::Ready(SEAT[1], instance(8))).confirm().wait().wait().pass(SEAT[1]);
    bench.confirm().wait();
    assert_eq!((bench.record().fallback, bench.record().watched), (Some(SEAT[0]), true));
    bench.confirm().on(Event::Died(SEAT[0])).on(Event::Died(SEAT[1])).wait();
    bench.on(Event::Ready(SEAT[1], instance(8)));
    assert_eq!((bench.record().owner, bench.record().watched), (SEAT[1], true));
    bench.confirm().wait().home_joins(SEAT[0]);
    bench.on(Event::Died(SEAT[1]));
    assert_eq!((bench.record().owner, bench.record().watched), (SEAT[0], false));
    // Another process on the seat is another matter.
    bench.confirm().on(Event::Request(Request::Swap(Target::New(program(1)), order(200 * MS))));
    bench.on(Event::Ready(SEAT[1], instance(7))).confirm().wait().pass(SEAT[1]).confirm().wait();
    assert_eq!((bench.record().owner, bench.record().watched), (SEAT[1], false));
}

#[test]
fn an_untrusted_owner_has_no_untrusted_standby() {
    let mut bench = Bench::watched(SlotConfig::REALTIME);
    bench.confirm().on(Event::Request(Request::Retire(SEAT[0]))).on(Event::Died(SEAT[0])).confirm();
    bench.on(Event::Request(Request::Standby(brought(2), 100 * MS, false)));
    assert_eq!(bench.refusal(), Some(&Reason::UntrustedStandby(SEAT[1])));
    bench.on(Event::Request(Request::Standby(program(2), 100 * MS, false)));
    assert_eq!(bench.refusal(), None);
}

#[test]
fn a_new_supervisor_gives_an_untrusted_owner_a_trusted_fallback() {
    let mut before = Bench::watched(SlotConfig::REALTIME);
    before.confirm().on(Event::Request(Request::Retire(SEAT[0]))).confirm();
    let mut seated = [None; SEATS];
    seated[1] = Some((brought(1), instance(8)));
    let programs = [brought(1), program(0)];
    let (slot, actions) =
        SlotMachine::adopt(SlotConfig::REALTIME, before.now, &before.record(), programs, seated);
    assert!(slot.record().unwrap().watched, "{actions:?}");
    let mut bench = Bench { slot, now: before.now, actions };
    bench.wait().home_joins(SEAT[0]);
}
