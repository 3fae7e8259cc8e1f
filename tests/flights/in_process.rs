//! `run --in-process`: the flight of the processes, in one.

use crate::common::processes::{Running, kill, left_in_shared_memory};
use crate::common::{Flown, fly, morphquad};
use rustix::process::Signal;
use serde_json::Value;

/// Parts of the summary that depend on the host.
const HOST: [&str; 3] = ["real_time_factor", "run", "recording"];

fn of_the_flight(flown: &Flown) -> serde_json::Map<String, Value> {
    let mut summary = flown.summary().as_object().expect("an object").clone();
    summary.retain(|key, _| !HOST.contains(&key.as_str()));
    summary
}

#[test]
fn every_shipped_scenario_has_the_same_summary_hash_and_recording_as_with_processes() {
    for name in scenario::shipped::names() {
        let flight = [name, "--for", "4s", "--seed", "3"];
        let processes = fly(&flight);
        let alone = fly(&[&flight[..], &["--in-process"]].concat());
        processes.assert_clean();
        assert_eq!(alone.hash(), processes.hash(), "{name}");
        assert_eq!(of_the_flight(&alone), of_the_flight(&processes), "{name}");
        let (one, six) = (alone.recording().contents(), processes.recording().contents());
        assert!(one.keys().eq(six.keys()), "{name}: other messages");
        for (key, message) in &one {
            assert!(six[key] == *message, "{name}: {key:?}");
        }
        assert!(one.keys().any(|(channel, ..)| channel == "/state/plant"));
        alone.recording().count_messages_of_a_complete_file();
    }
}

/// Each of the two comes while the other one's record is still to be written.
#[test]
fn two_slots_that_are_swapped_at_one_instant_receive_one_another() {
    let arguments = ["hover", "--for", "2s", "--no-record", "--set", "rehearsal.enabled=false"];
    let attitude = ["--swap", "attitude=attitude-pid@300ms,shadow=300ms,rollback=300ms"];
    let position = ["--swap", "position=position-pid@300ms,shadow=600ms,rollback=300ms"];
    let arguments = [&arguments[..], &attitude, &position].concat();
    let processes = fly(&arguments);
    processes.assert_flown("both swapped at once");
    assert_eq!(processes.summary()["safe_mode_episodes"], 0, "{}", processes.output_text());
    let alone = fly(&[&arguments[..], &["--in-process"]].concat());
    assert_eq!(alone.hash(), processes.hash());
}

/// Of the sensors that are off by default. The fixes of the tracker are lost for a while, so that they matter.
#[test]
fn heights_are_sensed_estimated_and_verified_in_processes_and_in_one() {
    let arguments =
        ["hover", "--for", "3s", "--set", "plant.pose_fix.drop_outs=[{from_s=1,until_s=2}]"];
    let sensors =
        ["--set", "plant.barometer.rate_hz=50", "--set", "plant.range_finder.rate_hz=100"];
    let arguments = [&arguments[..], &sensors].concat();
    let processes = fly(&arguments);
    processes.assert_flown("with heights");
    let alone = fly(&[&arguments[..], &["--in-process"]].concat());
    assert_eq!(alone.hash(), processes.hash());
    let recording = processes.recording();
    let count =
        |topic: &str| recording.contents().keys().filter(|(name, ..)| name == topic).count();
    assert_eq!((count("/barometer"), count("/range_finder")), (150, 300));
    let mut verify = morphquad(["replay"]);
    verify.arg(processes.recording_path()).arg("--verify");
    assert!(verify.output().expect("the executable starts").status.success());
    let without = fly(&[&arguments[..5], &["--no-record"]].concat());
    assert_ne!(without.hash(), processes.hash());
}

#[test]
fn nothing_is_left_or_made_in_shared_memory_and_without_a_recording_no_file() {
    let flown = fly(&["hover", "--for", "1s", "--in-process", "--no-record", "--pin", "0"]);
    flown.assert_clean();
    assert_eq!(left_in_shared_memory(flown.text("run")), Vec::<std::path::PathBuf>::new());
    assert_eq!(flown.summary()["recording"], Value::Null);
}

#[test]
fn an_interrupt_ends_it_in_order_and_the_flight_is_the_shorter_one() {
    let mut running = Running::start(&["hover", "--in-process", "--speed", "2", "--for", "60s"]);
    running.fly_on(0.5);
    assert!(kill(running.launcher_pid(), Signal::INT));
    let cut = running.wait();
    assert_eq!(cut.code, Some(130), "{}", cut.output_text());
    assert!(cut.number("flown_s") > 0.0 && cut.number("flown_s") < 60.0);
    cut.recording().count_messages_of_a_complete_file();
    cut.assert_is_the_shorter("hover");
}

#[test]
fn realtime_and_unknown_processors_are_refused_with_a_reason() {
    for (flags, named) in
        [(["--clock", "realtime"], "--clock lockstep --speed 1"), (["--pin", "4711"], "processor")]
    {
        let flown = fly(&[&["hover", "--in-process", "--no-record"], &flags[..]].concat());
        assert_eq!(flown.code, Some(2), "{}", flown.output_text());
        assert!(flown.output_text().contains(named), "{}", flown.output_text());
    }
}
