//! A candidate that may not fly does not, for the right reason, and the flight does not notice.
//!
//! Candidates are processes of an executable of their own, `tests/common/rogue`, which flies like the template
//! for users' controllers until its `--config` sets otherwise.

use crate::common::held::{Held, fly_released};
use crate::common::misdeeds::{config, rogue};
use crate::common::processes::{Running, kill, make_executable};
use crate::common::recording::Recording;
use crate::common::time::wait_until;
use crate::common::{Flown, SWAP_FAILED, fly, morphquad};
use rustix::process::Signal;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

fn swaps_of(flown: &Flown) -> &[Value] {
    flown.summary()["swaps"].as_array().map_or(&[], Vec::as_slice)
}

/// Each in turn in one flight: what it does, from when in its shadow of one second on, how much of it,
/// and what is reported of it.
const MISDEEDS: [(&str, f64, f64, &str); 10] = [
    ("crash-at-once", 0.0, 0.0, "signal 6"),
    ("crash", 0.3, 0.0, "signal 6"),
    ("old-build", 0.0, 0.0, "lays out"),
    ("not-a-number", 0.3, 0.0, "torque x (N m) at"),
    ("beyond-bounds", 0.3, 0.0, "outside"),
    ("gain", 0.0, -1.0, "torque"),
    ("gain", 0.5, -1.0, "running free"),
    ("offset", 0.0, 0.2, "one step ahead"),
    ("offset", 0.5, 0.2, "running free"),
    ("frozen", 0.5, 0.0, "running free"),
];

/// Has each of these swapped in, one after the other, and asserts that it is refused for its reason.
fn assert_refused(scenario: &[&str], misdeeds: &[(&str, f64, f64, &str)]) {
    let folder = TempDir::new().expect("a folder");
    let expected = fly(scenario);
    let plan: Vec<String> = misdeeds
        .iter()
        .enumerate()
        .map(|(k, (what, from_s, amount, _))| {
            let at_s = 0.5 + 1.7 * k as f64;
            let config = config(&folder, what, at_s + from_s, *amount);
            format!("attitude={}@{at_s:.1}s,shadow=1s,rollback=100ms,config={config}", rogue())
        })
        .collect();
    let flags = plan.iter().flat_map(|swap| ["--swap", swap]);
    let flown = fly(&scenario.iter().copied().chain(flags).collect::<Vec<_>>());
    assert_eq!(flown.code, Some(SWAP_FAILED), "{}", flown.output_text());
    assert_eq!(swaps_of(&flown).len(), misdeeds.len(), "{}", flown.output_text());
    for (report, (what, _, _, reason)) in swaps_of(&flown).iter().zip(misdeeds) {
        let outcome = report["outcome"].as_str().unwrap_or_default();
        assert_eq!((&report["done"], &report["flipped_s"]), (&false.into(), &Value::Null));
        assert!(outcome.contains(reason), "{what}: {outcome}\n{}", flown.stderr);
    }
    assert_eq!(flown.hash(), expected.hash(), "{}", flown.output_text());
}

#[test]
fn no_misdeed_gives_a_candidate_the_slot_and_no_bit_of_the_flight_changes() {
    assert_refused(&["figure8-morph", "--for", "20s", "--no-record"], &MISDEEDS);
}

/// Alone in its flight, because the limit on starting is one of wall time and holds for every process.
#[test]
fn a_candidate_that_is_never_ready_is_refused_and_no_bit_of_the_flight_changes() {
    let limit = ["--set", "launcher.startup_timeout_s=10"];
    let scenario = ["figure8-morph", "--for", "3s", "--no-record"];
    let scenario = [&scenario[..], &limit].concat();
    assert_refused(&scenario, &[("never-ready", 0.0, 0.0, "ready in time")]);
}

/// Files that may be executed and that the system starts none of.
fn unstartable(folder: &Path) -> Vec<PathBuf> {
    // The header of a program for a machine with the other byte order.
    let foreign = [&b"\x7fELF\x02\x02\x01"[..], &[0; 57]].concat();
    let files: [(&str, &[u8]); 3] =
        [("empty", b""), ("foreign", &foreign), ("marked", b"\xef\xbb\xbf#!/bin/sh\nexit 0\n")];
    let make = |(name, bytes): (&str, &[u8])| {
        let path = folder.join(name);
        make_executable(&path, bytes);
        path
    };
    files.into_iter().map(make).collect()
}

#[test]
fn a_candidate_that_cannot_be_started_is_refused_and_the_flight_stays_as_it_was() {
    let folder = TempDir::new().expect("a folder");
    let scenario = ["hover", "--for", "3s", "--no-record"];
    let expected = fly(&scenario);
    let files = unstartable(folder.path());
    let plan = files.iter().enumerate().map(|(k, path)| {
        let slot = if k % 2 == 0 { "attitude" } else { "position" };
        format!("{slot}={}@{}ms,shadow=200ms", path.display(), 500 + 500 * k)
    });
    let flags: Vec<String> = plan.flat_map(|swap| ["--swap".to_owned(), swap]).collect();
    let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
    for alone in [&[][..], &["--in-process"]] {
        let flown = fly(&[&scenario[..], &flags, alone].concat());
        assert_eq!(flown.code, Some(SWAP_FAILED), "{}", flown.output_text());
        assert_eq!(swaps_of(&flown).len(), files.len(), "{}", flown.output_text());
        assert!(
            swaps_of(&flown).iter().all(|report| report["done"] == false),
            "{}",
            flown.output_text()
        );
        for path in &files {
            let name = path.file_name().and_then(|name| name.to_str()).expect("a name");
            let message = format!("{name} cannot be started: Exec format error");
            assert!(flown.output_text().contains(&message), "{}", flown.output_text());
        }
        assert_eq!(flown.hash(), expected.hash(), "{}", flown.output_text());
    }
}

/// The first start removes the file, so that the process that is killed cannot be started again.
#[test]
fn a_killed_owner_whose_file_is_gone_makes_room_for_the_initial_controller() {
    let folder = TempDir::new().expect("a folder");
    let config = config(&folder, "nothing", 0.0, 0.0);
    let path = folder.path().join("gone");
    let script = format!("#!/bin/sh\nrm -- \"$0\"\nexec {} \"$@\"\n", rogue());
    let flight = ["hover", "--for", "6s", "--no-record", "--set", "monitor.fallback=none"];
    let swap =
        format!("attitude={}@1s,shadow=500ms,rollback=100ms,config={config}", path.display());
    let orders = ["--set", "rehearsal.enabled=false", "--swap", &swap, "--fault", "kill:gone@3s"];
    make_executable(&path, script.as_bytes());
    let flown = fly(&[&flight[..], &orders].concat());
    assert!(!path.exists(), "{}", flown.output_text());
    assert_eq!(flown.code, Some(0), "{}", flown.output_text());
    assert!(flown.stderr.contains("cannot be started"), "{}", flown.output_text());
    assert!(flown.number("position_last_second_m") < 0.05, "{}", flown.output_text());
}

/// Time begins anew in a rehearsal, so that the instant of the crash comes there first.
#[test]
fn a_candidate_that_crashes_in_its_rehearsal_is_refused_and_the_crash_is_named() {
    let folder = TempDir::new().expect("a folder");
    let config = config(&folder, "crash", 2.0, 0.0);
    let swap = format!("attitude={}@100ms,shadow=300ms,rollback=100ms,config={config}", rogue());
    let flown = fly(&["hover", "--for", "1500ms", "--no-record", "--swap", &swap]);
    assert_eq!(flown.code, Some(SWAP_FAILED), "{}", flown.output_text());
    let outcome = swaps_of(&flown)[0]["outcome"].as_str().unwrap_or_default();
    for expected in ["cannot be rehearsed: rogue", "signal 6"] {
        assert!(outcome.contains(expected), "no `{expected}` in {outcome}");
    }
}

/// A candidate that does not misbehave is accepted: it is not refused as a foreign executable. All that is
/// published in the flight follows from its script, wherever the processes run and however busy the machine is.
#[test]
fn the_same_executable_takes_over_when_it_behaves_and_every_such_flight_is_the_same() {
    let folder = TempDir::new().expect("a folder");
    let config = config(&folder, "nothing", 0.0, 0.0);
    let candidate = rogue();
    let swaps = [
        format!("attitude={candidate}@1s,shadow=500ms,rollback=400ms,config={config}"),
        "attitude=attitude-pid@2s,shadow=500ms,rollback=400ms".to_owned(),
        format!("attitude={candidate}@3s,shadow=500ms,rollback=400ms,config={config}"),
    ];
    let flags = swaps.iter().flat_map(|swap| ["--swap", swap.as_str()]);
    let scenario: Vec<&str> = ["figure8-morph", "--for", "5s"].into_iter().chain(flags).collect();
    let log_hash = |flown: &Flown| flown.summary()["log_hash"].as_str().map(str::to_owned);
    let first = fly(&scenario);
    first.assert_clean();
    assert!(log_hash(&first).is_some(), "{}", first.output_text());
    assert!(
        swaps_of(&first).iter().all(|report| report["done"] == true),
        "{}",
        first.output_text()
    );
    for pin in ["none", "0"] {
        let flown = fly(&[&scenario[..], &["--pin", pin, "--disorder=7"]].concat());
        assert_eq!(log_hash(&flown), log_hash(&first), "--pin {pin}: {}", flown.output_text());
    }
}

struct CommandOutput {
    code: Option<i32>,
    text: String,
}

fn run_command(arguments: &[&str]) -> CommandOutput {
    let output = morphquad(arguments).output().expect("the executable starts");
    let mut text = String::from_utf8_lossy(&output.stdout).into_owned();
    text.push_str(&String::from_utf8_lossy(&output.stderr));
    CommandOutput { code: output.status.code(), text }
}

#[test]
fn every_refusal_has_its_exit_code() {
    let folder = TempDir::new().expect("a folder");
    // Before the flight, which would end while it is built.
    let rogue = rogue();
    let running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "4"]);
    let run = ["--run", running.id()];
    let swap = |rest: &[&str]| run_command(&[&["swap"], rest, &run].concat());
    for (what, amount, code, expected) in [
        ("offset", 0.1, 1, "is allowed"),
        ("not-a-number", 0.0, 1, "NaN"),
        ("crash", 0.0, 1, ""),
        ("crash-at-once", 0.0, 1, ""),
        ("old-build", 0.0, 1, ""),
    ] {
        let config = config(&folder, what, 0.0, amount);
        let output = swap(&["attitude", "--to", rogue, "--config", &config, "--shadow", "600ms"]);
        assert_eq!(output.code, Some(code), "{what}: {}", output.text);
        assert!(output.text.contains(expected), "{what}: {}", output.text);
    }
    for (rest, code, expected) in [
        (&["altitude", "--to", "attitude-mpc"][..], 2, "slot"),
        (&["attitude", "--to", "attitude-mpq"], 2, "attitude-mpq"),
        (&["attitude", "--to", "position-mpc"], 2, "position"),
        (&["attitude", "--to", "attitude-mpc@0"], 2, "already"),
    ] {
        let output = swap(rest);
        assert_eq!(output.code, Some(code), "{rest:?}: {}", output.text);
        assert!(output.text.contains(expected), "{rest:?}: {}", output.text);
    }
    let output = run_command(&["swap", "attitude", "--to", "attitude-mpc", "--run", "no-such-run"]);
    assert_eq!(output.code, Some(2), "{}", output.text);
    let second = Running::start_and_fly(&["hover", "--for", "60s", "--speed", "1"]);
    let output = run_command(&["swap", "attitude", "--to", "attitude-mpc"]);
    assert_eq!(output.code, Some(2), "{}", output.text);
    assert!(output.text.contains(running.id()) && output.text.contains("--run"), "{}", output.text);
    end(second);
    // A shadow of a minute is still there when the next is asked for.
    let mut first = morphquad(["swap", "attitude", "--to", "attitude-pid", "--shadow", "60s"])
        .args(run)
        .spawn()
        .expect("the executable starts");
    wait_until("the candidate", || {
        run_command(&["ps", "--run", running.id()]).text.contains("attitude-pid")
    });
    let output = swap(&["attitude", "--to", "attitude-lqr"]);
    assert_eq!(output.code, Some(3), "{}", output.text);
    wait_until("its departure", || {
        run_command(&["retire", "attitude-pid", "--run", running.id()]).code == Some(0)
    });
    assert_eq!(first.wait().expect("it ends").code(), Some(1));
    end(running);
}

fn end(mut running: Running) {
    assert!(kill(running.launcher_pid(), Signal::INT));
    assert_eq!(running.wait().code, Some(130));
}

#[test]
fn a_stranger_that_forges_commands_states_and_records_changes_no_bit_and_is_named() {
    // The estimator that is started again goes on from the last state that it has published itself.
    let scenario = ["hover", "--for", "24s", "--speed", "4", "--fault", "kill:estimator@12s"];
    let expected = fly_released(&scenario, "1s");
    let executable = rogue();
    let held = Held::start(&scenario, "1s");
    let folder = format!("/dev/shm/mq-{}", held.running.id());
    let mut stray =
        Command::new(executable).args(["stray", &folder]).spawn().expect("the executable starts");
    let pid = stray.id().to_string();
    let flown = held.release();
    // It is there to the end, so that the launcher can identify it.
    stray.kill().expect("it still writes");
    stray.wait().expect("it ends");
    assert_eq!(flown.hash(), expected.hash(), "{}", flown.output_text());
    let named = format!("process {pid} (rogue) publishes without being registered on ");
    let output_text = flown.output_text();
    let services = output_text.lines().filter_map(|line| Some(line.split_once(&named)?.1));
    let services: Vec<&str> =
        services.flat_map(|list| list.split(": ").next().unwrap_or(list).split(", ")).collect();
    for service in
        ["wrench_command", "attitude_owner", "state/estimator", "clock", "registry", "hello"]
    {
        assert!(services.contains(&service), "{service}: {output_text}");
    }
    assert!(
        flown.output_text().contains("samples from unregistered publishers"),
        "{}",
        flown.output_text()
    );
}

#[test]
fn services_that_another_program_removes_in_flight_are_put_back_and_reported() {
    // Whatever joins or is started again opens most of them anew.
    let scenario = ["hover", "--for", "3s", "--fault", "kill:estimator@2s"];
    let expected = fly_released(&scenario, "1s");
    let held = Held::start(&scenario, "1s");
    let run = held.running.id().to_owned();
    let services = format!("/dev/shm/mq-{run}/ipc/services");
    let (listed, objects) = (files_in(&services), files_in("/dev/shm"));
    let prefix = format!("/dev/shm/mqshm-{run}_");
    let of_services = |path: &PathBuf| {
        let path = path.to_str().expect("a name");
        path.starts_with(&prefix) && path.ends_with(".dynamic")
    };
    let removed: Vec<_> =
        listed.into_iter().chain(objects.into_iter().filter(of_services)).collect();
    assert!(removed.len() > 100, "{removed:?}");
    for file in &removed {
        std::fs::remove_file(file).expect("it is ours");
    }
    wait_until("they are put back", || removed.iter().all(|file| file.exists()));
    let flown = held.release();
    assert_eq!(flown.hash(), expected.hash(), "{}", flown.output_text());
    assert!(flown.number("recovered_crashes") > 0.0, "{}", flown.output_text());
    let text = "another program has removed services of this run (";
    // The launcher may look while they are being removed, and reports each time what it has put back.
    let mut lines = flown.stderr.lines().filter(|line| line.contains(text)).peekable();
    assert!(lines.peek().is_some(), "{}", flown.output_text());
    assert!(lines.all(|line| line.ends_with("): they are there again")), "{}", flown.output_text());
    let recording = flown.summary()["recording"].as_str().map(Path::new).expect("it is recorded");
    assert!(Recording::read(recording).mentions(text));
}

fn files_in(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    entries.map(|entry| entry.path()).collect()
}
