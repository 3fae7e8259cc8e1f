//! Simulated time: one flight, one hash, whatever the machine is busy with.
//!
//! `MORPHQUAD_ROUNDS=20 cargo test --release --test lockstep` flies every scenario 20 times.

mod common;

use common::{Flown, fly, fly_with, rounds, turn};
use std::process::{Child, Command};

/// What must not make a difference: a command to go through, flags, a neighbour that computes.
const CONDITIONS: [(&[&str], &[&str], bool); 7] = [
    (&[], &[], false),
    (&[], &["--pin", "none"], false),
    (&[], &["--pin", "0"], false),
    (&[], &["--pin", "1"], true),
    (&["nice", "-n", "10"], &[], true),
    (&[], &["--no-record"], false),
    (&[], &["--pin", "none", "--no-record"], true),
];

/// A process that keeps one core busy until dropped.
struct Neighbour(Child);

impl Neighbour {
    fn busy() -> Self {
        let shell = Command::new("sh").args(["-c", "while :; do :; done"]).spawn();
        Self(shell.expect("a shell"))
    }
}

impl Drop for Neighbour {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn fly_in_every_condition(scenario: &str) {
    let _turn = turn();
    let mut hashes = Vec::new();
    let rounds = rounds(CONDITIONS.len());
    for round in 0..rounds {
        let (through, flags, crowded) = CONDITIONS[round % CONDITIONS.len()];
        let _neighbour = crowded.then(Neighbour::busy);
        let flown = fly_with(through, &[&[scenario], flags].concat());
        flown.assert_clean();
        hashes.push(flown.hash().to_owned());
    }
    hashes.dedup();
    assert_eq!(hashes.len(), 1, "{scenario}: {hashes:?}");
}

#[test]
fn hover_has_one_hash_however_it_is_run() {
    fly_in_every_condition("hover");
}

#[test]
fn figure8_morph_has_one_hash_however_it_is_run() {
    fly_in_every_condition("figure8-morph");
}

#[test]
fn another_seed_is_another_flight() {
    let _turn = turn();
    let hash = |seed| fly(&["hover", "--for", "1s", "--seed", seed]).hash().to_owned();
    assert_ne!(hash("1"), hash("2"));
    assert_eq!(hash("2"), hash("2"));
}

#[test]
fn pace_changes_no_byte() {
    let _turn = turn();
    let free = fly(&["figure8-morph", "--for", "2s"]);
    let paced = fly(&["figure8-morph", "--for", "2s", "--speed", "4"]);
    assert_eq!(free.hash(), paced.hash());
    assert!(paced.number("real_time_factor") < 4.4, "{}", paced.said());
}

fn assert_tracks(flown: &Flown, rms_m: f64, max_m: f64) {
    flown.assert_clean();
    assert!(flown.number("position_rms_m") <= rms_m, "{}", flown.said());
    assert!(flown.number("position_max_m") <= max_m, "{}", flown.said());
}

#[test]
fn figure8_morph_follows_its_reference_in_wind() {
    let _turn = turn();
    for seed in ["1", "2", "3"] {
        let flown = fly(&["figure8-morph", "--seed", seed]);
        assert_tracks(&flown, 0.05, 0.15);
        assert!(flown.number("flown_s") >= 20.0);
        // Every tick of the plant alone gives imu, truth, applied command and actuator state.
        let messages = flown.recording().count_messages_of_a_complete_file();
        assert!(messages as f64 >= flown.number("recorded_samples"));
        assert!(messages > 4 * 20_000);
    }
}

#[test]
fn figure8_morph_ends_where_it_should_in_calm_air() {
    let _turn = turn();
    let flown = fly(&["figure8-morph", "--set", "disturbance_injector.script=[]"]);
    assert_tracks(&flown, 0.05, 0.15);
    assert!(flown.number("position_last_second_m") <= 0.05, "{}", flown.said());
}

#[test]
fn no_shipped_scenario_violates_a_bound() {
    let _turn = turn();
    for name in launcher::scenario::shipped::names() {
        fly(&[name]).assert_clean();
    }
}

#[test]
fn the_attitude_loop_flies_at_any_rate_and_the_position_loop_at_100_hz_too() {
    let _turn = turn();
    for rate in ["attitude-mpc=50", "attitude-mpc=150", "attitude-mpc=500", "position-mpc=100"] {
        let flown = fly(&["figure8-morph", "--rate", rate]);
        assert_tracks(&flown, 0.05, 0.15);
    }
}

/// They used to hang: sources had left before their readers had connected.
#[test]
fn the_shortest_flights_end() {
    let _turn = turn();
    for duration in ["1ms", "10ms", "20ms", "50ms", "100ms", "150ms"] {
        fly(&["hover", "--for", duration]).assert_clean();
    }
}

#[test]
fn a_vehicle_that_ends_off_its_path_fails_the_run_although_no_process_crashed() {
    let _turn = turn();
    // Seven estimates a second cannot hold a vehicle.
    let flown = fly(&["hover", "--rate", "estimator=7"]);
    assert_eq!(flown.code, Some(1), "{}", flown.said());
    assert!(flown.said().contains("vehicle lost"), "{}", flown.said());
}
