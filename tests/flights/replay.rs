//! Recordings flown again: the same bits in both clocks, and whatever was changed is found.
//!
//! `MORPHQUAD_ROUNDS=20 cargo test --release --test flights replay` kills 20 processes per clock.

use super::trace::assert_all_trace;
use crate::common::misdeeds::{config, rogue};
use crate::common::processes::{Running, kill};
use crate::common::recording::{CHUNK, Recording, middle_of_a_chunk, places};
use crate::common::time::wait_until;
use crate::common::{Flown, fly, morphquad, rounds};
use rustix::process::Signal;
use scenario::shipped;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Exit code and output of `morphquad replay`.
struct ReplayOutput {
    code: Option<i32>,
    json: Value,
    stderr: String,
}

fn replay(file: &Path, arguments: &[&str]) -> ReplayOutput {
    let mut command = morphquad(["replay"]);
    command.arg(file).args(arguments).args(["--format", "json"]);
    let output = command.output().expect("the executable starts");
    ReplayOutput {
        code: output.status.code(),
        json: serde_json::from_slice(&output.stdout).unwrap_or(Value::Null),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// Verifies every service and gives the answer.
fn assert_identical(file: &Path) -> Value {
    let output = replay(file, &["--verify"]);
    let verify = output.json["verify"].clone();
    assert_eq!(verify["identical"], true, "{} {}", output.json, output.stderr);
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    let services = verify["services"].as_array().expect("services").iter();
    // Executables of users are not flown again: what they published is taken from the recording.
    for service in services.filter(|service| service["left_out"].is_null()) {
        for key in ["steps", "samples", "states"] {
            assert!(service[key].as_u64() > Some(0), "{key}: {service}");
        }
    }
    verify
}

fn assert_hashes_agree(flown: &Flown) {
    let output = replay(&flown.recording_path(), &["--hash"]);
    assert_eq!(output.code, Some(0), "{} {}", output.json, output.stderr);
    assert_eq!(output.json["hashes"]["hash"], flown.hash());
    assert_eq!(output.json["hashes"]["log_hash"], flown.text("log_hash"));
}

#[test]
fn each_shipped_scenario_is_verified_and_traced_in_both_clocks() {
    for name in shipped::names() {
        for clock in ["lockstep", "realtime"] {
            let flown = fly(&[name, "--for", "1500ms", "--clock", clock]);
            assert_identical(&flown.recording_path());
            assert_hashes_agree(&flown);
            assert_all_trace(&flown, clock);
        }
    }
}

#[test]
fn a_rate_that_divides_nothing_is_verified_too() {
    for clock in ["lockstep", "realtime"] {
        let rate = ["--rate", "disturbance-injector=150.5"];
        let flight = ["figure8-morph", "--for", "1500ms", "--clock", clock];
        let flown = fly(&[&flight[..], &rate].concat());
        assert_identical(&flown.recording_path());
        assert_hashes_agree(&flown);
    }
}

/// Numbers of a field of the deviations.
fn deviations(flown: &Flown, field: &str) -> Vec<f64> {
    let rows = flown.recording().series("deviation", &[field]);
    rows.iter().map(|row| row.values[0]).collect()
}

#[test]
fn a_flight_with_late_samples_and_missed_deadlines_is_verified_and_branched() {
    let scripts = [
        "attitude:stopped@0.5s..0.6s",
        "position:step=5ms..25ms@0.7s..1s",
        "estimator:stopped@1.1s..1.15s",
        "wrench_command:late=0s..4ms@1.3s..1.5s",
    ];
    let scripts = scripts.iter().flat_map(|script| ["--timing", *script]);
    let flags = ["figure8-morph", "--for", "2s", "--in-process"].into_iter().chain(scripts);
    let flown = fly(&flags.collect::<Vec<&str>>());
    assert_identical(&flown.recording_path());
    assert_hashes_agree(&flown);
    // Amid a stop, a step that is computed and not published, samples on the way, and none of these.
    for at in ["@0.55s", "@0.812s", "@1.404s", "@1.8s"] {
        let folder = TempDir::new().expect("a folder");
        let record = ["--record", folder.path().to_str().expect("a path")];
        let branch = replay(&flown.recording_path(), &[&["--branch", at][..], &record].concat());
        assert_eq!(branch.json["hash"], flown.hash(), "{at}: {}", branch.json);
        assert_identical(Path::new(branch.json["recording"].as_str().expect("a path")));
    }
    let kinds = deviations(&flown, "kind");
    // Late samples, missed deadlines, releases left out and caught up.
    for kind in [0.0, 2.0, 3.0, 4.0] {
        assert!(kinds.contains(&kind), "no deviation of kind {kind} in {kinds:?}");
    }
    assert!(flown.number("late_samples") > 0.0 && flown.number("missed_ticks") > 0.0);
}

#[test]
fn a_flight_with_asap_edges_is_verified_by_what_took_effect_when() {
    let asap = "realtime.asap=[\"wrench_command\", \"attitude_setpoint\", \"applied_setpoint\"]";
    let flown = fly(&["figure8-morph", "--clock", "realtime", "--for", "2s", "--set", asap]);
    assert_identical(&flown.recording_path());
    assert_hashes_agree(&flown);
    let stamps = ["header.release_ns", "header.valid_ns"];
    let commands = flown.recording().series("wrench_command", &stamps);
    let delays: Vec<f64> = commands.iter().map(|row| row.values[1] - row.values[0]).collect();
    // As the machine had it, which is never the same for long.
    assert!(delays.len() > 10 && delays.iter().all(|ns| *ns > 0.0), "{delays:?}");
    assert!(delays.iter().any(|ns| (ns - delays[0]).abs() > 0.5), "{delays:?}");
}

#[test]
fn every_life_of_a_restarted_process_is_verified() {
    // In realtime a successor that publishes its state seldom may publish something else in the steps
    // that it repeats, and the recorder keeps what was published first: those are struck in lockstep.
    let strikes = [
        ("attitude-mpc", ["--clock", "realtime"]),
        ("estimator", ["--speed", "2"]),
        ("position-mpc", ["--clock", "realtime"]),
        ("disturbance-injector", ["--speed", "2"]),
        ("attitude-mpc", ["--speed", "2"]),
    ];
    for round in 0..rounds(2) {
        let (victim, clock) = strikes[round % strikes.len()];
        let flight = ["figure8-morph", "--for", "600s"];
        let mut running = Running::start_and_fly(&[&flight[..], &clock].concat());
        running.fly_on(0.1 + 0.1 * (round % 7) as f64);
        let first = running.signal(victim, Signal::KILL);
        wait_until("the successor", || running.process(victim).is_some_and(|p| p.pid != first));
        running.fly_on(0.5);
        assert!(kill(running.launcher_pid(), Signal::INT));
        let flown = running.wait();
        assert!(flown.number("recovered_crashes") >= 1.0, "{}", flown.output_text());
        assert_identical(&flown.recording_path());
        assert_hashes_agree(&flown);
    }
}

#[test]
fn a_trip_in_the_window_or_at_its_end_gives_the_fallback_the_slot_and_is_verified() {
    let folder = TempDir::new().expect("a folder");
    for (turns_at_s, rollback, fallback) in [
        // In its window a new owner has the one before it as fallback even so.
        (2.5, "3s", "none"),
        // The record that closes the window is written before the trip and comes into effect after it.
        (1.42, "10ms", "auto"),
    ] {
        let config = config(&folder, "gain", turns_at_s, -1.0);
        let how = format!("shadow=400ms,rollback={rollback},no-rehearsal,config={config}");
        let swap = format!("attitude={}@1s,{how}", rogue());
        let fallback = format!("monitor.fallback=\"{fallback}\"");
        let flown = fly(&["figure8-morph", "--for", "5s", "--swap", &swap, "--set", &fallback]);
        let output_text = flown.output_text();
        assert!(
            output_text.contains("limit 0.210 rad; attitude-mpc@0 is to take over"),
            "{output_text}"
        );
        let trips = flown.recording().series("trip", &["epoch"]).len();
        assert_eq!(trips, 1, "{output_text}");
        assert!(flown.number("position_max_m") < 0.5, "{output_text}");
        assert_identical(&flown.recording_path());
        assert_hashes_agree(&flown);
    }
}

/// Within the window of a swap the owner before it is the fallback, and no loop follows what the standby publishes.
#[test]
fn a_standby_that_is_the_fallback_again_after_a_window_has_lost_nothing() {
    let standby = ["--standby", "attitude=attitude-lqr"];
    let swap = ["--swap", "attitude=attitude-pid@2s,shadow=500ms"];
    let flown = fly(&[&["hover", "--for", "5s"][..], &standby, &swap].concat());
    flown.assert_clean();
    assert_eq!(flown.summary()["swaps"][0]["done"], true, "{}", flown.output_text());
    assert_identical(&flown.recording_path());
    assert_hashes_agree(&flown);
}

#[test]
fn one_changed_bit_is_found_and_named() {
    let flown = fly(&["hover", "--for", "1s"]);
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy.mcap");
    let mut changed = false;
    flown.recording().copy_to(
        &copy,
        |_, _| {},
        |topic, sequence, bytes| {
            if topic == "/imu" && sequence == 500 {
                // Key, length and header come first, then key and length of three doubles.
                let gyro_y = 2 + usize::from(bytes[1]) + 2 + 8;
                bytes[gyro_y] ^= 1;
                changed = true;
            }
        },
    );
    assert!(changed);
    let output = replay(&copy, &["--verify"]);
    assert_eq!(output.code, Some(1), "{}", output.stderr);
    let first = &output.json["verify"]["first_difference"];
    assert_eq!(first["service"], "plant");
    assert_eq!((&first["topic"], &first["field"]), (&"imu".into(), &"gyro_b_rad_s[1]".into()));
    assert_eq!(first["release"], 499);
    let bits = |key: &str| {
        let text = first[key].as_str().expect("a number");
        let (_, hex) = text.split_once("(0x").expect("its bits");
        u64::from_str_radix(hex.trim_end_matches(')'), 16).expect("hexadecimal")
    };
    assert_eq!(bits("recorded") ^ bits("replayed"), 1);
    assert_eq!(replay(&copy, &["--hash"]).code, Some(1));

    // A byte changed behind the back of the checksums.
    let mut bytes = fs::read(flown.recording_path()).expect("the recording");
    let middle = middle_of_a_chunk(&bytes);
    bytes[middle] ^= 0x10;
    fs::write(&copy, bytes).expect("a copy");
    for flags in [["--verify"], ["--hash"]] {
        let output = replay(&copy, &flags);
        assert_eq!(output.code, Some(2), "{}", output.json);
        assert!(output.stderr.contains("is damaged near byte"), "{}", output.stderr);
    }
}

#[test]
fn a_changed_state_and_a_missing_sample_are_found_and_named() {
    let flown = fly(&["attitude-step", "--for", "500ms"]);
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy.mcap");
    flown.recording().copy_to(
        &copy,
        |_, _| {},
        |topic, sequence, bytes| {
            if topic == "/state/attitude" && sequence == 26 {
                let last = bytes.len() - 1;
                bytes[last] ^= 0x40;
            }
        },
    );
    let first = replay(&copy, &["--verify"]).json["verify"]["first_difference"].clone();
    assert_eq!(first["topic"], "state/attitude");
    assert!(first["field"].as_str().is_some_and(|field| field.starts_with("memory.")), "{first}");

    flown.recording().copy_to(
        &copy,
        |_, _| {},
        |topic, sequence, bytes| {
            if topic == "/truth" && sequence == 30 {
                bytes.clear();
            }
        },
    );
    let first = replay(&copy, &["--verify"]).json["verify"]["first_difference"].clone();
    let found = ["topic", "field", "recorded"].map(|key| first[key].as_str().unwrap_or_default());
    assert_eq!(found, ["truth", "sample", "none"]);
    assert_eq!(first["release"], 29);
}

#[test]
fn a_recording_of_a_killed_launcher_is_verified_up_to_the_cut() {
    let flown = fly(&["hover", "--for", "2s"]);
    let folder = TempDir::new().expect("a folder");
    let cut = folder.path().join("cut.mcap");
    let bytes = fs::read(flown.recording_path()).expect("the recording");
    fs::write(&cut, &bytes[..bytes.len() * 3 / 5]).expect("a copy");
    let verify = assert_identical(&cut);
    assert_eq!(verify["complete"], false);
    let output = replay(&cut, &["--hash"]);
    assert_eq!((output.code, &output.json["hashes"]["stored_hash"]), (Some(1), &Value::Null));
    assert_eq!(output.json["hashes"]["agree"], Value::Null);

    // Flown on from before the cut, it is compared as far as the file goes.
    let branch = replay(&cut, &["--branch", "@100ms"]);
    let branched = &branch.json["branch"];
    assert_eq!((branch.code, &branched["identical"]), (Some(0), &true.into()), "{branched}");
    assert_eq!(branched["complete"], false, "{branched}");
    let to_s = branched["compared_to_s"].as_f64();
    assert!(to_s > Some(0.1) && to_s < Some(2.0), "{branched}");

    // Before the first sample is no success.
    fs::write(&cut, &bytes[..places(&bytes, CHUNK)[0] / 2]).expect("a copy");
    let output = replay(&cut, &["--verify"]);
    assert_eq!(output.code, Some(2), "{}", output.stderr);
    assert!(
        output.json["error"].as_str().is_some_and(|error| error.contains("is cut in its head"))
    );
}

#[test]
fn a_branch_flown_with_a_change_is_marked_as_one_and_not_verified_as_a_flight() {
    let flown = fly(&["hover", "--in-process", "--for", "1s"]);
    let folder = TempDir::new().expect("a folder");
    let record = ["--record", folder.path().to_str().expect("a path")];
    let branch = |flags: &[&str]| {
        let output =
            replay(&flown.recording_path(), &[&["--branch", "@605ms"], flags, &record].concat());
        assert_eq!(output.code, Some(0), "{}", output.stderr);
        PathBuf::from(output.json["recording"].as_str().expect("a recording"))
    };
    assert_identical(&branch(&[]));
    assert_identical(&branch(&["--for", "1200ms"]));

    let changed = branch(&["--set", "plant.mismatch.mass_scale=1.1"]);
    assert_eq!(replay(&changed, &["--hash"]).code, Some(0));
    let outputs = folder.path().join("outputs.mcap");
    let outputs = outputs.to_str().expect("a path");
    for flags in [
        &["--verify"][..],
        &["--branch", "@300ms"],
        &["--branch", "@606"],
        &["--with", "attitude-mpc"],
        &["--with", env!("CARGO_BIN_EXE_morphquad"), "--service", "attitude-mpc"],
        &["--outputs", outputs, "--service", "attitude-mpc"],
    ] {
        let output = replay(&changed, flags);
        assert_eq!((output.code, &output.json["exit"]), (Some(2), &2.into()), "{}", output.stderr);
        // Lines are wrapped at spaces to the width of the terminal.
        let stderr = output.stderr.replace(['\n', '│', '×'], " ");
        let stderr = stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        for part in [flown.text("run"), "at 0.605 s", "plant.mismatch.mass_scale=1.1"] {
            assert!(stderr.contains(part), "{part}: {stderr}");
        }
    }
    assert_eq!(replay(&changed, &["--branch", "@900ms"]).code, Some(0));
}

#[test]
fn flags_of_one_mode_are_refused_in_another() {
    let file = Path::new("none.mcap");
    for mode in [&["--verify"][..], &["--hash"], &["--with", "attitude-mpc"]] {
        for flag in [
            ["--seeds", "0..3"],
            ["--sweep", "vehicle.mass_kg=1..2/3"],
            ["--record", "folder"],
            ["--seed", "3"],
            ["--for", "3s"],
            ["--swap", "attitude=attitude-mpc"],
            ["--out", "folder"],
        ] {
            let output = replay(file, &[mode, &flag].concat());
            assert_eq!(output.code, Some(2), "{}", output.stderr);
            assert!(output.stderr.contains(flag[0]), "{mode:?} {flag:?}: {}", output.stderr);
        }
    }
    let output = replay(file, &["--hash", "--service", "plant"]);
    assert_eq!(output.code, Some(2));
    assert!(output.stderr.contains("--service"), "{}", output.stderr);
}

#[test]
fn a_recording_of_another_build_is_refused_and_the_type_that_changed_is_named() {
    let flown = fly(&["hover", "--for", "100ms"]);
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy.mcap");
    flown.recording().copy_to(
        &copy,
        |topic, metadata| {
            if topic == "/wrench_command" {
                metadata.insert("layout_hash".to_owned(), "00000000deadbeef".to_owned());
            }
        },
        |_, _, _| {},
    );
    let output = replay(&copy, &["--verify"]);
    assert_eq!((output.code, &output.json["exit"]), (Some(2), &2.into()));
    assert!(output.json["error"].as_str().is_some_and(|error| error.contains("WrenchCommand")));
    let ours = format!("{:016x}", shared_types::topics::WRENCH_COMMAND.schema().layout_hash);
    for part in ["copy.mcap", "WrenchCommand", "/wrench_command", "00000000deadbeef", &ours] {
        assert!(output.stderr.contains(part), "{part}: {}", output.stderr);
    }
}

#[test]
fn another_controller_departs_where_it_differs_and_nowhere_else() {
    let flown = fly(&["figure8-morph", "--for", "1s"]);
    let file = flown.recording_path();
    let same = replay(&file, &["--with", "attitude-mpc"]);
    assert_eq!(same.code, Some(0), "{}", same.stderr);
    assert_eq!(same.json["with"]["first_departure"], Value::Null);
    assert_eq!(same.json["with"]["samples"], 300);

    let executable = env!("CARGO_BIN_EXE_morphquad");
    let other = replay(&file, &["--with", executable, "--service", "attitude-mpc"]);
    assert_eq!(other.json["with"], same.json["with"], "{}", other.stderr);

    let softer =
        replay(&file, &["--with", "attitude-mpc", "--set", "attitude_mpc.increment_weight=50"]);
    let with = &softer.json["with"];
    let fields = with["fields"].as_array().expect("a table");
    let torque = fields.iter().find(|field| field["field"] == "torque_b_nm[0]").expect("a torque");
    let (max, rms) = (torque["max"].as_f64(), torque["rms"].as_f64());
    assert!(rms > Some(0.0) && max > rms, "{torque}");
    assert!(with["first_departure"]["t_s"].as_f64() < Some(0.5), "{with}");

    for wrong in [
        &["--with", "no-such-thing"][..],
        &["--with", "attitude-mpc", "--service", "plant"],
        &["--with", executable],
        &["--verify", "--service", "attitude"],
        &["--verify", "--set", "attitude_mpc.rate_hz=7"],
    ] {
        let output = replay(&file, wrong);
        let expected = if wrong == ["--verify", "--service", "attitude"] { 0 } else { 2 };
        assert_eq!(output.code, Some(expected), "{wrong:?}: {}", output.stderr);
    }
}

#[test]
fn a_recording_holds_what_an_independent_reader_finds() {
    let flown = fly(&["hover", "--for", "500ms"]);
    let steps =
        Recording::read(&flown.recording_path()).series("truth", &["morph_angle_rad"]).len();
    let verify = assert_identical(&flown.recording_path());
    assert_eq!(verify["services"][0]["steps"].as_u64(), Some(steps as u64));
}
