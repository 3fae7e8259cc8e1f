//! What arrives when, by what a loop has reported.

use super::*;
use shared_types::{Imu, Role, WrenchCommand, topics};

const MS: u64 = 1_000_000;

fn imu(sequence: u64) -> Imu {
    let header = Header { sequence, valid_ns: sequence * MS, ..Header::default() };
    Imu { header, ..Imu::default() }
}

fn deviation(kind: DeviationKind, step_ms: u64, first: u64, last: u64) -> Deviation {
    let header = Header { release_ns: step_ms * MS, ..Header::default() };
    let input = Deviation::input_from("imu");
    Deviation { header, kind, first, last, input, ..Deviation::default() }
}

/// A command of seat 0, in effect at a millisecond.
fn command(generation: u32, sequence: u64) -> WrenchCommand {
    let header = Header { generation, sequence, valid_ns: MS, ..Header::default() };
    WrenchCommand { header, ..WrenchCommand::default() }
}

/// Sequences that a step each millisecond has.
fn played(deviations: &[Deviation]) -> Vec<Vec<u64>> {
    let now_ns = Rc::new(Cell::new(0));
    let mut source = TapeSource::new(
        &(1..=8).map(imu).collect::<Vec<_>>(),
        &topics::IMU.info,
        Edge::unwaited(&topics::IMU.info, Role::Estimator),
        Exceptions::of(&topics::IMU.info, deviations.iter()),
        Arrival::default(),
        Rc::clone(&now_ns),
    );
    let step = |step_ms: u64| {
        now_ns.set(step_ms * MS);
        let arrived = core::iter::from_fn(|| source.receive());
        arrived.map(|s| s.header.sequence).collect()
    };
    (1..=8).map(step).collect()
}

#[test]
fn nominally_a_sample_is_there_at_the_step_that_it_takes_effect_at() {
    let expected: Vec<_> = (1..=8).map(|sequence| vec![sequence]).collect();
    assert_eq!(played(&[]), expected);
}

#[test]
fn late_and_lost_samples_come_as_they_came_in_flight() {
    let of_another_input = Deviation {
        input: Deviation::input_from("pose_fix"),
        ..deviation(DeviationKind::LostSamples, 1, 1, 8)
    };
    let played = played(&[
        deviation(DeviationKind::LostSamples, 3, 2, 2),
        deviation(DeviationKind::LateSamples, 6, 3, 5),
        of_another_input,
    ]);
    let expected = [vec![1], vec![], vec![], vec![], vec![], vec![3, 4, 5, 6], vec![7], vec![8]];
    assert_eq!(played, expected);
}

#[test]
fn a_killed_loop_had_received_nothing_of_the_successor_of_what_it_followed() {
    let now_ns = Rc::new(Cell::new(8 * MS));
    let sample = |sequence, generation| {
        let Imu { header, .. } = imu(sequence);
        Imu { header: Header { generation, ..header }, ..Imu::default() }
    };
    let slot = &topics::WRENCH_COMMAND.info;
    let mut source = TapeSource::new(
        &[sample(1, 0), sample(2, 0), sample(3, 1), sample(4, 1)],
        slot,
        Edge::unwaited(slot, Role::Estimator),
        Exceptions::default().killed_after(Some(&sample(2, 0).header)),
        Arrival::default(),
        now_ns,
    );
    let received: Vec<_> = core::iter::from_fn(|| source.receive()).collect();
    assert_eq!(received.iter().map(|s| s.header.sequence).collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn a_writer_that_had_left_when_the_process_joined_is_read_if_that_is_reported() {
    let slot = &topics::WRENCH_COMMAND.info;
    let sample = |seat, sequence, valid_ms| {
        let header = Header {
            seat,
            sequence,
            valid_ns: valid_ms * MS,
            release_ns: valid_ms * MS,
            ..Header::default()
        };
        WrenchCommand { header, ..WrenchCommand::default() }
    };
    // Seat 0 publishes its last sample at 2 ms; the process joins at 3 ms.
    let samples = [sample(0, 1, 1), sample(0, 2, 2), sample(1, 1, 2), sample(1, 2, 4)];
    let received = |deviations: &[Deviation]| {
        let mut source = TapeSource::new(
            &samples,
            slot,
            Edge::unwaited(slot, Role::Plant),
            Exceptions::of(slot, deviations.iter()),
            Arrival { at_ns: Some(3 * MS), blank: true, in_flight: true, in_order: false },
            Rc::new(Cell::new(8 * MS)),
        );
        let received = core::iter::from_fn(|| source.receive());
        received.map(|s| (s.header.seat, s.header.sequence)).collect::<Vec<_>>()
    };
    let input = Deviation::input_from(slot.name);
    let began = |writer_seat, first| Deviation {
        input,
        writer_seat,
        ..deviation(DeviationKind::Began, 3, first, first)
    };
    assert_eq!(received(&[began(1, 0)]), [(1, 1), (1, 2)]);
    assert_eq!(received(&[began(0, 0), began(1, 2)]), [(0, 1), (0, 2), (1, 2)]);
    assert_eq!(received(&[began(0, 2)]), [(0, 2)]);
}

#[test]
fn a_writer_that_was_late_when_the_process_joined_had_kept_its_history_by_then() {
    let topic = &topics::IMU.info;
    let history = topic.history as u64;
    let of = |release_ms: u64| {
        let mut sample = imu(release_ms);
        sample.header.release_ns = release_ms * MS;
        sample
    };
    let samples: Vec<_> = (1..=4 * history).map(of).collect();
    // It joins at 3 histories, when the last two of them had not been published, and has the newest half late.
    let join_ms = 3 * history + 1;
    let deviations = [
        deviation(DeviationKind::Began, join_ms, 0, 0),
        deviation(DeviationKind::LostSamples, join_ms + 1, history + 1, 2 * history),
        deviation(DeviationKind::LateSamples, join_ms + 1, 2 * history + 1, 3 * history),
    ];
    let now_ns = Rc::new(Cell::new(join_ms * MS));
    let mut source = TapeSource::new(
        &samples,
        topic,
        Edge::unwaited(topic, Role::Estimator),
        Exceptions::of(topic, deviations.iter()),
        Arrival { at_ns: Some(join_ms * MS), blank: true, in_flight: true, in_order: false },
        now_ns,
    );
    let received: Vec<u64> =
        core::iter::from_fn(|| source.receive()).map(|s| s.header.sequence).collect();
    assert_eq!(received, (1..=history).collect::<Vec<_>>());
}

#[test]
fn a_writer_that_was_killed_before_its_samples_reached_the_process_is_left_out() {
    let slot = &topics::WRENCH_COMMAND.info;
    let ended = |writer_generation, last| Deviation {
        input: Deviation::input_from(slot.name),
        writer_generation,
        ..deviation(DeviationKind::Ended, 8, last, last)
    };
    let mut source = TapeSource::new(
        &[command(0, 7), command(0, 8), command(1, 8), command(2, 8), command(2, 9)],
        slot,
        Edge::unwaited(slot, Role::Plant),
        Exceptions::of(slot, [ended(0, 7), ended(2, 9)].iter()),
        Arrival { in_order: true, ..Arrival::default() },
        Rc::new(Cell::new(8 * MS)),
    );
    let received = core::iter::from_fn(|| source.receive());
    let received: Vec<_> = received.map(|s| (s.header.generation, s.header.sequence)).collect();
    assert_eq!(received, [(0, 7), (2, 8), (2, 9)]);
}

#[test]
fn a_copy_that_only_the_recorder_had_of_a_killed_writer_comes_from_its_successor() {
    let slot = &topics::WRENCH_COMMAND.info;
    let of = |kind, writer_generation, sequence| Deviation {
        input: Deviation::input_from(slot.name),
        writer_generation,
        ..deviation(kind, 8, sequence, sequence)
    };
    let deviations = [of(DeviationKind::Ended, 0, 7), of(DeviationKind::Began, 1, 8)];
    let played = |recorded: &[WrenchCommand]| {
        let mut source = TapeSource::new(
            recorded,
            slot,
            Edge::unwaited(slot, Role::Plant),
            Exceptions::of(slot, deviations.iter()),
            Arrival::default(),
            Rc::new(Cell::new(8 * MS)),
        );
        let played = core::iter::from_fn(|| source.receive());
        played.map(|s| (s.header.generation, s.header.sequence)).collect::<Vec<_>>()
    };
    let expected = [(0, 7), (1, 8), (1, 9), (1, 10)];
    assert_eq!(played(&[command(0, 7), command(0, 8), command(0, 9), command(1, 10)]), expected);
    // A candidate on a seat that another one had before counts from 1.
    let candidate = [command(0, 7), command(0, 8), command(1, 1), command(1, 8), command(1, 9)];
    assert_eq!(played(&candidate), [(0, 7), (1, 8), (1, 9)]);
    // In realtime both copies may be recorded.
    let both = [command(0, 7), command(0, 8), command(1, 8), command(1, 9), command(1, 10)];
    assert_eq!(played(&both), expected);
}

#[test]
fn one_that_joined_had_a_killed_writers_copy_from_its_successor() {
    let slot = &topics::WRENCH_COMMAND.info;
    let began = Deviation {
        input: Deviation::input_from(slot.name),
        writer_generation: 1,
        ..deviation(DeviationKind::Began, 3, 0, 0)
    };
    let of = |generation, sequence| {
        let valid_ns = sequence * MS;
        let header =
            Header { generation, sequence, valid_ns, release_ns: valid_ns, ..Header::default() };
        WrenchCommand { header, ..WrenchCommand::default() }
    };
    let played = |recorded: &[WrenchCommand]| {
        let mut source = TapeSource::new(
            recorded,
            slot,
            Edge::unwaited(slot, Role::Plant),
            Exceptions::of(slot, [began].iter()),
            Arrival { at_ns: Some(3 * MS), blank: true, in_flight: true, in_order: false },
            Rc::new(Cell::new(8 * MS)),
        );
        let played = core::iter::from_fn(|| source.receive());
        played.map(|s| (s.header.generation, s.header.sequence)).collect::<Vec<_>>()
    };
    assert_eq!(played(&[of(0, 1), of(0, 2), of(1, 3)]), [(1, 2), (1, 3)]);
    assert_eq!(played(&[of(0, 1), of(0, 2)]), [(1, 2)], "it was killed as well");
    // A candidate on a seat that another one had before counts from 1.
    assert_eq!(played(&[of(0, 2), of(1, 1), of(1, 4)]), [(1, 1), (1, 4)]);
}

#[test]
fn what_a_writer_publishes_for_instants_before_it_had_its_seat_does_not_count() {
    let slot = &topics::WRENCH_COMMAND.info;
    let sample = |sequence| {
        let header =
            Header { generation: 1, sequence, valid_ns: sequence * MS, ..Header::default() };
        WrenchCommand { header, ..WrenchCommand::default() }
    };
    let samples: Vec<_> = (1..=6).map(sample).collect();
    // It catches up from 1 ms on and has its seat from 4 ms on; that sample 2 was received is reported.
    let late = Deviation {
        input: Deviation::input_from(slot.name),
        writer_generation: 1,
        ..deviation(DeviationKind::LateSamples, 5, 2, 2)
    };
    let mut exceptions = Exceptions::of(slot, [late].iter());
    exceptions.seated(slot, (0, 1), 4 * MS);
    let mut source = TapeSource::new(
        &samples,
        slot,
        Edge::unwaited(slot, Role::Plant),
        exceptions,
        Arrival::default(),
        Rc::new(Cell::new(8 * MS)),
    );
    let received = core::iter::from_fn(|| source.receive());
    assert_eq!(received.map(|s| s.header.sequence).collect::<Vec<_>>(), [2, 4, 5, 6]);
}

#[test]
fn what_a_writer_published_before_its_first_sample_was_read_never_arrived() {
    let began = Deviation { last: 3, ..deviation(DeviationKind::Began, 3, 3, 3) };
    let expected: Vec<_> =
        (1..=8).map(|sequence| if sequence < 3 { vec![] } else { vec![sequence] }).collect();
    assert_eq!(played(&[began]), expected);
}

#[test]
fn what_had_not_arrived_at_the_end_never_does() {
    let steps = |played: Vec<Vec<u64>>| played.iter().filter(|s| !s.is_empty()).count();
    assert_eq!(steps(played(&[deviation(DeviationKind::Ended, 9, 5, 5)])), 5);
    assert_eq!(steps(played(&[deviation(DeviationKind::Ended, 9, 0, 0)])), 0);
}
