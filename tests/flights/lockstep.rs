//! Simulated time: one flight, one hash, whatever the machine is busy with.
//!
//! `MORPHQUAD_ROUNDS=200 cargo test --release --test flights one_hash -- --nocapture` flies
//! `hover` and `figure8-morph` 200 times each, every time in other conditions; `MORPHQUAD_SEED`
//! draws others. Without a number of rounds the flights are cut short, because the neighbours keep the machine from
//! the other tests.

use crate::common::{Flown, fly, fly_beside, rounds};
use observe::FlightHash;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use scenario::{Override, Scenario};
use simulate::in_process::{self, StateSource};
use std::collections::BTreeSet;
use std::process::{Child, Command};

/// How long the flights last unless a number of rounds is asked for \[s\].
const SHORT_S: u32 = 4;

/// Rounds after which a long series prints its progress.
const REPORTED_EVERY: usize = 10;

/// What must not make a difference, drawn by chance.
#[derive(Debug)]
struct Conditions {
    /// Priority of the whole run.
    nice: u8,
    /// Processor for all, and whether each process has its own order of starting, pause, processor
    /// and priority.
    flags: Vec<String>,
    /// Processes beside it that compute.
    neighbours: usize,
}

impl Conditions {
    fn draw(random: &mut ChaCha8Rng) -> Self {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let mut flags = Vec::new();
        if random.random_range(0..4) > 0 {
            flags.push(format!("--disorder={}", random.random_range(0..u64::MAX)));
        }
        flags.push(match random.random_range(0..processors + 2) {
            0 => "--pin=auto".to_owned(),
            1 => "--pin=none".to_owned(),
            other => format!("--pin={}", other - 2),
        });
        if random.random_range(0..2) == 0 {
            flags.push("--no-record".to_owned());
        }
        let nice = if random.random_range(0..2) == 0 { 0 } else { random.random_range(1..20) };
        Self { nice, flags, neighbours: random.random_range(0..=processors) }
    }

    fn fly(&self, flight: &[&str]) -> Flown {
        let neighbours = || -> Vec<_> { (0..self.neighbours).map(|_| Neighbour::busy()).collect() };
        let nice = self.nice.to_string();
        let flags = self.flags.iter().map(String::as_str);
        let arguments: Vec<&str> = flight.iter().copied().chain(flags).collect();
        fly_beside(neighbours, &["nice", "-n", &nice], &arguments)
    }
}

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

/// The hash of the same flight in one thread, without shared memory or processes.
fn hash_in_one_process(scenario: &str, duration: &[String]) -> String {
    let duration = duration.iter().map(|setting| Override::set(setting).expect("a setting"));
    let duration: Vec<_> = duration.collect();
    let scenario = Scenario::load(scenario, &duration).expect("a shipped scenario");
    let hash = in_process::fly(&scenario, StateSource::Estimator, FlightHash::default());
    hash.expect("a flight to its end").hex()
}

/// What came of it, in a sentence.
fn fly_in_random_conditions(scenario: &str) -> String {
    let is_short = std::env::var_os("MORPHQUAD_ROUNDS").is_none();
    let duration = is_short.then(|| format!("scenario.duration_s={SHORT_S}"));
    let expected = hash_in_one_process(scenario, duration.as_slice());
    let duration = duration.iter().flat_map(|setting| ["--set", setting.as_str()]);
    let flight: Vec<&str> = [scenario].into_iter().chain(duration).collect();
    let seed = std::env::var("MORPHQUAD_SEED").ok().and_then(|seed| seed.parse().ok());
    let mut random = ChaCha8Rng::seed_from_u64(seed.unwrap_or(1));
    let rounds = rounds(2);
    for round in 0..rounds {
        let conditions = Conditions::draw(&mut random);
        let flown = conditions.fly(&flight);
        flown.assert_clean();
        assert_eq!(flown.hash(), expected, "{scenario}, round {round}: {conditions:?}");
        let done = round + 1;
        if rounds > REPORTED_EVERY && done % REPORTED_EVERY == 0 {
            eprintln!("{scenario}: {done} of {rounds} disturbed runs, all with hash {expected}");
        }
    }
    format!(
        "{rounds} lockstep runs of {scenario}, all disturbed: hash {expected}, as in one process"
    )
}

#[test]
fn hover_has_one_hash_however_it_is_run() {
    println!("{}", fly_in_random_conditions("hover"));
}

#[test]
fn figure8_morph_has_one_hash_however_it_is_run() {
    println!("{}", fly_in_random_conditions("figure8-morph"));
}

#[test]
fn conditions_are_drawn_from_all_there_are() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let drawn: Vec<_> = (0..200).map(|_| Conditions::draw(&mut random)).collect();
    let flags = drawn.iter().flat_map(|c| &c.flags);
    let pins: BTreeSet<_> = flags.filter(|flag| flag.starts_with("--pin")).collect();
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    assert_eq!(pins.len(), processors + 2);
    let disorders: BTreeSet<_> = drawn.iter().filter_map(|c| c.flags.first()).collect();
    assert!(disorders.len() > 100);
    assert!((0..=processors).all(|n| drawn.iter().any(|c| c.neighbours == n)));
}

#[test]
fn another_seed_is_another_flight() {
    let hash = |seed| fly(&["hover", "--for", "1s", "--seed", seed]).hash().to_owned();
    assert_ne!(hash("1"), hash("2"));
    assert_eq!(hash("2"), hash("2"));
}

#[test]
fn pace_changes_no_byte() {
    let free = fly(&["figure8-morph", "--for", "2s"]);
    let paced = fly(&["figure8-morph", "--for", "2s", "--speed", "4"]);
    assert_eq!(free.hash(), paced.hash());
    assert!(paced.number("real_time_factor") < 4.4, "{}", paced.output_text());
}

fn assert_tracks(flown: &Flown, rms_m: f64, max_m: f64) {
    flown.assert_clean();
    assert!(flown.number("position_rms_m") <= rms_m, "{}", flown.output_text());
    assert!(flown.number("position_max_m") <= max_m, "{}", flown.output_text());
}

#[test]
fn figure8_morph_follows_its_reference_in_wind() {
    // One in processes, and two more with the same bits that no process takes part in.
    for (seed, how) in [("1", None), ("2", Some("--in-process")), ("3", Some("--in-process"))] {
        let flags: Vec<&str> = ["figure8-morph", "--seed", seed].into_iter().chain(how).collect();
        let flown = fly(&flags);
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
    let flown = fly(&["figure8-morph", "--in-process", "--set", "disturbance_injector.script=[]"]);
    assert_tracks(&flown, 0.05, 0.15);
    assert!(flown.number("position_last_second_m") <= 0.05, "{}", flown.output_text());
}

#[test]
fn no_shipped_scenario_violates_a_bound() {
    for name in scenario::shipped::names() {
        fly(&[name, "--in-process"]).assert_clean();
    }
}

#[test]
fn the_attitude_loop_flies_at_any_rate_and_the_position_loop_at_100_hz_too() {
    for rate in ["attitude-mpc=50", "attitude-mpc=150", "attitude-mpc=500", "position-mpc=100"] {
        let flown = fly(&["figure8-morph", "--in-process", "--rate", rate]);
        assert_tracks(&flown, 0.05, 0.15);
    }
}

/// They used to hang: sources had left before their readers had connected.
#[test]
fn the_shortest_flights_end() {
    for duration in ["1ms", "10ms", "20ms", "50ms", "100ms", "150ms"] {
        fly(&["hover", "--for", duration]).assert_clean();
    }
}

#[test]
fn a_flight_that_grants_no_grace_is_the_same_as_long_as_its_launcher_lives() {
    let hover = ["hover", "--for", "1s"];
    let without = ["--set", "launcher.launcher_grace_s=0"];
    assert_eq!(fly(&[&hover[..], &without].concat()).hash(), fly(&hover).hash());
}

#[test]
fn a_vehicle_that_ends_off_its_path_fails_the_run_although_no_process_crashed() {
    // Half the weight to the side, which no tilt within the bound holds.
    let push = "disturbance_injector.script=[{kind=\"constant\",load={force_w_n=[0.6,0.0,0.0]}}]";
    let flown = fly(&["hover", "--set", push]);
    assert_eq!(flown.code, Some(1), "{}", flown.output_text());
    let output_text = flown.output_text();
    assert_eq!(flown.verdict(), "LOST", "{output_text}");
    let how = flown.reason().strip_prefix("mean distance off its path in the last second ");
    let how = how.expect("how it was lost");
    let off_path_m: f64 = how.split(' ').next().and_then(|m| m.parse().ok()).expect("a distance");
    assert!(off_path_m > 1.0 && how.ends_with("m, limit 1 m"), "{output_text}");
}
