//! All components of a flight in one process and one thread, stepped in time order over plain
//! queues: no step allocates, and the flight is the one of the real processes, bit for bit.

mod common;
mod one_process;

use common::{fly, turn};
use core::time::Duration;
use launcher::scenario::{Override, Scenario};
use one_process::{Cockpit, Order};

/// Logical time in which buffers may still grow [ns].
const WARM_UP_NS: u64 = 500_000_000;

fn scenario(name: &str, duration_ms: u64, set: &[&str]) -> Scenario {
    let mut edits = vec![Override::duration(Duration::from_millis(duration_ms))];
    edits.extend(set.iter().map(|edit| Override::set(edit).expect("an edit")));
    Scenario::load(name, &edits).expect("a scenario that flies")
}

/// Flies on and asserts that nothing but the warm-up allocates.
fn assert_no_step_allocates(scenario: &Scenario) {
    let mut cockpit = Cockpit::new(scenario);
    cockpit.fly_until(WARM_UP_NS, Order::Time);
    let steps = cockpit.steps();
    for (role, allocations) in cockpit.fly_until(scenario.duration_ns(), Order::Time) {
        assert_eq!(allocations, 0, "{role} allocates");
    }
    let states = cockpit.states();
    assert!(cockpit.steps() - steps > 2 * 2000, "plant and estimator alone step more often");
    assert!(states.values().all(|states| *states > 0), "{states:?}");
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

#[test]
fn one_process_and_six_fly_the_same_flight_bit_for_bit() {
    let _turn = turn();
    for name in launcher::scenario::shipped::names() {
        let mut cockpit = Cockpit::new(&scenario(name, 4_000, &[]));
        cockpit.fly_until(u64::MAX, Order::Time);
        let flown = fly(&[name, "--for", "4s", "--no-record"]);
        flown.assert_clean();
        assert_eq!(cockpit.hash(), flown.hash(), "{name}");
    }
}

#[test]
fn the_recorded_positions_and_estimates_are_those_of_one_process() {
    let _turn = turn();
    let mut cockpit = Cockpit::new(&scenario("figure8-morph", 4_000, &[]));
    cockpit.fly_until(u64::MAX, Order::Time);
    let recording = fly(&["figure8-morph", "--for", "4s"]).recording();
    for topic in ["truth", "state_estimate"] {
        let recorded = recording.series(topic, &["position_w_m"]);
        let flown = cockpit.positions(topic);
        assert_eq!(recorded.len(), 4000);
        assert_eq!(recorded.len(), flown.len());
        for (index, (row, position)) in recorded.iter().zip(&flown).enumerate() {
            assert_eq!(row.values, position, "{topic} {index}");
        }
    }
}

#[test]
fn the_order_in_which_permitted_steps_run_changes_no_byte() {
    let flight = scenario("figure8-morph", 3_000, &["attitude_mpc.rate_hz=150"]);
    let hash = |order| {
        let mut cockpit = Cockpit::new(&flight);
        cockpit.fly_until(u64::MAX, order);
        cockpit.hash()
    };
    let expected = hash(Order::Time);
    for seed in 0..4 {
        assert_eq!(hash(Order::Random(seed)), expected, "seed {seed}");
    }
    assert_eq!(hash(Order::AsFarAsPossible), expected);
}
