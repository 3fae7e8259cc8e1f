//! All components of a flight in one process and one thread, stepped in time order over plain
//! queues: no step allocates, and the flight is the one of the real processes, bit for bit.

mod common;

use common::fly;
use core::time::Duration;
use observe::FlightHash;
use observe::Observer;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scenario::services::names_for;
use scenario::{Override, Scenario};
use shared_types::{Header, Role, Sample, Slot, StateEstimate, Topic, Truth};
use simulate::in_process::{InProcess, StateSource};
use std::any::Any;
use std::collections::BTreeMap;

/// Logical time in which buffers may still grow [ns].
const WARM_UP_NS: u64 = 500_000_000;

fn scenario(name: &str, duration_ms: u64, set: &[&str]) -> Scenario {
    let mut edits = vec![Override::duration(Duration::from_millis(duration_ms))];
    edits.extend(set.iter().map(|edit| Override::set(edit).expect("an edit")));
    Scenario::load(name, &edits).expect("a scenario that flies")
}

/// Which of the steps that may run does run.
#[derive(Debug, Clone, Copy)]
enum StepOrder {
    /// Any.
    Random(u64),
    /// One loop until it must wait, then the next, upstream last.
    AsFarAsPossible,
}

/// Positions by topic, in the order published.
#[derive(Default)]
struct Positions {
    truth: Vec<[f64; 3]>,
    state_estimate: Vec<[f64; 3]>,
}

impl Observer for Positions {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            self.truth.push(truth.position_w_m);
        } else if let Some(estimate) = any.downcast_ref::<StateEstimate>() {
            self.state_estimate.push(estimate.position_w_m);
        }
    }
}

/// Counts the states of each role, after hashing.
#[derive(Default)]
struct States {
    hash: FlightHash,
    count: BTreeMap<&'static str, u64>,
}

impl Observer for States {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.hash.observe(topic, sample);
    }
    fn wants_states(&self) -> bool {
        true
    }
    fn observe_state(&mut self, role: Role, _header: &Header, state: &[u8]) {
        assert!(!state.is_empty());
        *self.count.entry(role.label()).or_default() += 1;
    }
}

fn start<O: Observer>(scenario: &Scenario, observer: O) -> InProcess<O> {
    InProcess::new(scenario, StateSource::Estimator, observer).expect("a flight")
}

fn hash_of(mut flight: InProcess<FlightHash>) -> String {
    flight.fly_until(u64::MAX).expect("a flight to the end");
    flight.seen(|hash| hash.hex())
}

/// Flies on and asserts that nothing but the warm-up allocates.
fn assert_no_step_allocates(scenario: &Scenario) {
    let mut flight = start(scenario, States::default());
    flight.fly_until(WARM_UP_NS).expect("a flight");
    let mut steps = BTreeMap::<_, u64>::new();
    while let Some(next) = flight.runnable(u64::MAX).min_by_key(|&l| flight.mark_ns(l)) {
        let measured = allocation_counter::measure(|| flight.step(next));
        let role = flight.role(next).label();
        assert_eq!(measured.count_total, 0, "{role} allocates");
        *steps.entry(role).or_default() += 1;
    }
    assert!(steps.values().sum::<u64>() > 2 * 2000, "plant and estimator alone step more often");
    let publish: Vec<_> = flight.seen(|states| states.count.keys().copied().collect());
    assert!(publish.iter().eq(steps.keys()), "{publish:?} publish states");
}

#[test]
fn no_step_and_no_published_state_allocates_while_morphing_in_wind() {
    assert_no_step_allocates(&scenario("figure8-morph", 20_000, &[]));
}

#[test]
fn no_step_of_a_hover_with_every_kind_of_disturbance_allocates() {
    let script = "disturbance_injector.script=[\
        {kind=\"wind\",mean_w_m_s=[1.0,0.5,0.0],sigma_m_s=[0.5,0.5,0.25],length_m=[3.0,3.0,1.5]},\
        {kind=\"sine\",frequency_hz=1.0,load={force_w_n=[0.1,0.0,0.0]}},\
        {kind=\"rd\",at_s=1.0},\
        {kind=\"kick\",at_s=1.5,body_rate_b_rad_s=[0.1,0.0,0.0]},\
        {kind=\"rotor_efficiency\",at_s=2.0,rotor=2,efficiency=0.8}]";
    assert_no_step_allocates(&scenario("hover", 4_000, &[script]));
}

#[test]
fn no_step_of_a_rig_allocates_where_the_pilot_writes_the_set_points() {
    assert_no_step_allocates(&scenario("attitude-step", 3_000, &[]));
    assert_no_step_allocates(&scenario("disturbance", 3_000, &["attitude_mpc.rate_hz=150"]));
}

/// Those that fly if they are asked for.
fn other_controllers() -> impl Iterator<Item = (Slot, &'static str)> {
    Slot::ALL
        .into_iter()
        .flat_map(|slot| names_for(slot.role()).skip(1).map(move |name| (slot, name)))
}

#[test]
fn no_step_of_any_other_controller_allocates() {
    for (slot, name) in other_controllers() {
        let assignment = format!("controller.{}=\"{name}\"", slot.label());
        assert_no_step_allocates(&scenario("figure8-morph", 4_000, &[&assignment]));
    }
}

#[test]
fn one_process_and_six_fly_the_same_flight_bit_for_bit() {
    for name in scenario::shipped::names() {
        let hash = hash_of(start(&scenario(name, 4_000, &[]), FlightHash::default()));
        let flown = fly(&[name, "--for", "4s", "--no-record"]);
        flown.assert_clean();
        assert_eq!(hash, flown.hash(), "{name}");
    }
}

#[test]
fn other_controllers_fly_the_same_flight_in_one_process_and_in_six() {
    let assignment = ["controller.attitude=attitude-lqr", "controller.position=position-pid"];
    let hash =
        hash_of(start(&scenario("figure8-morph", 4_000, &assignment), FlightHash::default()));
    let assignment = "attitude=attitude-lqr,position=position-pid";
    let flown = fly(&["figure8-morph", "--for", "4s", "--no-record", "--controller", assignment]);
    flown.assert_clean();
    assert_eq!(hash, flown.hash());
}

#[test]
fn the_recorded_positions_and_estimates_are_those_of_one_process() {
    let mut flight = start(&scenario("figure8-morph", 4_000, &[]), Positions::default());
    flight.fly_until(u64::MAX).expect("a flight to the end");
    let positions = flight.seen(core::mem::take);
    let recording = fly(&["figure8-morph", "--for", "4s"]).recording();
    for (topic, flown) in
        [("truth", &positions.truth), ("state_estimate", &positions.state_estimate)]
    {
        let recorded = recording.series(topic, &["position_w_m"]);
        assert_eq!(recorded.len(), 4000);
        assert_eq!(recorded.len(), flown.len());
        for (index, (row, position)) in recorded.iter().zip(flown).enumerate() {
            assert_eq!(row.values, position, "{topic} {index}");
        }
    }
}

#[test]
fn the_order_in_which_permitted_steps_run_changes_no_byte() {
    let scenario = scenario("figure8-morph", 3_000, &["attitude_mpc.rate_hz=150"]);
    let expected = hash_of(start(&scenario, FlightHash::default()));
    for order in [0, 1, 2, 3].map(StepOrder::Random).into_iter().chain([StepOrder::AsFarAsPossible])
    {
        let mut flight = start(&scenario, FlightHash::default());
        fly_in(&mut flight, order);
        assert_eq!(hash_of(flight), expected, "{order:?}");
    }
}

/// Flies to the end in an order of its own.
fn fly_in(flight: &mut InProcess<FlightHash>, order: StepOrder) {
    let mut rng =
        ChaCha8Rng::seed_from_u64(if let StepOrder::Random(seed) = order { seed } else { 0 });
    let mut last = 0;
    loop {
        let runnable: Vec<_> = flight.runnable(u64::MAX).collect();
        let Some(&upstream) = runnable.last() else { return };
        last = match order {
            StepOrder::Random(_) => runnable[rng.random_range(0..runnable.len())],
            StepOrder::AsFarAsPossible if runnable.contains(&last) => last,
            StepOrder::AsFarAsPossible => upstream,
        };
        flight.step(last);
    }
}

#[test]
fn with_the_truth_as_state_every_estimate_is_the_truth_of_its_instant() {
    let scenario = scenario("figure8-morph", 3_000, &[]);
    let mut flight =
        InProcess::new(&scenario, StateSource::Truth, Positions::default()).expect("a flight");
    flight.fly_until(u64::MAX).expect("a flight to the end");
    let positions = flight.seen(core::mem::take);
    assert_eq!(positions.truth.len(), 3000);
    assert_eq!(positions.truth, positions.state_estimate);
}
