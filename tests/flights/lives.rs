//! Flights in which slots changed hands, process by process and controller by controller: every life
//! verified, in both clocks, and whatever was changed in one is found and named.

use crate::common::processes::{Running, kill};
use crate::common::{Flown, fly, morphquad};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rustix::process::Signal;
use scenario::{Override, Scenario};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use tempfile::TempDir;

/// A swap for the same kind, one for another kind, and both windows.
const SWAPS: &[&str] = &[
    "figure8-morph",
    "--for",
    "3s",
    "--swap",
    "attitude=attitude-mpc@300ms,shadow=300ms,rollback=500ms",
    "--swap",
    "position=position-pid@500ms,shadow=600ms,rollback=600ms",
    "--swap",
    "attitude=attitude-pid@1400ms,shadow=400ms,rollback=500ms",
];

/// A death with a warm fallback, a stop and a death without.
const DEATHS: &[&str] = &[
    "figure8-morph",
    "--for",
    "3s",
    "--swap",
    "attitude=attitude-mpc@300ms,shadow=300ms,rollback=1s",
    "--fault",
    "kill:attitude-mpc@900ms",
    "--fault",
    "stop:attitude-mpc@1700ms",
    "--fault",
    "kill:position-mpc@2s",
];

fn replay(file: &Path, arguments: &[&str]) -> (Option<i32>, Value, String) {
    let mut command = morphquad(["replay"]);
    command.arg(file).args(arguments).args(["--format", "json"]);
    let output = command.output().expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), serde_json::from_slice(&output.stdout).unwrap_or(Value::Null), stderr)
}

/// Verifies the instances that `names` selects and returns which they were.
fn verified(flown: &Flown, names: &[&str]) -> Vec<String> {
    let flags = names.iter().flat_map(|name| ["--service", *name]);
    let flags: Vec<&str> = flags.chain(["--verify"]).collect();
    let (code, json, stderr) = replay(&flown.recording_path(), &flags);
    assert_eq!((code, &json["verify"]["identical"]), (Some(0), &true.into()), "{json} {stderr}");
    let services = json["verify"]["services"].as_array().expect("services");
    let compared = |s: &&Value| s["samples"].as_u64() > Some(0) && s["states"].as_u64() > Some(0);
    assert!(services.iter().all(|service| compared(&service)), "{json}");
    let name = |s: &Value| s["instance"].as_str().expect("a name").to_owned();
    services.iter().map(name).collect()
}

#[test]
fn every_life_of_every_controller_is_verified_in_both_clocks() {
    for (script, flew) in [
        (
            SWAPS,
            &[
                "position-mpc@0",
                "position-pid@1",
                "attitude-mpc@0",
                "attitude-mpc@1",
                "attitude-pid@0",
            ][..],
        ),
        (DEATHS, &["position-mpc@0", "attitude-mpc@0", "attitude-mpc@1"]),
    ] {
        for clock in ["lockstep", "realtime"] {
            let flown = fly(&[script, &["--clock", clock]].concat());
            flown.assert_flown(clock);
            let all = verified(&flown, &[]);
            let in_slots: Vec<&str> =
                all.iter().map(String::as_str).filter(|name| name.contains('@')).collect();
            if clock == "lockstep" {
                assert_eq!(in_slots, flew);
            }
            for name in in_slots {
                assert_eq!(verified(&flown, &[name]), [name]);
            }
        }
    }
}

/// The fallback of the position slot leaves between the death of the attitude controller and its successor's first step,
/// and that one is killed too, so that it never reports how far its inputs had got.
#[test]
fn a_loop_that_came_after_a_writer_had_left_and_was_killed_is_verified() {
    let arguments = [
        "hover",
        "--for",
        "2s",
        "--set",
        "rehearsal.enabled=false",
        "--swap",
        "position=position-mpc@500ms,shadow=200ms,rollback=250ms",
        "--swap",
        "position=position-mpc@1060ms,shadow=200ms,rollback=275ms",
        "--fault",
        "kill:attitude-mpc@1452ms",
        "--fault",
        "kill:attitude-mpc@1800ms",
    ];
    let flown = fly(&arguments);
    flown.assert_flown("twice killed");
    assert_eq!(flown.summary()["restarts"], 2, "{}", flown.output_text());
    assert_eq!(verified(&flown, &["attitude-mpc@0"]), ["attitude-mpc@0"]);
    let paced = fly(&[&arguments[..], &["--speed", "0.5", "--no-record"]].concat());
    assert_eq!(paced.summary()["hash"], flown.summary()["hash"]);
}

/// Steps of the plant at which commands of more than one seat were late.
fn late_together(flown: &Flown) -> usize {
    let mut echo = morphquad(["topic", "echo"]);
    echo.arg(flown.recording_path()).args(["deviation", "--format", "jsonl"]);
    let output = echo.output().expect("the executable starts");
    let mut seats: BTreeMap<u64, BTreeSet<u64>> = BTreeMap::new();
    for line in String::from_utf8(output.stdout).expect("text").lines() {
        let line: Value = serde_json::from_str(line).expect("an object");
        let deviation = &line["deviation"];
        if (&deviation["kind"], &deviation["input"])
            == (&"LateSamples".into(), &"wrench_command".into())
        {
            let step_ns = deviation["header"]["release_ns"].as_u64().expect("an instant");
            let seat = deviation["writer_seat"].as_u64().expect("a seat");
            seats.entry(step_ns).or_default().insert(seat);
        }
    }
    seats.values().filter(|seats| seats.len() > 1).count()
}

/// Before deviations were reported by seat, the numbers of one controller were taken for the other's.
#[test]
fn commands_of_owner_and_fallback_that_are_late_together_are_verified() {
    let standby = ["figure8-morph", "--for", "2s", "--standby", "attitude=attitude-mpc"];
    let late = ["--in-process", "--timing", "attitude:step=3ms@1s..1.5s"];
    let flown = fly(&[&standby[..], &late].concat());
    assert_eq!(flown.code, Some(0), "{}", flown.output_text());
    verified(&flown, &[]);
    // Each of fifty steps.
    assert_eq!(late_together(&flown), 50, "{}", flown.output_text());
}

#[test]
fn what_a_replay_is_about_can_be_given_by_role_name_and_seat() {
    let flown = fly(SWAPS);
    let attitude = ["attitude-mpc@0", "attitude-mpc@1", "attitude-pid@0"];
    assert_eq!(verified(&flown, &["attitude"]), attitude);
    assert_eq!(verified(&flown, &["attitude-mpc"]), attitude[..2]);
    assert_eq!(verified(&flown, &["attitude@0"]), ["attitude-mpc@0", "attitude-pid@0"]);
    assert_eq!(verified(&flown, &["attitude-pid@0"]), ["attitude-pid@0"]);
    let file = flown.recording_path();
    for (flags, named) in [
        (["--verify", "--service", "attitude-lqr"], "attitude-mpc@0, attitude-mpc@1"),
        (["--verify", "--service", "attitude@3"], "no attitude@3"),
        (["--verify", "--service", "attitude@4"], "seats 0 to 3"),
        (["--with", "attitude-lqr", "--hash"], "name with --service"),
    ] {
        let (code, _, stderr) = replay(&file, &flags);
        let stderr = stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(code, Some(2), "{stderr}");
        assert!(stderr.contains(named), "{named}: {stderr}");
    }
    // Its own kind departs nowhere, another one does; both begin where the life began.
    let with = |name| {
        let flags = ["--with", name, "--service", "attitude-pid@0"];
        let (code, json, stderr) = replay(&file, &flags);
        assert_eq!(code, Some(0), "{stderr}");
        json["with"]["first_departure"].clone()
    };
    assert_eq!(with("attitude-pid"), Value::Null);
    assert!(with("attitude-lqr")["t_s"].as_f64() >= Some(1.4));
}

#[test]
fn a_changed_bit_in_an_output_of_a_shadow_is_found_with_its_name() {
    let flown = fly(SWAPS);
    let folder = TempDir::new().expect("a folder");
    let copy = folder.path().join("copy.mcap");
    // The candidate of another kind counts its commands from 1, and shadows for the first 40.
    let mut seen = 0;
    flown.recording().copy_to(
        &copy,
        |_, _| {},
        |topic, sequence, bytes| {
            if topic == "/wrench_command" && sequence == 20 {
                seen += 1;
                if seen == 2 {
                    // Key, length and header come first, then the key of the thrust.
                    let thrust = 2 + usize::from(bytes[1]) + 1;
                    bytes[thrust] ^= 1;
                }
            }
        },
    );
    assert_eq!(seen, 2);
    let (code, json, stderr) = replay(&copy, &["--verify"]);
    assert_eq!(code, Some(1), "{stderr}");
    let first = &json["verify"]["first_difference"];
    assert_eq!(
        (&first["service"], &first["instance"]),
        (&"attitude".into(), &"attitude-pid@0".into())
    );
    assert_eq!((&first["topic"], &first["field"]), (&"wrench_command".into(), &"thrust_n".into()));
    let release = first["release"].as_u64();
    assert!((Some(155)..Some(165)).contains(&release), "{first}");
}

#[test]
fn deaths_flown_in_one_process_are_those_of_the_processes_and_only_slots_have_them() {
    let processes = fly(DEATHS);
    let alone = fly(&[DEATHS, &["--in-process"]].concat());
    assert_eq!(alone.hash(), processes.hash(), "{}", alone.output_text());
    assert_eq!(alone.text("log_hash"), processes.text("log_hash"));
    let swapped = fly(&[SWAPS, &["--in-process"]].concat());
    assert_eq!(swapped.code, Some(0), "{}", swapped.output_text());
    verified(&swapped, &[]);
    let fault = ["--fault", "kill:estimator@500ms"];
    let flown =
        fly(&[&["hover", "--in-process", "--no-record", "--for", "2s"], &fault[..]].concat());
    assert_eq!(flown.code, Some(2), "{}", flown.output_text());
    assert!(flown.output_text().contains("fills no slot"), "{}", flown.output_text());
}

#[test]
fn a_branch_at_any_tick_goes_on_with_the_processes_on_their_seats() {
    let mut random = ChaCha8Rng::seed_from_u64(45);
    for script in [SWAPS, DEATHS] {
        let flown = fly(script);
        // Before everything, in a shadow window, at a flip, in a rollback window, and anywhere.
        let mut ticks = vec![0, 450, 600, 900, 2000];
        ticks.extend((0..3).map(|_| random.next_u64() % 3000));
        for tick in ticks {
            let (code, json, stderr) =
                replay(&flown.recording_path(), &["--branch", &format!("@{tick}")]);
            assert_eq!(code, Some(0), "{tick}: {json} {stderr}");
            assert_eq!(json["branch"]["identical"], true, "{tick}: {json}");
            for key in ["hash", "log_hash", "swaps", "flown_s"] {
                assert_eq!(json[key], flown.summary()[key], "{tick}: {key}");
            }
        }
    }
}

#[test]
fn a_branch_can_give_a_slot_to_another_controller_by_the_protocol() {
    let flown = fly(SWAPS);
    let folder = TempDir::new().expect("a folder");
    let record = folder.path().to_str().expect("a path");
    let swap = ["--branch", "@2400", "--swap", "attitude=attitude-lqr", "--record", record];
    let (code, json, stderr) = replay(&flown.recording_path(), &swap);
    assert_eq!(code, Some(0), "{json} {stderr}");
    let last = json["swaps"].as_array().and_then(|swaps| swaps.last()).expect("a swap");
    let flipped_s = last["flipped_s"].as_f64().expect("a flip");
    assert!((2.64..2.68).contains(&flipped_s), "{last}");
    let first_s = json["branch"]["first_difference"]["t_s"].as_f64().expect("a difference");
    assert!((2.4..2.42).contains(&first_s), "{json}");
    // Its script is that of a flight of its own.
    let branch = Path::new(json["recording"].as_str().expect("a recording"));
    let (code, json, stderr) = replay(branch, &["--verify"]);
    assert_eq!((code, &json["verify"]["identical"]), (Some(0), &true.into()), "{json} {stderr}");
    let set = ["--branch", "@2700", "--set", "plant.mismatch.mass_scale=1.1"];
    assert_eq!(replay(&flown.recording_path(), &set).0, Some(2));
    let realtime = fly(&[SWAPS, &["--clock", "realtime"]].concat());
    assert_eq!(replay(&realtime.recording_path(), &["--branch", "@2700"]).0, Some(2));
}

#[test]
fn a_controller_with_a_scenario_of_its_own_is_verified_with_that() {
    let folder = TempDir::new().expect("a folder");
    let config = folder.path().join("softer.toml");
    let mut running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "2"]);
    let softer = Override::set("attitude_mpc.increment_weight=7").expect("a setting");
    let softer = Scenario::load("hover", &[softer]).expect("a shipped scenario");
    std::fs::write(&config, softer.to_toml()).expect("a scenario");
    let mut order = morphquad(["swap", "attitude", "--to", "attitude-mpc"]);
    order.args(["--run", running.id(), "--shadow", "300ms", "--rollback", "100ms"]);
    let output = order.arg("--force").arg("--config").arg(&config).output().expect("it starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    std::fs::remove_file(&config).expect("it was there");
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert!(
        verified(&flown, &[]).contains(&"attitude-mpc@1".to_owned()),
        "{}",
        flown.output_text()
    );
}
