//! What has arrived, what is in effect, what is new, and what is counted.

use core::cell::RefCell;
use proptest::prelude::*;
use runtime::graph::{Edge, READER_CAPACITY};
use runtime::{Input, InputCounts, Link, Source};
use shared_types::{Header, Imu, Role, Seat, topics};
use std::collections::VecDeque;
use std::rc::Rc;

#[derive(Clone, Default)]
struct Queue(Rc<RefCell<VecDeque<Imu>>>);

impl Source<Imu> for Queue {
    fn receive(&mut self) -> Option<Imu> {
        self.0.borrow_mut().pop_front()
    }
}

impl Queue {
    fn push(&self, valid_ns: u64, seat: u32, sequence: u64) {
        let header = Header { valid_ns, seat, sequence, ..Header::default() };
        let sample = Imu { header, ..Imu::default() };
        self.0.borrow_mut().push_back(sample);
    }
}

fn edge(strict: bool) -> Edge {
    let topic = &topics::IMU.info;
    Edge { strict, ..Edge::unwaited(topic, Role::Estimator) }
}

fn input(strict: bool) -> (Input<Imu>, Queue) {
    let (mut input, queue) = (Input::default(), Queue::default());
    input.connect(Box::new(queue.clone()), Some(edge(strict)));
    (input, queue)
}

fn fresh(input: &Input<Imu>) -> Vec<(u64, u32, u64)> {
    let key = |h: &Header| (h.valid_ns, h.seat, h.sequence);
    input.fresh().iter().map(|s| key(&s.header)).collect()
}

proptest! {
    #[test]
    fn samples_take_effect_in_order_of_time_seat_and_sequence_whatever_the_arrival(
        mut keys in prop::collection::btree_set((0..20_u64, 0..3_u32, 1..50_u64), 1..60)
            .prop_map(|set| set.into_iter().collect::<Vec<_>>()).prop_shuffle(),
        chunks in prop::collection::vec(1..10_usize, 60),
    ) {
        let (mut input, queue) = input(false);
        let mut rest = &keys[..];
        for size in chunks {
            let (now, later) = rest.split_at(size.min(rest.len()));
            for &(valid, seat, sequence) in now {
                queue.push(valid, seat, sequence);
            }
            input.receive();
            rest = later;
        }
        input.accept(100, None);
        let seen = fresh(&input);
        keys.sort_unstable();
        prop_assert_eq!(seen, keys);
    }
}

#[test]
fn a_strict_arrow_excludes_the_instant_itself_and_the_others_include_it() {
    for (strict, expected) in [(true, 1), (false, 2)] {
        let (mut input, queue) = input(strict);
        queue.push(9, 0, 1);
        queue.push(10, 0, 2);
        queue.push(11, 0, 3);
        input.receive();
        input.accept(10, None);
        assert_eq!(input.fresh().len(), expected);
        assert_eq!(input.waiting(), 3 - expected);
    }
}

#[test]
fn a_topic_outside_the_waiting_graph_takes_effect_at_its_instant() {
    let (mut input, queue) = (Input::<Imu>::default(), Queue::default());
    input.connect(Box::new(queue.clone()), None);
    queue.push(10, 0, 1);
    input.receive();
    input.accept(9, None);
    assert!(input.latest().is_none());
    input.accept(10, Some(9));
    assert_eq!(input.fresh().len(), 1);
}

#[test]
fn fresh_before_and_latest_are_distinguished() {
    let (mut input, queue) = input(false);
    queue.push(1, 0, 1);
    queue.push(2, 0, 2);
    input.receive();
    input.accept(2, None);
    assert!(input.before_fresh().is_none());
    queue.push(3, 0, 3);
    input.receive();
    input.accept(3, Some(2));
    assert_eq!(fresh(&input), [(3, 0, 3)]);
    assert_eq!(input.before_fresh().unwrap().header.sequence, 2);
    input.accept(4, Some(3));
    assert!(input.fresh().is_empty());
    assert_eq!(input.latest().unwrap().header.sequence, 3);
}

#[test]
fn a_sample_is_late_if_the_step_before_should_have_had_it() {
    let (mut input, queue) = input(false);
    input.accept(10, None);
    queue.push(10, 0, 1);
    queue.push(11, 0, 2);
    input.receive();
    input.accept(20, Some(10));
    assert_eq!(input.counts(), InputCounts { late: 1, ..InputCounts::default() });
    assert_eq!(input.fresh().len(), 2, "late, but not refused");
}

#[test]
fn a_gap_in_the_sequence_of_one_seat_is_counted_as_lost() {
    let (mut input, queue) = input(false);
    for (valid, seat, sequence) in [(1, 0, 1), (2, 0, 4), (3, 1, 9), (4, 1, 10)] {
        queue.push(valid, seat, sequence);
    }
    input.receive();
    input.accept(10, None);
    assert_eq!(input.counts(), InputCounts { lost: 2, ..InputCounts::default() });
}

#[test]
fn a_repeated_sample_replaces_the_waiting_one_and_is_ignored_once_in_effect() {
    let (mut input, queue) = input(false);
    queue.push(5, 0, 1);
    input.receive();
    queue.push(5, 0, 1);
    input.receive();
    assert_eq!(input.waiting(), 1);
    input.accept(5, None);
    queue.push(5, 0, 1);
    input.receive();
    input.accept(6, Some(5));
    assert!(input.fresh().is_empty());
    assert_eq!(input.counts(), InputCounts::default());
}

#[test]
fn a_full_reader_keeps_the_newest_and_counts_what_it_dropped_once() {
    let (mut input, queue) = input(false);
    let capacity = READER_CAPACITY as u64;
    queue.push(1_000, 0, 1);
    input.receive();
    input.accept(1_000, None);
    for sequence in 2..=capacity + 4 {
        queue.push(1_000 + sequence, 0, sequence);
    }
    // Older than all that it has: there is no room for it either.
    queue.push(1_001, 0, 1);
    input.receive();
    input.accept(1_000_000, None);
    assert_eq!(input.fresh().len(), READER_CAPACITY);
    assert_eq!(input.latest().unwrap().header.sequence, capacity + 4);
    assert_eq!(input.counts(), InputCounts { lost: 3, ..InputCounts::default() });
}

#[test]
fn a_seat_that_fills_the_queue_keeps_no_other_seats_samples_out() {
    let (mut input, queue) = input(false);
    for sequence in 1..=2 * READER_CAPACITY as u64 {
        queue.push(u64::MAX - sequence, 1, sequence);
    }
    input.receive();
    for sequence in 1..=5 {
        queue.push(10 * sequence, 0, sequence);
        input.receive();
        input.accept(10 * sequence, Some(10 * sequence - 10));
        assert_eq!(fresh(&input), [(10 * sequence, 0, sequence)]);
        assert!(input.waiting() <= READER_CAPACITY);
    }
    assert_eq!(input.counts(), InputCounts::default());
}

#[test]
fn a_link_is_silent_then_fresh_then_stale() {
    let (mut input, queue) = input(false);
    assert!(matches!(input.link(0, 10), Link::Silent));
    queue.push(100, 0, 1);
    input.receive();
    input.accept(100, None);
    assert!(matches!(input.link(100, 0), Link::Fresh(_)));
    assert!(matches!(input.link(110, 10), Link::Fresh(_)));
    assert!(matches!(input.link(111, 10), Link::Stale { age_ns: 11, .. }));
}

#[test]
fn a_latch_survives_packing_and_hides_what_came_before() {
    let (mut input, queue) = input(false);
    let mut bytes = vec![1; Input::<Imu>::LATCH_SIZE];
    input.pack_latch(&mut bytes);
    let mut twin = Input::<Imu>::default();
    twin.unpack_latch(&bytes);
    assert!(twin.latest().is_none());
    queue.push(3, 0, 7);
    input.receive();
    input.accept(3, None);
    input.pack_latch(&mut bytes);
    let again = Queue::default();
    twin.connect(Box::new(again.clone()), Some(edge(false)));
    twin.unpack_latch(&bytes);
    assert_eq!(twin.latest().unwrap().header.sequence, 7);
    again.push(2, 0, 6);
    again.push(3, 0, 7);
    again.push(4, 0, 8);
    twin.receive();
    twin.accept(4, Some(3));
    assert_eq!(fresh(&twin), [(4, 0, 8)]);
    assert_eq!(twin.counts(), InputCounts::default());
}

#[test]
fn a_successor_in_flight_counts_from_anywhere_and_a_forged_seat_is_ignored() {
    let (mut input, queue) = input(false);
    let publish = |valid_ns, sequence, generation, seat| {
        let header = Header { valid_ns, sequence, generation, seat, ..Header::default() };
        queue.0.borrow_mut().push_back(Imu { header, ..Imu::default() });
    };
    publish(1, 900, 0, 1);
    publish(2, 1, 1, 1);
    publish(3, 2, 1, 1);
    publish(3, 7, 0, 99);
    input.receive();
    input.accept(3, None);
    assert_eq!(fresh(&input), [(1, 1, 900), (2, 1, 1), (3, 1, 2)]);
    assert_eq!(input.counts(), InputCounts::default());
}

#[test]
fn what_a_restarted_producer_without_a_slot_sent_and_did_not_arrive_is_lost() {
    let (mut input, queue) = input(false);
    let publish = |valid_ns, sequence, generation| {
        let header = Header { valid_ns, sequence, generation, ..Header::default() };
        queue.0.borrow_mut().push_back(Imu { header, ..Imu::default() });
    };
    publish(1, 7, 0);
    // Its predecessor's 8 and 9 went with it; the restarted one goes on with the numbers.
    publish(4, 10, 1);
    input.receive();
    input.accept(4, None);
    assert_eq!(input.counts(), InputCounts { late: 0, lost: 2 });
}

#[test]
fn a_loop_that_joins_knows_what_is_in_effect_without_its_being_new() {
    let (mut input, queue) = input(false);
    for valid in 1..=6 {
        queue.push(valid, 0, valid);
    }
    input.receive();
    input.skip_until(4);
    assert!(input.fresh().is_empty());
    assert_eq!(input.latest().unwrap().header.sequence, 4);
    queue.push(2, 1, 1);
    input.receive();
    input.accept(6, Some(4));
    assert_eq!(fresh(&input), [(5, 0, 5), (6, 0, 6)], "older history of another seat is none");
    assert_eq!(input.counts(), InputCounts::default());
}

#[test]
fn what_arrives_late_is_new_to_a_loop_that_joined_or_was_restored_in_between() {
    let at_4 = |restored: bool| {
        let (mut input, queue) = input(false);
        queue.push(2, 0, 2);
        queue.push(3, 0, 3);
        input.receive();
        if restored {
            input.accept(4, None);
            let mut latch = vec![0; Input::<Imu>::LATCH_SIZE];
            input.pack_latch(&mut latch);
            input.unpack_latch(&latch);
            input.knows_until(4);
        } else {
            input.skip_until(4);
        }
        (input, queue)
    };
    for restored in [false, true] {
        let (mut input, queue) = at_4(restored);
        for valid in 2..=5 {
            queue.push(valid, 0, valid);
        }
        input.receive();
        input.accept(6, Some(4));
        assert_eq!(fresh(&input), [(4, 0, 4), (5, 0, 5)], "restored: {restored}");
        assert_eq!(input.counts(), InputCounts { late: 1, lost: 0 });
    }
}

#[test]
fn samples_of_a_process_that_had_gone_are_left_out() {
    let (mut input, queue) = input(false);
    let mut first_generations = [0; Seat::COUNT];
    first_generations[Seat { role: Role::Plant, index: 0 }.number().expect("a seat")] = 2;
    input.take_from(&first_generations);
    for (sequence, generation) in [(1, 0), (2, 1), (3, 2), (4, 3)] {
        let header = Header { valid_ns: sequence, sequence, generation, ..Header::default() };
        queue.0.borrow_mut().push_back(Imu { header, ..Imu::default() });
    }
    input.receive();
    input.accept(10, None);
    assert_eq!(fresh(&input), [(3, 0, 3), (4, 0, 4)]);
}
