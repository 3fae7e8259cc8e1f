//! `morphquad replay FILE --branch`: a recorded flight taken up in the middle.

use crate::common::{Flown, fly, morphquad, rounds};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// A script in which something hits the vehicle at 1.2 s.
const KICK: &str =
    r#"disturbance_injector.script=[{kind="kick",at_s=1.2,body_rate_b_rad_s=[2.0,0.0,0.0]}]"#;

fn branch(file: &Path, at: &str, flags: &[&str]) -> (Option<i32>, Value, String) {
    let mut command = morphquad(["replay"]);
    command.arg(file).args(["--branch", at, "--format", "json"]).args(flags);
    let output = command.output().expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    let json = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code(), json, stderr)
}

fn assert_identical(flown: &Flown, at: &str) {
    let (code, json, stderr) = branch(&flown.recording_path(), at, &[]);
    assert_eq!(code, Some(0), "{at}: {json} {stderr}");
    assert_eq!(json["branch"]["identical"], true, "{at}: {json}");
    assert!(json["branch"]["same_samples"].as_u64() > Some(0), "{at}: {json}");
    assert_eq!(json["hash"], flown.hash(), "{at}");
    for key in ["flown_s", "position_rms_m", "recorded_samples", "relaxed_steps", "log_hash"] {
        assert_eq!(json[key], flown.summary()[key], "{at}: {key}");
    }
}

#[test]
fn from_random_ticks_without_changes_the_rest_of_the_flight_is_the_same() {
    let flown = fly(&["figure8-morph", "--for", "4s", "--rate", "attitude-mpc=150"]);
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for _ in 0..rounds(6) {
        assert_identical(&flown, &format!("@{}", rng.random_range(0..4000)));
    }
    assert_identical(&flown, "@0");
    assert_identical(&flown, "@3.9985s");
}

#[test]
fn flights_in_one_process_and_rigs_can_be_taken_up_too() {
    for flags in
        [&["hover", "--in-process", "--for", "1s"][..], &["attitude-step"], &["disturbance"]]
    {
        assert_identical(&fly(flags), "@0.4567s");
    }
}

#[test]
fn a_branch_long_after_a_step_knows_how_the_step_was_answered() {
    let flown = fly(&["attitude-step"]);
    let (code, json, stderr) = branch(&flown.recording_path(), "@0.95s", &[]);
    assert_eq!(code, Some(0), "{json} {stderr}");
    for axis in ["roll", "pitch", "yaw"] {
        for of in ["settling_s", "peak_rad"] {
            let key = format!("{axis}_{of}");
            assert_eq!(json[&key], flown.summary()[&key], "{key}");
            assert!(json[&key].as_f64() > Some(0.0), "{key}: {json}");
        }
    }
}

#[test]
fn a_fault_at_a_tick_changes_nothing_before_and_is_a_whole_flights_fault_after() {
    let flown = fly(&["hover", "--for", "3s"]);
    let scratch = TempDir::new().expect("a folder");
    let record = scratch.path().to_str().expect("a path");
    let (code, json, stderr) =
        branch(&flown.recording_path(), "@1.2s", &["--set", KICK, "--record", record]);
    assert_eq!(code, Some(0), "{json} {stderr}");
    let first = &json["branch"]["first_difference"];
    assert!((1.2..1.21).contains(&first["t_s"].as_f64().expect("a time")), "{json}");

    // Before 1.2 s a flight with the kick in its script is the same one.
    assert_eq!(json["hash"], fly(&["hover", "--for", "3s", "--set", KICK]).hash());

    let path = Path::new(json["recording"].as_str().expect("a recording"));
    let branched = crate::common::recording::Recording::read(path);
    branched.count_messages_of_a_complete_file();
    let fields = ["position_w_m", "body_rate_b_rad_s"];
    let (old, new) =
        (flown.recording().series("truth", &fields), branched.series("truth", &fields));
    assert_eq!(old.len(), new.len());
    let at = old.iter().zip(&new).position(|(old, new)| old != new).expect("a difference");
    assert!((1.2..1.21).contains(&new[at].t_s), "{:?}", new[at]);

    // And the branch can be taken up in its turn.
    let (code, json, stderr) = branch(path, "@2s", &[]);
    assert_eq!((code, &json["branch"]["identical"]), (Some(0), &true.into()), "{json} {stderr}");
}

#[test]
fn settings_and_seeds_take_effect_at_the_tick_and_not_before() {
    let flown = fly(&["hover", "--for", "3s"]);
    for flags in [
        ["--set", "plant.mismatch.mass_scale=1.1"],
        ["--set", "attitude_mpc.rate_hz=200"],
        ["--set", "attitude_mpc.prediction_horizon=16"],
        ["--set", "vehicle.rotor_lag_s=0.02"],
        ["--seed", "9"],
    ] {
        let (code, json, stderr) = branch(&flown.recording_path(), "@1357", &flags);
        assert_eq!(code, Some(0), "{flags:?}: {json} {stderr}");
        let t_s = json["branch"]["first_difference"]["t_s"].as_f64().expect("a difference");
        assert!((1.357..1.39).contains(&t_s), "{flags:?}: {t_s}");
        assert_ne!(json["hash"], flown.hash());
        assert!(json["position_max_m"].as_f64() < Some(0.5), "{flags:?}: {json}");
    }
}

#[test]
fn what_cannot_be_changed_in_flight_is_refused_with_a_reason() {
    let flown = fly(&["hover", "--for", "1s"]);
    for (at, flags, named) in [
        ("@500", &["--set", "start.yaw_deg=9"][..], "began"),
        ("@500", &["--set", "plant.rate=9"], "rate"),
        ("@500", &["--set", "scenario.duration_s=0.2"], "before the branch"),
        ("@500", &["--set", "plant.model=linear"], "plant.model"),
        ("@500", &["--swap", "attitude=attitude-none"], "attitude-mpc"),
        ("@500", &["--swap", "rudder=attitude-mpc"], "rudder"),
        ("@500", &["--sweep", "vehicle.mass_kg=1"], "a..b/n"),
        ("@500", &["--sweep", "vehicle.mas_kg=1..2/3"], "--sweep vehicle.mas_kg"),
        ("@500", &["--sweep", "start.yaw_deg=1..2/3"], "began"),
        ("@5s", &[], "recorded up to"),
        ("500", &[], "@1234"),
    ] {
        let (code, json, stderr) = branch(&flown.recording_path(), at, flags);
        assert_eq!((code, &json["exit"]), (Some(2), &2.into()), "{flags:?}: {stderr}");
        assert!(stderr.contains(named), "{flags:?}: {stderr}");
    }
    let same = ["--swap", "attitude=attitude-mpc", "--swap", "position=position-mpc"];
    let (code, json, stderr) = branch(&flown.recording_path(), "@500", &same);
    assert_eq!((code, &json["branch"]["identical"]), (Some(0), &true.into()), "{stderr}");
}

#[test]
fn a_sweep_makes_one_table_and_each_of_its_branches_can_be_flown_alone() {
    let flown = fly(&["hover", "--for", "2s"]);
    let scratch = TempDir::new().expect("a folder");
    let out = scratch.path().join("out");
    let sweep = ["--sweep", "plant.mismatch.mass_scale=0.9..1.1/3", "--out"];
    let flags = [&sweep[..], &[out.to_str().expect("a path")]].concat();
    let (code, json, stderr) = branch(&flown.recording_path(), "@1s", &flags);
    assert_eq!((code, &json["cases"]), (Some(0), &3.into()), "{stderr}");
    let table = std::fs::read_to_string(out.join("branches.csv")).expect("a table");
    let rows: Vec<&str> = table.lines().collect();
    // What is not changed is the recorded flight.
    assert!(rows[2].contains(flown.hash()) && !rows[1].contains(flown.hash()), "{table}");
    assert!(out.join("branches.parquet").exists());

    let seeds = [&flags[..], &["--seeds", "0..3"]].concat();
    let (code, json, stderr) = branch(&flown.recording_path(), "@1s", &seeds);
    assert_eq!((code, &json["cases"]), (Some(0), &12.into()), "{stderr}");
    let worst = &json["worst"][0];
    let command = worst["command"].as_str().expect("a command");
    let again = command.replacen("morphquad", env!("CARGO_BIN_EXE_morphquad"), 1);
    let again = again.replace("--record recordings", "--format json");
    let output = Command::new("sh").args(["-c", &again]).output().expect("a shell");
    let alone: Value = serde_json::from_slice(&output.stdout).expect("a summary");
    assert_eq!(alone["hash"], worst["hash"], "{command}");
    // A sweep reports what was flown since the branch, and so does each of its branches.
    let since = &alone["branch"]["since"];
    for key in ["outcome", "position_max_m", "hash"] {
        assert_eq!(since[key], worst[key], "{key}: {command}");
    }

    // A vehicle that is lost in one of them is no success.
    let heavy = ["--sweep", "plant.mismatch.mass_scale=[1.0, 3.0]", "--out"];
    let flags = [&heavy[..], &[out.to_str().expect("a path")]].concat();
    let (code, json, stderr) = branch(&flown.recording_path(), "@0.5s", &flags);
    assert_eq!((code, &json["outcomes"]["LOST"]), (Some(1), &1.into()), "{json} {stderr}");
}
