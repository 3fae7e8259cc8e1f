//! Logical time that follows the wall clock.
//!
//! `MORPHQUAD_REALTIME_S=60 cargo test --release --test realtime` flies for a minute.

mod common;

use common::{fly, turn};

#[test]
fn figure8_morph_follows_its_reference_in_realtime_and_the_recorder_loses_nothing() {
    let _turn = turn();
    let duration_s = std::env::var("MORPHQUAD_REALTIME_S").unwrap_or_else(|_| "6".to_owned());
    let duration = format!("{duration_s}s");
    let flown = fly(&["figure8-morph", "--clock", "realtime", "--for", &duration]);
    assert_eq!(flown.code, Some(0), "{}", flown.said());
    for key in ["dropped_samples", "constraint_violations", "recovered_crashes"] {
        assert!(flown.number(key) == 0.0, "{key}: {}", flown.said());
    }
    assert!(flown.number("position_rms_m") <= 0.05, "{}", flown.said());
    assert!(flown.number("position_max_m") <= 0.15, "{}", flown.said());
    assert!(flown.number("real_time_factor") <= 1.0, "{}", flown.said());
    assert!(flown.recording().count_messages_of_a_complete_file() > 1000);
    let misses = ["missed_ticks", "late_samples", "unseen_samples"].map(|key| flown.number(key));
    println!("{misses:?} missed, late, unseen; at most {} m away", flown.number("position_max_m"));
    // A machine that is busy with other things may miss; one that is not flies the lockstep flight.
    if misses.iter().all(|count| *count < 0.5) {
        let lockstep = fly(&["figure8-morph", "--for", &duration, "--no-record"]);
        assert_eq!(flown.hash(), lockstep.hash());
    }
}

#[test]
fn a_slow_realtime_flight_without_a_miss_has_the_hash_of_the_lockstep_flight() {
    let _turn = turn();
    let arguments = ["figure8-morph", "--for", "1500ms"];
    let lockstep = fly(&[&arguments[..], &["--no-record"]].concat());
    let slow = fly(&[&arguments[..], &["--clock", "realtime", "--speed", "0.2"]].concat());
    assert_eq!(slow.code, Some(0), "{}", slow.said());
    let misses = ["missed_ticks", "late_samples", "unseen_samples"].map(|key| slow.number(key));
    // A busy machine may miss even so.
    let missed = misses.iter().any(|count| *count > 0.5);
    assert!(missed || slow.hash() == lockstep.hash(), "{}", slow.said());
}

#[test]
fn time_can_run_faster_than_the_wall_clock_and_slower() {
    let _turn = turn();
    for (speed, fastest) in [("0.5", 0.5), ("3", 3.0)] {
        let flown = fly(&["hover", "--clock", "realtime", "--for", "1500ms", "--speed", speed]);
        assert_eq!(flown.code, Some(0), "{}", flown.said());
        assert!(flown.number("flown_s") >= 1.5, "{}", flown.said());
        assert!(flown.number("real_time_factor") <= fastest, "{}", flown.said());
        assert!(flown.number("position_max_m") <= 0.15, "{}", flown.said());
    }
}
