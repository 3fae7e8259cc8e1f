//! Candidates that are flown ahead, and owners that are watched.

use super::*;

const BROUGHT: Order = Order { rehearse: true, trusted: false, ..order(200 * MS) };

fn rehearsed(from_ns: u64) -> Rehearsed {
    Rehearsed { from_ns, left_tube: false, verdict: Ok("keeps to the tube".to_owned()) }
}

fn fails(from_ns: u64) -> Rehearsed {
    let refusal = RehearsalRefusal::Fails("would lose the vehicle".to_owned());
    Rehearsed { verdict: Err(refusal), ..rehearsed(from_ns) }
}

impl Desk {
    /// Seat 1 has passed the admission check and is flown ahead.
    fn rehearsing(config: SlotConfig, order: Order) -> Self {
        let mut desk = Self::new(config);
        desk.at(1000 * MS);
        desk.on(Event::Request(Request::Swap(Target::New(Program(1)), order)));
        desk.on(Event::Ready(SEAT[1], instance(8))).confirm().wait().wait().pass(SEAT[1]);
        assert!(desk.has(|action| *action == Action::Rehearse(SEAT[1])), "{:?}", desk.actions);
        desk
    }

    fn answer(&mut self, rehearsed: Rehearsed) -> &mut Self {
        self.on(Event::Rehearsed(SEAT[1], rehearsed))
    }

    /// Seat 1 commands, is not trusted, and its window is over.
    fn watched(config: SlotConfig) -> Self {
        let mut desk = Self::rehearsing(config, BROUGHT);
        let now_ns = desk.now.logical_ns;
        desk.answer(rehearsed(now_ns)).confirm().wait();
        desk
    }
}

#[test]
fn a_candidate_that_must_be_flown_ahead_gets_the_slot_only_after_that() {
    let mut desk = Desk::rehearsing(SlotConfig::LOCKSTEP, BROUGHT);
    assert_eq!(desk.slot.progress(), Progress::Rehearsing(SEAT[1]));
    assert!(desk.slot.holds_time(), "lockstep time stands still until the verdict");
    assert_eq!(desk.record().owner, SEAT[0]);
    let now_ns = desk.now.logical_ns;
    desk.answer(rehearsed(now_ns));
    assert_eq!(desk.record().owner, SEAT[1]);
    assert!(desk.record().watched, "a new owner is watched");
    assert_eq!(desk.slot.progress(), Progress::Flipping(SEAT[1]));
    desk.confirm();
    let progress = desk.slot.progress();
    assert_eq!((progress.label(), progress.seat()), ("window", Some(SEAT[1])));
    assert_eq!(progress.until_ns(), desk.slot.deadline_ns());
}

#[test]
fn a_candidate_that_fails_ahead_is_sent_away_and_one_by_force_is_not() {
    let mut desk = Desk::rehearsing(SlotConfig::REALTIME, BROUGHT);
    let now_ns = desk.now.logical_ns;
    desk.answer(fails(now_ns));
    assert!(matches!(desk.refusal(), Some(Reason::Rehearsal(RehearsalRefusal::Fails(_)))));
    assert_eq!((desk.record().owner, desk.record().period_ns[1]), (SEAT[0], 0));

    let forced = Order { force: true, ..BROUGHT };
    let mut desk = Desk::rehearsing(SlotConfig::REALTIME, forced);
    desk.answer(fails(now_ns));
    assert_eq!(desk.record().owner, SEAT[1]);
    assert!(
        desk.has(|action| matches!(
            action,
            Action::Report(Report::Step(Step::RehearsalForced(..)))
        ))
    );
}

#[test]
fn an_answer_about_a_flight_that_is_past_is_asked_for_once_more_and_not_twice() {
    for left_tube in [false, true] {
        let mut desk = Desk::rehearsing(SlotConfig::REALTIME, BROUGHT);
        let old = |desk: &Desk| {
            let now_ns = desk.now.logical_ns;
            let from_ns = if left_tube { now_ns } else { now_ns - 2001 * MS };
            Rehearsed { left_tube, ..rehearsed(from_ns) }
        };
        let later_ns = desk.now.logical_ns + 3000 * MS;
        desk.at(later_ns);
        let first = old(&desk);
        desk.answer(first);
        assert!(desk.has(|action| *action == Action::Rehearse(SEAT[1])), "{:?}", desk.actions);
        let second = old(&desk);
        desk.answer(second);
        let refused = Reason::Rehearsal(RehearsalRefusal::NotRehearsed(String::new()));
        let discriminant = std::mem::discriminant::<Reason>;
        assert_eq!(desk.refusal().map(discriminant), Some(discriminant(&refused)));
        assert_eq!(desk.record().owner, SEAT[0]);
    }
}

#[test]
fn an_answer_that_was_not_asked_for_changes_nothing() {
    let mut desk = Desk::new(SlotConfig::REALTIME);
    desk.at(1000 * MS).swap(7).confirm();
    desk.answer(rehearsed(1000 * MS));
    assert_eq!(desk.actions, []);
    desk.on(Event::Rehearsed(SEAT[3], rehearsed(1000 * MS)));
    assert_eq!(desk.actions, []);
}

#[test]
fn the_last_proven_owner_stays_as_the_fallback_of_one_that_is_not_trusted() {
    let mut desk = Desk::watched(SlotConfig::REALTIME);
    let record = desk.record();
    assert_eq!((record.owner, record.fallback), (SEAT[1], Some(SEAT[0])));
    assert!(record.watched && desk.confirm().slot.is_quiet());
    // The next one that is not trusted leaves the proven one where it is.
    desk.on(Event::Request(Request::Swap(Target::New(Program(3)), order(200 * MS))));
    let untrusted = Order { trusted: false, ..order(200 * MS) };
    desk.on(Event::Request(Request::Retire(SEAT[2])));
    desk.on(Event::Died(SEAT[2]));
    desk.on(Event::Request(Request::Swap(Target::New(Program(3)), untrusted)));
    desk.on(Event::Ready(SEAT[2], instance(8))).confirm().wait().pass(SEAT[2]).confirm();
    assert_eq!(desk.record().fallback, Some(SEAT[1]), "in its window it is the old owner");
    desk.wait();
    let record = desk.record();
    assert_eq!((record.owner, record.fallback), (SEAT[2], Some(SEAT[0])));
    assert_eq!(record.period_ns[1], 0, "the one between them leaves");
}

#[test]
fn a_trusted_owner_needs_no_fallback_and_one_that_is_not_wanted_is_not_kept() {
    let mut desk = Desk::watched(SlotConfig::REALTIME);
    desk.confirm();
    desk.on(Event::Request(Request::Swap(Target::New(Program(0)), order(200 * MS))));
    desk.on(Event::Ready(SEAT[2], instance(8))).confirm().wait().pass(SEAT[2]).confirm().wait();
    let record = desk.record();
    assert_eq!((record.owner, record.fallback, record.watched), (SEAT[2], None, false));
    assert_eq!(record.period_ns[..2], [0, 0], "both have left");

    let config = SlotConfig { keeps_fallback: false, ..SlotConfig::REALTIME };
    let mut desk = Desk::rehearsing(config, BROUGHT);
    let now_ns = desk.now.logical_ns;
    desk.answer(rehearsed(now_ns));
    let said = Action::Report(Report::Step(Step::WithoutFallback(SEAT[1])));
    assert!(desk.has(|action| *action == said), "before the flip it is told what a trip will do");
    let record = Desk::watched(config).record();
    assert_eq!((record.owner, record.fallback, record.watched), (SEAT[1], None, true));

    let mut desk = Desk::watched(SlotConfig::REALTIME);
    desk.confirm().on(Event::Request(Request::Retire(SEAT[0])));
    assert_eq!(desk.record().fallback, None, "until it is retired");
}

#[test]
fn after_a_trip_the_fallback_is_owner_and_the_tripped_one_leaves_in_order() {
    let in_window = || Desk::in_window(SlotConfig::LOCKSTEP);
    let long_after = || {
        let mut desk = Desk::watched(SlotConfig::LOCKSTEP);
        desk.confirm();
        desk
    };
    for (mut desk, seen_ns) in [(in_window(), MS), (long_after(), 0), (long_after(), 200 * MS)] {
        let (epoch, at_ns) = (desk.record().epoch, desk.now.logical_ns + 3 * MS);
        // The answer's instant does not depend on when the trip was seen.
        desk.at(at_ns + seen_ns).on(Event::Tripped { epoch, at_ns });
        let record = desk.record();
        assert_eq!((record.owner, record.fallback, record.watched), (SEAT[0], None, false));
        assert_eq!(record.period_ns[1], 0);
        let answer_ns = at_ns + SlotConfig::LOCKSTEP.react_ns;
        assert_eq!(record.effective_ns, instance(7).effective_at_or_after(answer_ns));
        assert!(desk.has(|action| *action == Action::AwaitExit(SEAT[1])), "{:?}", desk.actions);
        assert!(!desk.has(|action| matches!(action, Action::Kill(_))));
        // What the consumer says of it later is no news.
        desk.on(Event::FailedOver { epoch, at_ns });
        assert_eq!(desk.actions, []);
        desk.confirm().on(Event::Died(SEAT[1]));
        assert!(desk.slot.is_quiet() && desk.slot.deadline_ns().is_none());
    }
}

#[test]
fn without_a_fallback_the_initial_controller_takes_the_place_of_a_tripped_one() {
    let config = SlotConfig { keeps_fallback: false, ..SlotConfig::LOCKSTEP };
    let mut desk = Desk::watched(config);
    desk.confirm();
    let (epoch, at_ns) = (desk.record().epoch, desk.now.logical_ns);
    desk.on(Event::Tripped { epoch, at_ns });
    assert_eq!(desk.actions, [], "it is answered when all that was allowed has been flown");
    desk.wait();
    assert!(desk.has(|action| *action == Action::Kill(SEAT[1])), "{:?}", desk.actions);
    desk.on(Event::Died(SEAT[1])).wait();
    assert!(desk.has(|action| *action == Action::Spawn(SEAT[1], Program(0))), "{:?}", desk.actions);
}

#[test]
fn a_trip_of_an_owner_that_has_changed_since_is_ignored() {
    let mut desk = Desk::watched(SlotConfig::REALTIME);
    let epoch = desk.record().epoch;
    desk.confirm().on(Event::Died(SEAT[1])).confirm();
    assert_eq!(desk.record().owner, SEAT[0]);
    let before = desk.record();
    desk.on(Event::Tripped { epoch, at_ns: desk.now.logical_ns });
    assert_eq!((desk.record(), &desk.actions[..]), (before, &[][..]));
}

#[test]
fn an_unwatched_owner_leaves_in_order_for_its_fallback_and_stays_without_one() {
    let mut desk = Desk::watched(SlotConfig::REALTIME);
    desk.confirm().on(Event::Unwatched);
    assert_eq!(desk.record().owner, SEAT[0]);
    assert!(desk.has(|action| *action == Action::AwaitExit(SEAT[1])), "{:?}", desk.actions);
    // The one that follows has proven itself.
    let before = desk.record();
    desk.confirm().on(Event::Unwatched);
    assert_eq!((desk.record(), &desk.actions[..]), (before, &[][..]));
    let mut desk = Desk::watched(SlotConfig::REALTIME);
    desk.confirm().on(Event::Died(SEAT[0])).confirm();
    let before = desk.record();
    desk.on(Event::Unwatched);
    assert_eq!((desk.record(), &desk.actions[..]), (before, &[][..]));
}
