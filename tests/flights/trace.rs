//! From a recording alone every wrench command leads back to its IMU sample, in both clocks and through
//! swaps, and the chain that is reported is the one in the headers of the file.

use crate::common::{Flown, fly, morphquad};
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Exit code and JSON of `morphquad trace`.
fn trace(file: &Path, arguments: &[&str]) -> (Option<i32>, Value) {
    let mut command = morphquad(["trace"]);
    let output = command.arg(file).args(arguments).args(["--format", "json"]).output();
    let output = output.expect("the executable starts");
    (output.status.code(), serde_json::from_slice(&output.stdout).unwrap_or(Value::Null))
}

/// Every command leads back to its IMU sample.
pub(super) fn assert_all_trace(flown: &Flown, clock: &str) -> Value {
    flown.assert_flown(clock);
    let (code, json) = trace(&flown.recording_path(), &[]);
    assert_eq!(code, Some(0), "{json}");
    let sent = flown.recording().series("wrench_command", &["thrust_n"]).len() as u64;
    // A machine that stands still makes a loop leave releases out, and what it sent must trace all the same.
    let least = if clock == "lockstep" { 100 } else { 10 };
    assert!(sent > least, "{sent}");
    assert_eq!((json["commands"].as_u64(), json["traced"].as_u64()), (Some(sent), Some(sent)));
    let latency = &json["segments"]["sensor_to_command"];
    assert_eq!(latency["n"].as_u64(), Some(sent), "{json}");
    json
}

#[test]
fn commands_of_shadows_and_of_the_controller_that_takes_over_trace_too() {
    let swap =
        ["hover", "--for", "4s", "--swap", "attitude=attitude-lqr@1s,shadow=1s,rollback=0.5s"];
    for clock in ["lockstep", "realtime"] {
        let flown =
            fly(&[&swap[..], &["--clock", clock, "--standby", "position=position-pid"]].concat());
        let json = assert_all_trace(&flown, clock);
        let applied = json["applied"].as_u64().expect("a count");
        assert!(applied > 0, "{json}");
        // By the wall clock the candidate may join too late to publish anything.
        let commands = json["commands"].as_u64().expect("a count");
        assert!(applied < commands || clock == "realtime", "{json}");
    }
}

#[test]
fn a_chain_consists_of_the_samples_that_the_file_has() {
    let flown = fly(&["figure8-morph", "--for", "2s", "--clock", "realtime", "--speed", "0.5"]);
    let recording = flown.recording();
    // On a busy machine a command may be superseded before it takes effect.
    let applied = recording.series("applied_command", &["command_sequence"]);
    let number = applied.iter().map(|row| row.values[0]).find(|number| *number >= 10.0);
    let number = number.expect("the tenth command or a later one was applied");
    let (code, json) = trace(&flown.recording_path(), &["--command", &number.to_string()]);
    assert_eq!(code, Some(0), "{json}");
    let command = &json["commands"][0];
    let mut links = command["chain"].as_array().expect("a chain").iter().rev();
    let (tick, wrench, estimate, imu) = (
        links.next().unwrap(),
        links.next().unwrap(),
        links.next().unwrap(),
        links.next().unwrap(),
    );
    let names = [imu, estimate, wrench, tick].map(|link| link["topic"].as_str().expect("a name"));
    assert_eq!(names, ["imu", "state_estimate", "wrench_command", "applied_command"]);
    assert_eq!(wrench["sequence"].as_f64(), Some(number));
    assert_eq!(wrench["input_sequence"], estimate["sequence"]);
    assert_eq!(estimate["input_sequence"], imu["sequence"]);
    assert_eq!(wrench["cause_sequence"], imu["sequence"]);
    // The same samples, found by an independent reader.
    let stamps = ["header.sequence", "header.release_mono_ns", "header.receive_mono_ns"];
    for link in [imu, estimate, wrench] {
        let topic = link["topic"].as_str().expect("a name");
        let rows = recording.series(topic, &stamps);
        let same = rows.iter().find(|row| link["sequence"].as_f64() == Some(row.values[0]));
        let values = &same.expect("the sample is there").values;
        assert_eq!(link["release_mono_ns"].as_f64(), Some(values[1]), "{topic}");
        assert_eq!(link["receive_mono_ns"].as_f64(), Some(values[2]), "{topic}");
    }
    let first = applied.iter().find(|row| row.values[0] >= number).expect("it was applied");
    let tick_s = tick["release_ns"].as_f64().expect("an instant") * 1e-9;
    assert!((first.t_s - tick_s).abs() < 1e-9, "{} {tick_s}", first.t_s);
    // The parts add up to the whole.
    let length =
        |key: &str| command["segments_ns"][key].as_u64().unwrap_or_else(|| panic!("{key}"));
    let parts = ["imu_lateness", "imu_compute", "imu_hop", "estimator_wait", "estimator_compute"];
    let rest = ["estimate_hop", "attitude_wait", "attitude_compute"];
    let sum: u64 = parts.iter().chain(&rest).map(|key| length(key)).sum();
    assert_eq!(sum, length("sensor_to_command"));
    assert_eq!(sum + length("command_hop"), length("sensor_to_gate"));
}

#[test]
fn what_a_cut_or_thinned_recording_lacks_is_named() {
    let flown = fly(&["hover", "--for", "1s"]);
    let folder = TempDir::new().expect("a folder");
    let bytes = fs::read(flown.recording_path()).expect("a recording");
    let cut = folder.path().join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).expect("room");
    let (code, json) = trace(&cut, &[]);
    assert_eq!(code, Some(1), "{json}");
    assert!(json["cut_at_ns"].as_u64().is_some_and(|at| at > 0 && at < 1_000_000_000), "{json}");

    let thinned = folder.path().join("thinned.mcap");
    let lose = |topic: &str, sequence: u32, bytes: &mut Vec<u8>| {
        if topic == "/state_estimate" && sequence == 501 {
            bytes.clear();
        }
    };
    flown.recording().copy_to(&thinned, |_, _| {}, lose);
    let (code, json) = trace(&thinned, &[]);
    assert_eq!(code, Some(1), "{json}");
    let untraced = json["untraced"].as_array().expect("a list");
    assert_eq!(untraced.len(), 1, "{json}");
    let reason = untraced[0]["reason"].as_str().expect("a reason");
    assert!(reason.contains("state_estimate 501"), "{reason}");

    let (code, _) = trace(&flown.recording_path(), &["--command", "9999"]);
    assert_eq!(code, Some(2));
}
