//! Published states, missed releases and the cost of a step, on one small service.

use core::cell::RefCell;
use proptest::prelude::*;
use runtime::{
    Component, Executor, Layout, MissPolicy, Node, Place, Rate, RestoreError, Service, Sink,
    Source, StateHeader, StateSink, StepStamps, inputs, outputs,
};
use shared_types::wire::Value as _;
use shared_types::{Header, Imu, LoopStats, PoseFix, Role, StateEstimate, WrenchCommand, topics};
use std::rc::Rc;

inputs! {
    /// Two inputs.
    pub struct Inputs { imu: Imu = topics::IMU, pose_fix: PoseFix = topics::POSE_FIX }
}
outputs! {
    /// One output.
    pub struct Outputs { state_estimate: StateEstimate = topics::STATE_ESTIMATE }
}
outputs! {
    /// The output of another service.
    pub struct OtherOutputs {
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        wrench_command: WrenchCommand = topics::WRENCH_COMMAND,
    }
}

shared_types::memory! {
    /// A sum.
    struct SumMemory {
        /// The sum.
        sum: f64,
        /// An array, so that order matters.
        last: [u64; 3],
    }
}

#[derive(Default)]
struct Sum(SumMemory);

impl Service for Sum {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = SumMemory;
    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        for imu in inputs.imu.fresh() {
            self.0.sum += imu.gyro_b_rad_s[0];
        }
        self.0.last = [now_ns, self.0.last[0], self.0.last[1]];
        let position_w_m = [self.0.sum; 3];
        outputs.state_estimate.write(StateEstimate { position_w_m, ..StateEstimate::default() });
    }
    fn memory(&self) -> SumMemory {
        self.0
    }
    fn restore(&mut self, memory: &SumMemory) -> Result<(), String> {
        if memory.sum < 0.0 {
            return Err("the sum is negative".into());
        }
        self.0 = *memory;
        Ok(())
    }
}

/// The same memory and inputs with another number of outputs.
#[derive(Default)]
struct Other(Sum);

impl Service for Other {
    type Inputs = Inputs;
    type Outputs = OtherOutputs;
    type Memory = SumMemory;
    fn step(&mut self, _: u64, _: &Inputs, _: &mut OtherOutputs) {}
    fn memory(&self) -> SumMemory {
        self.0.memory()
    }
    fn restore(&mut self, memory: &SumMemory) -> Result<(), String> {
        self.0.restore(memory)
    }
}

/// Makes up one sample per millisecond; that of `infinite_ns` makes the sum infinite.
struct Endless {
    next: u64,
    infinite_ns: u64,
    until_ns: Rc<RefCell<u64>>,
}

impl Source<Imu> for Endless {
    fn receive(&mut self) -> Option<Imu> {
        let valid_ns = self.next * 1_000_000;
        if valid_ns > *self.until_ns.borrow() {
            return None;
        }
        self.next += 1;
        let header = Header { sequence: self.next, valid_ns, ..Header::default() };
        let infinite = valid_ns == self.infinite_ns;
        let rate_rad_s = if infinite { f64::INFINITY } else { valid_ns as f64 * 0.1 };
        let gyro_b_rad_s = [rate_rad_s, 0.0, 0.0];
        let sample = Imu { header, gyro_b_rad_s, ..Imu::default() };
        Some(sample)
    }
}

/// Overwrites its last state, without allocating.
struct Last(Rc<RefCell<(Header, Vec<u8>)>>);

impl StateSink for Last {
    fn send(&mut self, header: &Header, state: &[u8]) {
        let mut last = self.0.borrow_mut();
        last.0 = *header;
        last.1.copy_from_slice(state);
    }
    fn serve_late_joiners(&mut self) {}
}

struct Nowhere;

impl Sink<StateEstimate> for Nowhere {
    fn send(&mut self, _: &StateEstimate) {}
    fn serve_late_joiners(&mut self) {}
}

#[derive(Clone, Default)]
struct StatsLog(Rc<RefCell<Vec<LoopStats>>>);

impl Sink<LoopStats> for StatsLog {
    fn send(&mut self, sample: &LoopStats) {
        self.0.borrow_mut().push(*sample);
    }
    fn serve_late_joiners(&mut self) {}
}

fn node(hz: f64, miss_policy: MissPolicy) -> Node {
    let rate = Rate::from_hz(hz).expect("a possible rate");
    Node { role: Role::Estimator, rate, lead_ns: 0, input_deadline_ns: 0, miss_policy }
}

struct Bench {
    executor: Executor,
    until_ns: Rc<RefCell<u64>>,
    last: Rc<RefCell<(Header, Vec<u8>)>>,
}

impl Bench {
    fn new(hz: f64, state_every: u64) -> Self {
        Self::infinite_from(u64::MAX, hz, state_every)
    }

    fn infinite_from(infinite_ns: u64, hz: f64, state_every: u64) -> Self {
        let component = Component::new(Sum::default(), state_every);
        let mut executor =
            Executor::new(component, node(hz, MissPolicy::CatchUp), Place::default());
        let until_ns = Rc::new(RefCell::new(0));
        let source = Endless { next: 0, infinite_ns, until_ns: Rc::clone(&until_ns) };
        executor
            .component
            .input(&topics::IMU)
            .expect("it reads that")
            .connect(Box::new(source), None);
        let output = executor.component.output(&topics::STATE_ESTIMATE);
        output.expect("it writes that").connect(Box::new(Nowhere), 0);
        let last =
            Rc::new(RefCell::new((Header::default(), vec![0; Layout::of::<Sum>().state_size()])));
        executor.connect_state(Box::new(Last(Rc::clone(&last))));
        Self { executor, until_ns, last }
    }

    fn step(&mut self) {
        *self.until_ns.borrow_mut() = self.executor.mark_ns();
        self.executor.component.receive();
        self.executor.run_step(StepStamps::UNTIMED);
    }

    fn state(&self) -> Vec<u8> {
        self.last.borrow().1.clone()
    }
}

proptest! {
    #[test]
    fn a_restored_service_goes_on_bit_for_bit(
        before in 1..60_u64, after in 1..60_u64, every in 1..7_u64, hz in 3.0..2000.0_f64,
    ) {
        let hz = hz.round();
        let mut first = Bench::new(hz, every);
        (0..before).for_each(|_| first.step());
        let mut second = Bench::new(hz, every);
        second.executor.take_up(&first.state()).unwrap();
        let keyframe = (before - 1) / every * every;
        prop_assert_eq!(second.executor.mark_ns(), first.executor.node().rate.release_ns(keyframe + 1));
        while second.executor.mark_ns() < first.executor.mark_ns() {
            second.step();
        }
        for _ in 0..after * every + (keyframe + every - before + 1) % every {
            first.step();
            second.step();
        }
        prop_assert_eq!(first.state(), second.state());
        prop_assert_eq!(first.last.borrow().0.sequence, second.last.borrow().0.sequence);
        prop_assert_eq!(first.executor.steps(), second.executor.steps());
    }

    #[test]
    fn cut_padded_or_foreign_states_are_refused_and_change_nothing(cut in 0..2000_usize, flip: u8) {
        let mut bench = Bench::new(1000.0, 1);
        bench.step();
        let good = bench.state();
        let expected = good.len();
        let mut fresh = Bench::new(1000.0, 1);
        let mut sized = good.clone();
        sized.resize(cut, 0);
        if cut != expected {
            prop_assert_eq!(
                fresh.executor.restore(&sized), Err(RestoreError::Size { actual: cut, expected }));
        }
        let mut foreign = good.clone();
        foreign[0] ^= flip | 1;
        let refused = matches!(fresh.executor.restore(&foreign), Err(RestoreError::Layout { .. }));
        prop_assert!(refused);
        prop_assert_eq!(fresh.executor.mark_ns(), 0);
        let imu = fresh.executor.component.input(&topics::IMU);
        prop_assert!(imu.expect("it reads that").latest().is_none());
    }
}

#[test]
fn another_service_refuses_the_state_and_names_both_layouts() {
    let mut bench = Bench::new(1000.0, 1);
    bench.step();
    let other = Component::new(Other::default(), 1);
    let mut other = Executor::new(other, node(1000.0, MissPolicy::Hold), Place::default());
    let error = other.restore(&bench.state()).unwrap_err();
    let (theirs, ours) = (Layout::of::<Sum>().hash(), Layout::of::<Other>().hash());
    assert_eq!(error, RestoreError::Layout { theirs, ours });
    let text = error.to_string();
    assert!(text.contains(&format!("{theirs:016x}")) && text.contains(&format!("{ours:016x}")));
}

#[test]
fn a_component_may_refuse_a_memory_and_gives_the_reason() {
    let mut bench = Bench::new(1000.0, 1);
    bench.step();
    let mut state = bench.state();
    let memory = state.len() - SumMemory::PACKED_SIZE;
    let mut refused = |sum: f64| {
        state[memory..memory + 8].copy_from_slice(&sum.to_le_bytes());
        Bench::new(1000.0, 1).executor.restore(&state).unwrap_err()
    };
    assert_eq!(refused(-1.0), RestoreError::Refused("the sum is negative".into()));
    // Of no service, whatever its memory would be.
    for sum in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(refused(sum), RestoreError::NotFinite);
    }
}

#[test]
fn a_state_of_the_last_release_there_is_is_refused() {
    let mut bench = Bench::new(1000.0, 1);
    bench.step();
    let mut state = bench.state();
    // The index follows the hash of the layout.
    state[8..16].copy_from_slice(&u64::MAX.to_le_bytes());
    let error = Bench::new(1000.0, 1).executor.restore(&state).unwrap_err();
    assert!(matches!(error, RestoreError::Refused(_)), "{error}");
}

#[test]
fn a_memory_that_is_not_finite_is_not_published() {
    let mut bench = Bench::infinite_from(5_000_000, 1000.0, 1);
    (0..5).for_each(|_| bench.step());
    let last = bench.last.borrow().clone();
    assert_eq!((last.0.release_ns, last.0.sequence), (4_000_000, 5));
    (0..5).for_each(|_| bench.step());
    assert_eq!(*bench.last.borrow(), last);
}

/// Takes every third state.
struct Thin(Rc<RefCell<Vec<(u64, u64)>>>);

impl StateSink for Thin {
    fn wants(&self, header: &Header) -> bool {
        header.sequence.is_multiple_of(3)
    }
    fn send(&mut self, header: &Header, state: &[u8]) {
        let head = StateHeader::of(state).expect("a state begins with its header");
        assert_eq!((head.state_sequence, head.release_ns), (header.sequence, header.release_ns));
        self.0.borrow_mut().push((header.sequence, header.release_ns));
    }
    fn serve_late_joiners(&mut self) {}
}

#[test]
fn states_that_no_reader_wants_are_numbered_and_not_sent() {
    let mut bench = Bench::new(1000.0, 2);
    let sent = Rc::default();
    bench.executor.connect_state(Box::new(Thin(Rc::clone(&sent))));
    (0..14).for_each(|_| bench.step());
    assert_eq!(*sent.borrow(), [(3, 4_000_000), (6, 10_000_000)]);
}

#[test]
fn loop_statistics_of_a_slow_loop_count_on_without_a_gap_after_a_restore() {
    let log = StatsLog::default();
    let mut first = Bench::new(3.0, 1);
    first.executor.stats.connect(Box::new(log.clone()), 0);
    (0..5).for_each(|_| first.step());
    let mut second = Bench::new(3.0, 1);
    second.executor.stats.connect(Box::new(log.clone()), 0);
    second.executor.restore(&first.state()).unwrap();
    (0..5).for_each(|_| second.step());
    let sequences: Vec<_> = log.0.borrow().iter().map(|s| s.header.sequence).collect();
    assert_eq!(sequences, (1..=10).collect::<Vec<_>>());
}

#[test]
fn each_miss_policy_does_what_it_promises() {
    // 150 Hz: releases at 0, 6.66, 13.33, 20, 26.66, 33.33 ms; the loop gets to run at 28 ms.
    let expected = [
        (MissPolicy::Skip, 26_666_666, 4, 0),
        (MissPolicy::Hold, 33_333_333, 5, 0),
        (MissPolicy::CatchUp, 0, 0, 1),
    ];
    for (policy, mark_ns, skipped, caught_up) in expected {
        let component = Component::new(Sum::default(), 1);
        let mut executor = Executor::new(component, node(150.0, policy), Place::default());
        let last =
            Rc::new(RefCell::new((Header::default(), vec![0; Layout::of::<Sum>().state_size()])));
        executor.connect_state(Box::new(Last(Rc::clone(&last))));
        executor.apply_miss_policy(6_666_665);
        assert_eq!(executor.mark_ns(), 0, "not late before the next release");
        executor.apply_miss_policy(28_000_000);
        assert_eq!(executor.mark_ns(), mark_ns, "{policy:?}");
        executor.run_step(StepStamps::UNTIMED);
        let header = StateHeader::unpack(&last.borrow().1[..StateHeader::PACKED_SIZE]);
        assert_eq!((header.skipped, header.caught_up), (skipped, caught_up), "{policy:?}");
    }
}

#[test]
fn a_source_that_works_ahead_is_never_late() {
    let node = Node { lead_ns: 1, ..node(100.0, MissPolicy::Hold) };
    let mut executor = Executor::new(Component::new(Sum::default(), 1), node, Place::default());
    executor.apply_miss_policy(1_000_000_000);
    assert_eq!(executor.mark_ns(), 0);
}

#[test]
fn a_step_allocates_nothing() {
    let mut bench = Bench::new(400.0, 1);
    (0..10).for_each(|_| bench.step());
    let info = allocation_counter::measure(|| (0..1_000).for_each(|_| bench.step()));
    assert_eq!((info.count_total, info.bytes_total), (0, 0));
}
