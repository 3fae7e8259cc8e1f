//! What a step reports about inputs that were not what edges and time prescribe.

use core::cell::RefCell;
use runtime::executor::StepStamps;
use runtime::graph::Edge;
use runtime::ownership::SlotBook;
use runtime::{
    Component, Executor, MissPolicy, Node, Place, Rate, Service, Sink, Source, inputs, outputs,
};
use shared_types::{
    Deviation, DeviationKind, Header, Imu, OwnerRecord, PoseFix, Role, Sample, StateEstimate,
    topics,
};
use std::collections::VecDeque;
use std::rc::Rc;

inputs! {
    /// Two inputs.
    pub struct Inputs {
        /// One per step.
        imu: Imu = topics::IMU,
        /// Seldom.
        pose_fix: PoseFix = topics::POSE_FIX,
    }
}

outputs! {
    /// Never written.
    pub struct Outputs {
        /// Declared because a service needs an output.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
    }
}

shared_types::memory! {
    /// Only a step count.
    struct Memory {
        steps: u64,
    }
}

#[derive(Default)]
struct Idle(u64);

impl Service for Idle {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = Memory;
    fn step(&mut self, _now_ns: u64, _inputs: &Inputs, _outputs: &mut Outputs) {
        self.0 += 1;
    }
    fn memory(&self) -> Memory {
        Memory { steps: self.0 }
    }
    fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        self.0 = memory.steps;
        Ok(())
    }
}

/// Samples on their way.
type Wire<T> = Rc<RefCell<VecDeque<T>>>;

struct Queue<T>(Wire<T>);

impl<T: Sample> Source<T> for Queue<T> {
    fn receive(&mut self) -> Option<T> {
        self.0.borrow_mut().pop_front()
    }
}

#[derive(Clone, Default)]
struct Log(Rc<RefCell<Vec<Deviation>>>);

impl Sink<Deviation> for Log {
    fn send(&mut self, sample: &Deviation) {
        self.0.borrow_mut().push(*sample);
    }
    fn serve_late_joiners(&mut self) {}
}

const MS: u64 = 1_000_000;

struct Bench {
    executor: Executor,
    imu: Wire<Imu>,
    log: Log,
}

impl Bench {
    fn new(miss_policy: MissPolicy, generation: u32) -> Self {
        let rate = Rate::from_hz(1000.0).expect("a possible rate");
        let role = Role::Estimator;
        let node = Node { role, rate, lead_ns: 0, input_deadline_ns: 0, miss_policy };
        let component = Component::new(Idle::default(), 1);
        let mut executor = Executor::new(component, node, Place { seat: 0, generation });
        let (imu, log) = (Wire::default(), Log::default());
        let input = executor.component.input(&topics::IMU).expect("it reads that");
        input.connect(Box::new(Queue(Rc::clone(&imu))), None);
        executor.deviations.connect(Box::new(log.clone()), 0);
        Self { executor, imu, log }
    }

    /// A sample in effect at its millisecond, with the sequence that follows from it.
    fn arrives(&self, sequence: u64) {
        self.publish((0, 0), sequence, sequence - 1);
    }

    /// A sample of the process on a seat, with its generation there, in effect at a millisecond.
    fn publish(&self, (seat, generation): (u32, u32), sequence: u64, instant_ms: u64) {
        let instant_ns = instant_ms * MS;
        let header = Header {
            seat,
            generation,
            sequence,
            release_ns: instant_ns,
            valid_ns: instant_ns,
            ..Header::default()
        };
        self.imu.borrow_mut().push_back(Imu { header, ..Imu::default() });
    }

    /// Connects the input to an edge on which each producer numbers its own samples.
    fn comes_from_a_slot(&mut self) {
        let edge = Edge::unwaited(&topics::WRENCH_COMMAND.info, Role::Estimator);
        let input = self.executor.component.input(&topics::IMU).expect("it reads that");
        input.connect(Box::new(Queue(Rc::clone(&self.imu))), Some(edge));
    }

    fn step(&mut self) -> Vec<(DeviationKind, u64, u64)> {
        self.executor.component.receive();
        self.executor.run_step(StepStamps::UNTIMED);
        self.take_deviations().iter().map(|d| (d.kind, d.first, d.last)).collect()
    }

    fn take_deviations(&self) -> Vec<Deviation> {
        core::mem::take(&mut *self.log.0.borrow_mut())
    }
}

#[test]
fn a_step_that_saw_what_it_should_reports_nothing() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    for sequence in 1..20 {
        bench.arrives(sequence);
        assert_eq!(bench.step(), []);
    }
}

#[test]
fn late_and_lost_samples_are_reported_by_number_at_the_step_without_them() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    bench.arrives(1);
    bench.step();
    assert_eq!(bench.step(), [], "what has not arrived cannot be reported yet");
    assert_eq!(bench.step(), []);
    // 2 and 3 were due at 1 and 2 ms, 4 is in time.
    (2..=4).for_each(|sequence| bench.arrives(sequence));
    assert_eq!(bench.step(), [(DeviationKind::LateSamples, 2, 3)]);
    bench.arrives(8);
    (0..3).for_each(|_| assert_eq!(bench.step(), []));
    bench.executor.component.receive();
    bench.executor.run_step(StepStamps::UNTIMED);
    let deviations = bench.take_deviations();
    assert_eq!(
        (deviations[0].kind, deviations[0].first, deviations[0].last),
        (DeviationKind::LostSamples, 5, 7)
    );
    assert_eq!(deviations[0].input_name(), "imu");
    assert_eq!(deviations[0].header.release_ns, 7 * MS);
    assert_eq!(
        (deviations[0].role, deviations[0].header.seat),
        (Role::Estimator, Role::Estimator.0)
    );
    let counts = bench.executor.component.counts();
    assert_eq!((counts.late, counts.lost), (2, 3));
}

#[test]
fn a_late_sample_is_reported_with_the_instant_at_which_it_was_due() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    (0..5).for_each(|_| drop(bench.step()));
    bench.arrives(3);
    bench.executor.component.receive();
    bench.executor.run_step(StepStamps::UNTIMED);
    let deviations = bench.take_deviations();
    let late = deviations.iter().find(|d| d.kind == DeviationKind::LateSamples);
    assert_eq!(late.map(|d| (d.due_ns, d.header.release_ns)), Some((2 * MS, 5 * MS)));
}

#[test]
fn late_samples_of_owner_fallback_and_successor_are_reported_by_their_own_numbers() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    bench.comes_from_a_slot();
    bench.publish((0, 0), 79, 0);
    bench.publish((1, 0), 9, 0);
    (0..4).for_each(|_| drop(bench.step()));
    // Both seats are late with two; then another process has taken the second, and counts anew.
    for instant_ms in [1, 2] {
        bench.publish((0, 0), 79 + instant_ms, instant_ms);
        bench.publish((1, 0), 9 + instant_ms, instant_ms);
    }
    bench.publish((1, 1), 500, 3);
    bench.executor.component.receive();
    bench.executor.run_step(StepStamps::UNTIMED);
    let mut late: Vec<_> = bench
        .take_deviations()
        .iter()
        .filter(|d| d.kind == DeviationKind::LateSamples)
        .map(|d| ((d.writer_seat, d.writer_generation), d.first, d.last, d.due_ns / MS))
        .collect();
    late.sort_unstable();
    assert_eq!(late, [((0, 0), 80, 81, 1), ((1, 0), 10, 11, 1), ((1, 1), 500, 500, 3)]);
    assert_eq!(bench.executor.component.counts().late, 5);
}

#[test]
fn late_and_lost_samples_of_a_producer_without_a_slot_are_one_range() {
    let ranges = |repeated_by: u32| {
        let mut bench = Bench::new(MissPolicy::CatchUp, 0);
        bench.publish((0, 0), 1, 0);
        (0..5).for_each(|_| drop(bench.step()));
        bench.publish((0, repeated_by), 4, 3);
        bench.publish((0, 1), 5, 4);
        bench.executor.component.receive();
        bench.executor.run_step(StepStamps::UNTIMED);
        bench.executor.finish();
        let deviations = bench.take_deviations();
        deviations
            .iter()
            .map(|d| (d.kind, d.first, d.last, d.writer_generation))
            .collect::<Vec<_>>()
    };
    let expected = [
        (DeviationKind::LostSamples, 2, 3, 0),
        (DeviationKind::LateSamples, 4, 5, 0),
        (DeviationKind::Ended, 5, 5, 0),
        // Its other input never received a sample.
        (DeviationKind::Ended, 0, 0, 0),
    ];
    assert_eq!(ranges(0), expected);
    assert_eq!(ranges(1), expected);
}

#[test]
fn a_loop_that_joins_in_flight_reports_the_first_sample_of_each_writer() {
    let began = |bench: &mut Bench| {
        let mut deviations = bench.step();
        deviations.retain(|(kind, ..)| *kind == DeviationKind::Began);
        deviations.iter().map(|(_, first, _)| *first).collect::<Vec<_>>()
    };
    // A sample in effect at 4 ms is known before the first step, and does not show what came before it.
    for (sequence, valid_ms, first) in [(7, 5, 7), (1, 5, 1), (7, 4, 0)] {
        let mut joins = Bench::new(MissPolicy::CatchUp, 0);
        joins.comes_from_a_slot();
        joins.executor.join_at(5 * MS, 0);
        joins.publish((0, 0), sequence, valid_ms);
        assert_eq!(began(&mut joins), [first], "it has joined in flight");
        joins.publish((1, 0), 30, 6);
        assert_eq!(began(&mut joins), [30], "it comes later");
        joins.publish((1, 1), 40, 7);
        assert_eq!(began(&mut joins), [40], "another process follows on the seat");
        joins.publish((1, 2), 41, 8);
        assert_eq!(began(&mut joins), [41], "the numbers go on");
    }
    let mut begins = Bench::new(MissPolicy::CatchUp, 0);
    begins.comes_from_a_slot();
    begins.publish((1, 0), 7, 0);
    assert_eq!(began(&mut begins), [0; 0], "it was there from the start");
}

#[test]
fn what_a_seat_publishes_while_it_does_not_count_is_not_missing_afterwards() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    bench.comes_from_a_slot();
    let mut book = SlotBook::default();
    // The first seat owns the slot; its fallback is the second, the third, and the second again.
    for (epoch, fallback, from_ms) in [(1, 1, 0), (2, 2, 3), (3, 1, 6)] {
        let header = Header { valid_ns: from_ms * MS, ..Header::default() };
        let record = OwnerRecord { header, epoch, owner: 0, fallback, ..OwnerRecord::default() };
        book.learn(&record);
    }
    let input = bench.executor.component.input(&topics::IMU).expect("it reads that");
    input.learn_owners(topics::WRENCH_COMMAND.info.from, &book, None);
    // What it published meanwhile arrived, or did not, by chance.
    for (sequence, instant_ms) in [(1, 0), (2, 1), (3, 2), (5, 4), (7, 6), (8, 7)] {
        bench.publish((1, 0), sequence, instant_ms);
    }
    let mut lost = Vec::new();
    let mut step = |bench: &mut Bench| {
        bench.executor.component.receive();
        bench.executor.run_step(StepStamps::UNTIMED);
        let deviations =
            bench.take_deviations().into_iter().filter(|d| d.kind == DeviationKind::LostSamples);
        lost.extend(deviations.map(|d| (d.first, d.last, d.due_ns / MS)));
    };
    (0..8).for_each(|_| step(&mut bench));
    bench.publish((1, 0), 11, 8);
    step(&mut bench);
    // The first gap is reported for a replay, with the instant from which the seat counts again;
    // the second one is a loss.
    assert_eq!(lost, [(4, 6, 6), (9, 10, 0)]);
    assert_eq!(bench.executor.component.counts().lost, 2);
}

#[test]
fn what_comes_late_together_with_the_record_that_ends_its_seat_is_late() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    bench.comes_from_a_slot();
    let mut book = SlotBook::default();
    let mut learn = |bench: &mut Bench, epoch, owner, from_ms: u64, previous_ns| {
        let header = Header { valid_ns: from_ms * MS, ..Header::default() };
        let record = OwnerRecord { header, epoch, owner, fallback: 2, ..OwnerRecord::default() };
        book.learn(&record);
        let input = bench.executor.component.input(&topics::IMU).expect("it reads that");
        input.learn_owners(topics::WRENCH_COMMAND.info.from, &book, previous_ns);
    };
    let step = |bench: &mut Bench| {
        bench.executor.component.receive();
        bench.executor.run_step(StepStamps::UNTIMED);
        let late =
            bench.take_deviations().into_iter().filter(|d| d.kind == DeviationKind::LateSamples);
        let of = |d: Deviation| (d.writer_seat, d.first, d.last, d.due_ns / MS);
        late.map(of).collect::<Vec<_>>()
    };
    learn(&mut bench, 1, 1, 0, None);
    bench.publish((1, 0), 1, 0);
    assert_eq!(step(&mut bench), []);
    assert_eq!(step(&mut bench), []);
    assert_eq!(step(&mut bench), []);
    // At 1 ms it counted, at 2 ms not any more; had they been punctual, a step would have had both. Those of a seat that
    // never counted are of no interest.
    learn(&mut bench, 2, 0, 2, Some(2 * MS));
    for (seat, sequence, valid_ms) in [(1, 2, 1), (1, 3, 2), (1, 4, 2), (3, 9, 2)] {
        bench.publish((seat, 0), sequence, valid_ms);
    }
    assert_eq!(step(&mut bench), [(1, 2, 2, 1), (1, 3, 4, 2)]);
    assert_eq!(bench.executor.component.counts().late, 3);
    // One step later it still is what the step at 2 ms would have taken in.
    bench.publish((1, 0), 5, 2);
    assert_eq!(step(&mut bench), [(1, 5, 5, 2)]);
    // After another change it is the same: what counts is what the step at 2 ms knew. What is due later was known not to
    // count.
    learn(&mut bench, 3, 3, 5, Some(4 * MS));
    bench.publish((1, 0), 6, 2);
    bench.publish((1, 0), 7, 3);
    bench.publish((3, 0), 10, 2);
    assert_eq!(step(&mut bench), [(1, 6, 6, 2)]);
}

#[test]
fn the_last_sample_of_a_writer_is_reported_when_another_process_has_its_seat() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    bench.comes_from_a_slot();
    bench.publish((1, 0), 7, 0);
    assert_eq!(bench.step(), []);
    // It repeats a number that its predecessor may already have sent to others, or continues after it.
    for (generation, sequence) in [(1, 8), (2, 9)] {
        bench.publish((1, generation), sequence, sequence - 7);
        let deviations = bench.step();
        let ended: Vec<_> =
            deviations.iter().filter(|(k, ..)| *k == DeviationKind::Ended).collect();
        assert_eq!(ended.len(), 1, "{deviations:?}");
        assert_eq!(ended[0].1, sequence - 1);
    }
}

#[test]
fn what_happens_to_the_loop_is_reported_with_the_next_step_and_can_be_repeated() {
    let edge = Edge::unwaited(&topics::IMU.info, Role::Estimator);
    for policy in [MissPolicy::Skip, MissPolicy::Hold, MissPolicy::CatchUp] {
        let mut bench = Bench::new(policy, 0);
        bench.step();
        bench.executor.count_input_deadline_miss([edge, edge].iter());
        bench.executor.count_input_deadline_miss([edge].iter());
        bench.executor.apply_miss_policy(9 * MS + 5);
        bench.executor.run_step(StepStamps::UNTIMED);
        let deviations = bench.take_deviations();
        let kinds: Vec<_> = deviations.iter().map(|d| (d.kind, d.first, d.last)).collect();
        let loops = match policy {
            MissPolicy::Skip => (DeviationKind::SkippedReleases, 1, 8),
            MissPolicy::Hold => (DeviationKind::SkippedReleases, 1, 9),
            MissPolicy::CatchUp => (DeviationKind::CaughtUp, 1, 1),
        };
        assert_eq!(kinds, [(DeviationKind::MissedDeadline, 2, 2), loops], "{policy:?}");

        let mut again = Bench::new(policy, 0);
        again.step();
        for deviation in &deviations {
            again.executor.repeat(deviation);
        }
        assert_eq!(again.step(), kinds, "{policy:?}");
        assert_eq!(again.executor.mark_ns(), bench.executor.mark_ns(), "{policy:?}");
    }
}

#[test]
fn each_life_of_a_process_numbers_its_deviations_for_itself() {
    let mut first = Bench::new(MissPolicy::CatchUp, 0);
    first.arrives(1);
    first.step();
    let layout = *first.executor.component.layout();
    let mut state = vec![0; layout.state_size()];
    let header = runtime::StateHeader {
        layout_hash: layout.hash(),
        release_index: 4,
        ..runtime::StateHeader::default()
    };
    first.executor.component.pack(&header, &mut state);
    let mut second = Bench::new(MissPolicy::CatchUp, 3);
    second.executor.restore(&state).unwrap();
    second.executor.run_step(StepStamps::UNTIMED);
    let deviations = second.take_deviations();
    assert_eq!((deviations[0].kind, deviations[0].first), (DeviationKind::Resumed, 4));
    assert_eq!(
        (deviations[0].header.sequence, deviations[0].header.seat),
        (1, 32 * 3 + Role::Estimator.0)
    );
    assert_eq!(
        (deviations[1].kind, deviations[1].first, deviations.len()),
        (DeviationKind::Began, 0, 2)
    );
    assert_eq!(deviations[1].header.sequence, 2);
}

#[test]
fn names_of_all_topics_fit_into_a_deviation() {
    for topic in topics::all() {
        let deviation =
            Deviation { input: Deviation::input_from(topic.name), ..Deviation::default() };
        assert_eq!(deviation.input_name(), topic.name);
    }
}

#[test]
fn at_the_end_each_input_reports_how_far_it_has_got() {
    let mut bench = Bench::new(MissPolicy::CatchUp, 0);
    for sequence in 1..=3 {
        bench.arrives(sequence);
        bench.step();
    }
    // Arrived, and not in effect any more.
    bench.arrives(4);
    bench.executor.finish();
    let deviations = bench.take_deviations();
    let kinds: Vec<_> = deviations.iter().map(|d| (d.kind, d.input_name(), d.last)).collect();
    assert_eq!(kinds, [(DeviationKind::Ended, "imu", 3), (DeviationKind::Ended, "pose_fix", 0)]);
}
