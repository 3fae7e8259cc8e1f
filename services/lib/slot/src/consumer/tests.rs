use super::*;
use shared_types::wire::Value;

const A: Seat = Seat::ALL[0];
const B: Seat = Seat::ALL[1];
const C: Seat = Seat::ALL[2];
const D: Seat = Seat::ALL[3];

fn record(epoch: u64, effective_ns: u64, owner: usize, fallback: Option<usize>) -> Record {
    Record {
        epoch,
        owner: Seat::ALL[owner],
        fallback: fallback.map(|seat| Seat::ALL[seat]),
        effective_ns,
        period_ns: [10, 10, 10, 0],
        kind_changed: false,
        watched: true,
    }
}

fn consumer(records: &[Record]) -> Consumer {
    let mut consumer = Consumer::new(REJECTED_AFTER_TRIP_NS);
    for record in records {
        assert_eq!(consumer.take_record(record), Taken::Accepted);
    }
    consumer
}

#[test]
fn a_record_counts_from_its_instant_on_and_not_before() {
    let mut consumer = consumer(&[record(1, 0, 0, None), record(2, 50, 1, Some(0))]);
    assert_eq!(consumer.authority_at(A, 49), Authority::Owner);
    assert_eq!(consumer.authority_at(B, 49), Authority::Member);
    assert_eq!(consumer.authority_at(A, 50), Authority::Fallback);
    assert_eq!(consumer.authority_at(B, 50), Authority::Owner);
    assert!(consumer.advance(49).is_some());
    assert_eq!(consumer.epoch(), 1);
    let turn = consumer.advance(50).unwrap();
    assert_eq!((turn.from, turn.record.epoch), (Some(A), 2));
    assert_eq!(consumer.advance(51), None);
    // A command that comes late is still judged by the owner of its own instant.
    assert_eq!(consumer.authority_at(A, 49), Authority::Owner);
}

#[test]
fn a_record_for_an_instant_already_decided_is_refused_and_counted() {
    let mut consumer = consumer(&[record(1, 0, 0, None)]);
    consumer.advance(20);
    assert_eq!(consumer.decide(20, true, false), Source::Owner);
    assert_eq!(consumer.take_record(&record(2, 20, 1, None)), Taken::Late);
    assert_eq!(consumer.counters().refused_records, 1);
    assert_eq!(consumer.counters().refused_epoch, 2);
    assert_eq!(consumer.take_record(&record(3, 21, 1, None)), Taken::Accepted);
    assert_eq!(consumer.counters().refused_records, 1);
}

#[test]
fn an_instant_that_was_never_asked_for_is_decided_all_the_same_once_it_is_past() {
    let mut consumer = consumer(&[record(1, 0, 0, None)]);
    consumer.advance(20);
    consumer.decide(20, true, false);
    consumer.close_before(30);
    assert_eq!(consumer.take_record(&record(2, 29, 1, None)), Taken::Late);
    assert_eq!(consumer.take_record(&record(3, 30, 1, None)), Taken::Accepted);
}

#[test]
fn a_late_record_that_changes_no_hands_is_taken_from_now_on() {
    let mut consumer = consumer(&[record(1, 0, 0, None)]);
    consumer.advance(20);
    consumer.decide(20, true, false);
    let mut joined = record(2, 20, 0, None);
    joined.period_ns[D.index()] = 10;
    assert_eq!(consumer.take_record(&joined), Taken::Accepted);
    assert_eq!(consumer.advance(21).map(|turn| turn.record.effective_ns), Some(21));
}

#[test]
fn a_late_record_does_not_undo_a_fail_over() {
    let mut consumer = consumer(&[record(1, 0, 0, Some(1))]);
    consumer.advance(20);
    assert_eq!(consumer.decide(20, false, true), Source::Fallback);
    assert_eq!(consumer.take_record(&record(2, 20, 0, Some(1))), Taken::Late);
    assert!(consumer.failed_over());
}

#[test]
fn epochs_only_grow() {
    let mut consumer = consumer(&[record(5, 0, 0, None)]);
    assert_eq!(consumer.take_record(&record(5, 40, 1, None)), Taken::Known);
    assert_eq!(consumer.take_record(&record(4, 40, 1, None)), Taken::Known);
    assert_eq!(consumer.take_record(&record(6, 40, 1, None)), Taken::Accepted);
    assert_eq!(consumer.take_record(&record(6, 50, 2, None)), Taken::Known);
    consumer.advance(100);
    assert_eq!(consumer.epoch(), 6);
    assert_eq!(consumer.counters().refused_records, 0, "a repetition is no refusal");
}

#[test]
fn a_newer_record_for_an_earlier_instant_voids_those_that_wait_beyond_it() {
    let mut consumer = consumer(&[record(1, 0, 0, None), record(2, 80, 1, None)]);
    consumer.advance(10);
    assert_eq!(consumer.take_record(&record(3, 40, 2, None)), Taken::Accepted);
    consumer.advance(200);
    assert_eq!(consumer.seat_in_effect(), Some(C));
    assert_eq!(consumer.epoch(), 3);
}

#[test]
fn more_records_than_there_is_room_for_are_refused_and_counted() {
    let mut consumer = Consumer::new(REJECTED_AFTER_TRIP_NS);
    for epoch in 1..=PENDING as u64 {
        assert_eq!(consumer.take_record(&record(epoch, epoch * 10, 0, None)), Taken::Accepted);
    }
    assert_eq!(consumer.take_record(&record(9, 90, 0, None)), Taken::Full);
    assert_eq!(consumer.counters().refused_epoch, 9);
    consumer.advance(10);
    assert_eq!(consumer.take_record(&record(10, 90, 1, None)), Taken::Accepted);
}

#[test]
fn a_fail_over_lasts_for_its_epoch_and_no_longer() {
    let mut consumer = consumer(&[record(1, 0, 0, Some(1))]);
    consumer.advance(0);
    assert_eq!(consumer.decide(0, true, true), Source::Owner);
    assert_eq!(consumer.decide(10, false, true), Source::Fallback);
    assert_eq!(consumer.decide(20, true, true), Source::Fallback, "the owner is back too late");
    assert_eq!(consumer.decide(30, true, false), Source::Neither, "and is not asked again");
    assert_eq!(consumer.seat_in_effect(), Some(Seat::ALL[1]));
    assert_eq!(consumer.take_record(&record(2, 40, 0, Some(1))), Taken::Accepted);
    let turn = consumer.advance(40).unwrap();
    assert_eq!(turn.from, Some(B));
    assert_eq!(consumer.decide(40, true, true), Source::Owner);
    let counters = consumer.counters();
    assert_eq!((counters.fail_overs, counters.fail_over_ns, counters.missed), (1, 10, 1));
}

#[test]
fn without_a_fallback_no_seat_commands_when_the_owner_is_silent() {
    let mut consumer = consumer(&[record(1, 0, 0, None)]);
    consumer.advance(0);
    assert_eq!(consumer.decide(0, false, true), Source::Neither);
    assert_eq!(consumer.decide(10, true, false), Source::Owner, "silence alone latches nothing");
    assert_eq!(consumer.counters().missed, 1);
}

#[test]
fn the_answer_to_a_fail_over_changes_nothing_for_the_limiter() {
    let mut consumer = consumer(&[record(1, 0, 0, Some(1))]);
    consumer.advance(0);
    consumer.decide(0, false, true);
    let answer = Record { kind_changed: true, ..record(2, 10, 1, None) };
    assert_eq!(consumer.take_record(&answer), Taken::Accepted);
    assert!(!consumer.advance(10).unwrap().kind_changed, "it already follows that seat");
    let other = Record { kind_changed: true, ..record(3, 20, 2, None) };
    assert_eq!(consumer.take_record(&other), Taken::Accepted);
    assert!(consumer.advance(20).unwrap().kind_changed);
}

#[test]
fn only_a_writer_that_no_known_record_seats_is_a_stray() {
    let mut gone = record(2, 50, 1, None);
    gone.period_ns[A.index()] = 0;
    let mut consumer = consumer(&[record(1, 0, 0, None), gone]);
    consumer.advance(60);
    assert_eq!(consumer.authority_at(A, 60), Authority::Member, "it has just left");
    assert_eq!(consumer.authority_at(D, 60), Authority::Stray);
    assert_eq!(
        consumer.take_record(&Record { epoch: 3, effective_ns: 70, ..gone }),
        Taken::Accepted
    );
    consumer.advance(70);
    assert_eq!(consumer.authority_at(A, 70), Authority::Stray);
}

#[test]
fn a_consumer_that_joins_late_believes_the_history() {
    let mut consumer =
        consumer(&[record(1, 0, 0, None), record(2, 50, 1, Some(0)), record(3, 70, 2, Some(1))]);
    consumer.advance(500);
    assert_eq!((consumer.epoch(), consumer.seat_in_effect()), (3, Some(C)));
}

#[test]
fn a_restored_consumer_goes_on_as_the_first_would_have() {
    let mut consumer = consumer(&[record(1, 0, 0, Some(1)), record(2, 50, 1, Some(0))]);
    consumer.advance(10);
    consumer.decide(10, false, true);
    let mut packed = vec![0; ConsumerMemory::PACKED_SIZE];
    consumer.memory().pack(&mut packed);
    let mut other = Consumer::new(REJECTED_AFTER_TRIP_NS);
    other.restore(&ConsumerMemory::unpack(&packed));
    assert_eq!(other, consumer);
}

#[test]
fn a_trip_moves_to_the_fallback_until_another_owner_is_named() {
    let mut consumer = consumer(&[record(1, 0, 0, Some(1)), record(2, 50, 1, Some(0))]);
    consumer.advance(10);
    assert_eq!(consumer.decide(10, true, true), Source::Owner);
    assert_eq!(consumer.trip(1, A, 11), Tripped::ToFallback);
    assert_eq!(consumer.decide(11, true, true), Source::Fallback);
    assert_eq!(consumer.decide(20, true, true), Source::Fallback, "latched");
    let Counters { fail_overs, fail_over_ns, trips, trip_ns, .. } = consumer.counters();
    assert_eq!((fail_overs, fail_over_ns, trips, trip_ns), (1, 11, 1, 11));
    assert!(consumer.tripped() && consumer.failed_over());
    consumer.advance(50);
    assert!(!consumer.tripped() && !consumer.failed_over(), "another owner");
    assert_eq!(consumer.decide(50, true, true), Source::Owner);
}

#[test]
fn a_record_that_names_the_same_owner_and_fallback_does_not_undo_a_trip() {
    // The window closes by a record that was written before the trip and comes into effect after it.
    let mut consumer = consumer(&[record(1, 0, 0, Some(1)), record(2, 20, 0, Some(1))]);
    consumer.advance(10);
    assert_eq!(consumer.trip(1, A, 10), Tripped::ToFallback);
    assert_eq!(consumer.decide(10, true, true), Source::Fallback);
    let turn = consumer.advance(20).unwrap();
    assert_eq!((turn.from, turn.record.epoch), (Some(B), 2));
    assert_eq!(consumer.decide(20, true, true), Source::Fallback, "no way back");
    assert!(consumer.tripped() && consumer.failed_over());
}

#[test]
fn a_trip_survives_a_record_of_the_same_owner_and_fallback_before_it_takes_effect() {
    let mut consumer = consumer(&[record(1, 0, 0, Some(1)), record(2, 10, 0, Some(1))]);
    consumer.advance(10);
    assert_eq!(consumer.trip(1, A, 11), Tripped::ToFallback);
    assert_eq!(consumer.decide(11, true, true), Source::Fallback);
}

#[test]
fn an_owner_that_is_named_again_without_a_fallback_can_trip_again() {
    let mut consumer = consumer(&[record(1, 0, 0, None), record(2, 20, 0, None)]);
    consumer.advance(10);
    assert_eq!(consumer.trip(1, A, 10), Tripped::NoFallback);
    consumer.advance(20);
    assert!(!consumer.tripped(), "it may be another process");
    assert_eq!(consumer.trip(2, A, 21), Tripped::NoFallback);
    assert_eq!(consumer.counters().trips, 2);
}

#[test]
fn a_trip_of_another_epoch_or_seat_or_of_an_unwatched_owner_means_nothing() {
    let trusted = Record { watched: false, ..record(2, 50, 1, Some(0)) };
    let mut consumer = consumer(&[record(1, 0, 0, Some(1)), trusted]);
    consumer.advance(10);
    assert_eq!(consumer.trip(2, B, 10), Tripped::Ignored, "not yet in effect");
    assert_eq!(consumer.trip(1, B, 10), Tripped::Ignored, "the fallback");
    assert_eq!(consumer.decide(10, true, true), Source::Owner);
    consumer.advance(50);
    assert_eq!(consumer.trip(1, A, 50), Tripped::Ignored, "of the epoch before");
    assert_eq!(consumer.trip(2, B, 50), Tripped::Ignored, "not watched");
    assert_eq!(consumer.decide(50, true, true), Source::Owner);
    assert_eq!(consumer.counters().trips, 0);
}

#[test]
fn a_trip_that_is_repeated_or_comes_after_a_fail_over_changes_nothing() {
    let mut first = consumer(&[record(1, 0, 0, Some(1))]);
    first.advance(10);
    assert_eq!(first.trip(1, A, 10), Tripped::ToFallback);
    assert_eq!(first.trip(1, A, 10), Tripped::Ignored);
    let mut other = consumer(&[record(1, 0, 0, Some(1))]);
    other.advance(10);
    assert_eq!(other.decide(10, false, true), Source::Fallback);
    assert_eq!(other.trip(1, A, 11), Tripped::Ignored);
    assert_eq!((first.counters().trips, other.counters().trips), (1, 0));
}

#[test]
fn a_late_trip_counts_from_the_next_decision_on_and_what_was_decided_stays() {
    let mut consumer = consumer(&[record(1, 0, 0, Some(1))]);
    consumer.advance(10);
    assert_eq!(consumer.decide(10, true, true), Source::Owner);
    assert_eq!(consumer.trip(1, A, 5), Tripped::ToFallback);
    assert_eq!(consumer.counters().trip_ns, 11);
    assert_eq!(consumer.decide(11, true, true), Source::Fallback);
}

#[test]
fn without_a_fallback_a_tripped_owner_is_not_followed_while_another_can_be_started() {
    let mut alone = consumer(&[record(1, 0, 0, None), record(2, 50, 0, Some(1))]);
    alone.advance(10);
    assert_eq!(alone.trip(1, A, 10), Tripped::NoFallback);
    assert_eq!(alone.decide(10, true, true), Source::Neither);
    assert!(alone.tripped() && !alone.failed_over());
    // A fallback that has not published yet takes over with its first command, and nothing is followed before.
    alone.advance(50);
    assert_eq!(alone.decide(50, true, false), Source::Owner, "it may be another process");
    assert_eq!(alone.trip(2, A, 51), Tripped::ToFallback);
    assert_eq!(alone.decide(51, true, false), Source::Neither);
    assert_eq!(alone.decide(60, true, true), Source::Fallback);
}

#[test]
fn a_trip_by_a_refused_or_later_record_counts_if_the_owner_is_the_same() {
    let mut late = consumer(&[record(1, 0, 0, Some(1))]);
    late.advance(0);
    assert_eq!(late.decide(10, true, false), Source::Owner);
    // The fallback has died, and the record that states this comes too late.
    assert_eq!(late.take_record(&record(2, 5, 0, None)), Taken::Late);
    assert_eq!(late.trip(2, A, 11), Tripped::ToFallback);
    assert_eq!(late.decide(11, true, false), Source::Neither);
    assert_eq!(late.take_record(&record(3, 20, 0, None)), Taken::Accepted);
    late.advance(20);
    assert!(!late.tripped(), "it may have been started again since");

    let mut early = consumer(&[record(1, 0, 0, Some(1))]);
    early.advance(10);
    assert_eq!(early.trip(2, A, 10), Tripped::ToFallback);
    assert_eq!(early.take_record(&record(2, 20, 0, None)), Taken::Accepted);
    early.advance(20);
    assert!(early.tripped(), "it was judged by this one");
    assert_eq!(early.decide(20, true, false), Source::Neither);
    assert_eq!(early.take_record(&record(3, 30, 1, None)), Taken::Accepted);
    early.advance(30);
    assert!(!early.tripped(), "another owner");
}

#[test]
fn an_owner_that_has_tripped_is_followed_again_if_it_is_not_replaced_in_time() {
    let mut alone = consumer(&[record(1, 0, 0, None)]);
    alone.advance(10);
    assert_eq!(alone.trip(1, A, 10), Tripped::NoFallback);
    assert_eq!(alone.decide(9 + REJECTED_AFTER_TRIP_NS, true, false), Source::Neither);
    assert_eq!(alone.decide(10 + REJECTED_AFTER_TRIP_NS, true, false), Source::Owner);
    let mut held = Consumer::new(u64::MAX);
    assert_eq!(held.take_record(&record(1, 0, 0, None)), Taken::Accepted);
    held.advance(10);
    assert_eq!(held.trip(1, A, 10), Tripped::NoFallback);
    assert_eq!(
        held.decide(u64::MAX - 1, true, false),
        Source::Neither,
        "it holds the vehicle up by itself"
    );
}

#[test]
fn a_restored_consumer_remembers_that_the_owner_has_tripped() {
    let mut first = consumer(&[record(1, 0, 0, Some(1))]);
    first.advance(10);
    assert_eq!(first.trip(1, A, 10), Tripped::ToFallback);
    let mut other = Consumer::new(REJECTED_AFTER_TRIP_NS);
    other.restore(&first.memory());
    assert_eq!(other, first);
    assert_eq!(other.decide(10, true, true), Source::Fallback);
}
