//! Storms: twenty and more orders and faults within four seconds, over every process. Whatever they do, the vehicle
//! stays where it is to be, only owners command, the recording is whole and can be verified, and nothing is left
//! behind.
//!
//! A scripted storm has exact instants, so that it is flown twice and must be the same flight. `MORPHQUAD_STORMS` sets
//! how many are flown, `MORPHQUAD_SEED` from which seed on; `cargo run --release -p soak -- --only storms::` flies those
//! whose orders come by the wall clock, one of each kind for each seed, and writes what comes of them to one file.

mod audit;
mod plan;

use crate::common::processes::{Process, Running, kill, left_in_shared_memory, processes_of};
use crate::common::recording::Recording;
use crate::common::time::{host_s, pause_ms, wait_until};
use crate::common::{fly, morphquad};
use plan::{Act, Kind, LAUNCHER, storm};
use rustix::process::Signal;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Output};
use std::thread;

/// Duration of a flight: the storm ends at 4.5 s, and then everything may settle.
const FLIGHT_S: &str = "6s";
/// Exit codes of a flight that was flown to its end, well or with swaps that were refused; and by the wall clock not well,
/// which the machine may be the cause of.
const WELL: &[Option<i32>] = &[Some(0), Some(5)];
const FLOWN: &[Option<i32>] = &[Some(0), Some(1), Some(5)];

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Seeds of storms: as many as are asked for, or by default.
fn seeds(default: u64) -> impl Iterator<Item = u64> {
    let (first, count) = (number("MORPHQUAD_SEED", 1), number("MORPHQUAD_STORMS", default));
    first..first + count
}

/// Flies storms, each with a seed of its own, and fails with all that any of them has found.
#[expect(clippy::print_stdout, reason = "what a long row of storms has found so far")]
fn fly_storms(
    kind: Kind,
    seeds: impl Iterator<Item = u64>,
    fly_one: impl Fn(u64, &[(f64, Act)]) -> Vec<String>,
) {
    let (mut found, mut flown) = (Vec::new(), Vec::new());
    for seed in seeds {
        flown.push(seed);
        let acts = storm(seed, kind);
        let findings = fly_one(seed, &acts);
        if !findings.is_empty() {
            println!("storm {seed}: {acts:?}");
        }
        for finding in findings {
            println!("storm {seed}: {finding}");
            found.push(format!("storm {seed}: {finding}"));
        }
    }
    let findings = found.join("\n");
    assert!(found.is_empty(), "{} findings in storms {flown:?}:\n{findings}", found.len());
    println!("storms {flown:?}: 0 findings");
}

/// What is wrong with a flight by its exit code, its summary and its recording; a finding shows `output_text`.
fn judged(
    may_be: &[Option<i32>],
    code: Option<i32>,
    summary: &Value,
    output_text: &str,
) -> Vec<String> {
    let mut findings = Vec::new();
    let verdict = summary["verdict"]["verdict"].as_str().unwrap_or("none");
    if !may_be.contains(&code) || ["LOST", "CRASHED", "none"].contains(&verdict) {
        findings.push(format!("{verdict}, code {code:?}: {output_text}"));
    }
    let recording = summary["recording"].as_str().map(Path::new);
    findings.extend(recording.map(recorded).unwrap_or_default());
    findings.extend(recording.map(recorded_before).unwrap_or_default());
    for key in ["wrong_owner_ticks", "duplicated_ticks", "dropped_samples"] {
        let count = summary[key].as_f64();
        if count != Some(0.0) {
            findings.push(format!("{key}: {count:?}"));
        }
    }
    if let Some(path) = recording.filter(|_| !findings.is_empty()) {
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(path.file_name().expect("a name"));
        std::fs::copy(path, &kept).expect("room");
        findings.push(format!("the recording is kept as {}", kept.display()));
    }
    findings
}

/// What is wrong with a recording, by itself and by `replay --verify`.
fn recorded(path: &Path) -> Vec<String> {
    let mut findings = audit::findings(&Recording::read(path));
    if path.to_string_lossy().contains("-adopted-") {
        // It begins in the middle of a flight, which cannot be flown again.
        return findings;
    }
    let mut verify = morphquad(["replay"]);
    verify.arg(path).args(["--verify", "--format", "json"]);
    let output = verify.output().expect("the executable starts");
    let json: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    if output.status.code() != Some(0) || json["verify"]["identical"] != true {
        let stderr = String::from_utf8_lossy(&output.stderr);
        let services = json["verify"]["services"].as_array().cloned().unwrap_or_default();
        let differ: Vec<_> =
            services.iter().filter(|s| s["differences"] != 0 || s["unrecorded"] != 0).collect();
        findings.push(format!("verify: {:?} {differ:?} {stderr}", output.status.code()));
    }
    findings
}

/// What is wrong with the recordings of the launchers before the last one, which were killed.
fn recorded_before(last: &Path) -> Vec<String> {
    let folder = last.parent().expect("a folder");
    let entries = std::fs::read_dir(folder).expect("there until now").flatten();
    let paths = entries.map(|entry| entry.path());
    // A launcher may be killed before it has recorded anything.
    let is_cut = |path: &PathBuf| {
        let is_recording = path.extension().is_some_and(|kind| kind == "mcap");
        path != last && is_recording && Recording::read(path).has_begun("truth")
    };
    let cut: Vec<_> = paths.filter(is_cut).collect();
    let of_each = |path: &PathBuf| {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        let whole = path.with_extension("whole");
        let mut recover = morphquad(["recover"]);
        recover.arg(path).arg("--out").arg(&whole);
        let output = recover.output().expect("the executable starts");
        if output.status.code() != Some(0) {
            let stderr = String::from_utf8_lossy(&output.stderr);
            return vec![format!("{name} cannot be recovered: {stderr}")];
        }
        let findings = audit::findings(&Recording::read(&whole));
        if !findings.is_empty() {
            let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(&name);
            std::fs::copy(path, &kept).expect("room");
        }
        findings.into_iter().map(|finding| format!("{name}: {finding}")).collect()
    };
    cut.iter().flat_map(of_each).collect()
}

#[test]
fn a_scripted_storm_is_one_flight_and_loses_nothing() {
    fly_storms(Kind::Scripted, seeds(10).filter(|seed| !is_rehearsed(*seed)), fly_script);
}

#[test]
fn a_scripted_storm_with_rehearsals_is_one_flight_and_loses_nothing() {
    fly_storms(Kind::Scripted, seeds(10).filter(|seed| is_rehearsed(*seed)), fly_script);
}

/// Whether a scripted storm is flown with rehearsals, which are no part of the flight unless one refuses.
fn is_rehearsed(seed: u64) -> bool {
    seed.is_multiple_of(2)
}

/// Flies a storm as fast as it can be and once more paced, which must be the same flight.
fn fly_script(seed: u64, acts: &[(f64, Act)]) -> Vec<String> {
    let script: Vec<String> = acts.iter().flat_map(|(at_s, act)| act.script(*at_s)).collect();
    let mut arguments = vec!["hover", "--for", FLIGHT_S];
    arguments.extend(script.iter().map(String::as_str));
    let unrehearsed = ["--set", "rehearsal.enabled=false"];
    let first = if is_rehearsed(seed) {
        fly(&arguments)
    } else {
        fly(&[&arguments[..], &unrehearsed].concat())
    };
    let mut findings = judged(WELL, first.code, first.summary(), &first.output_text());
    arguments.extend(["--speed", "8", "--no-record"]);
    if !is_refused_by_a_rehearsal(first.summary()) {
        arguments.extend(unrehearsed);
    }
    let second = fly(&arguments);
    if first.summary()["hash"] != second.summary()["hash"] {
        findings.push(format!("another hash the second time: {}", second.output_text()));
    }
    findings
}

fn is_refused_by_a_rehearsal(summary: &Value) -> bool {
    let is_refused = |swap: &Value| swap["done"] == false && swap["rehearsal"] == swap["outcome"];
    summary["swaps"].as_array().is_some_and(|swaps| swaps.iter().any(is_refused))
}

#[test]
#[ignore = "soak: orders come by the wall clock"]
fn a_storm_of_orders_in_lockstep_loses_nothing_that_the_recording_does_not_explain() {
    let scenario = ["hover", "--speed", "1"];
    fly_storms(Kind::Ordered, seeds(1), |_seed, acts| fly_orders(&scenario, acts));
}

#[test]
#[ignore = "soak: orders come by the wall clock, and on a busy machine the vehicle strays by itself"]
fn a_storm_of_orders_in_realtime_loses_nothing_that_the_recording_does_not_explain() {
    let scenario = ["hover", "--clock", "realtime"];
    fly_storms(Kind::Realtime, seeds(1), |_seed, acts| fly_orders(&scenario, acts));
}

/// Flies, with orders and signals at their instants by the wall clock, and judges the recordings of the flight.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "short times")]
fn fly_orders(scenario: &[&str], acts: &[(f64, Act)]) -> Vec<String> {
    let mut running = Running::start_and_fly(&[scenario, &["--for", FLIGHT_S]].concat());
    let run = running.id().to_owned();
    let begun_s = host_s();
    let mut launchers = Launchers { first_pid: running.launcher_pid(), next: Vec::new() };
    thread::scope(|scope| {
        for (at_s, act) in acts {
            pause_ms((1e3 * (begun_s + at_s - host_s()).max(0.0)) as u64);
            let run = run.as_str();
            match act {
                Act::Kill { name } => send(&pids_of(run, name), Signal::KILL),
                Act::Stop { name, for_s } => {
                    let pids = match *name {
                        LAUNCHER => vec![launchers.pid()],
                        name => pids_of(run, name),
                    };
                    send(&pids, Signal::STOP);
                    scope.spawn(move || {
                        pause_ms((1e3 * for_s) as u64);
                        send(&pids, Signal::CONT);
                    });
                }
                Act::Adopt => launchers.replace(run),
                order => {
                    let arguments = order.order().expect("all others are orders");
                    scope.spawn(move || order_of(run, arguments));
                }
            }
        }
    });
    let flown = running.wait();
    let findings = match launchers.end_of_last() {
        Some((code, summary, stderr)) => judged(FLOWN, code, &summary, &stderr),
        None => judged(FLOWN, flown.code, flown.summary(), &flown.output_text()),
    };
    wait_until("all processes leave", || processes_of(&run).is_empty());
    wait_until("nothing is left", || left_in_shared_memory(&run).is_empty());
    findings
}

/// The launchers of a flight, one after the other.
struct Launchers {
    first_pid: u32,
    next: Vec<Child>,
}

impl Launchers {
    fn pid(&self) -> u32 {
        self.next.last().map_or(self.first_pid, Child::id)
    }

    /// Kills the launcher and has another one take over.
    fn replace(&mut self, run: &str) {
        kill(self.pid(), Signal::KILL);
        let adopter = morphquad(["adopt", run, "--format", "json"]).spawn();
        self.next.push(adopter.expect("the executable starts"));
    }

    /// Exit code, summary and stderr of the last one, if there is any but the first.
    fn end_of_last(mut self) -> Option<(Option<i32>, Value, String)> {
        let last = self.next.pop()?;
        for mut killed in self.next {
            killed.wait().expect("an end");
        }
        let Output { status, stdout, stderr } = last.wait_with_output().expect("an end");
        let stderr = String::from_utf8_lossy(&stderr).into_owned();
        let summary = serde_json::from_slice(&stdout).unwrap_or(Value::Null);
        Some((status.code(), summary, stderr))
    }
}

/// Gives an order; a refusal is an answer like any other.
fn order_of(run: &str, mut arguments: Vec<String>) {
    let at = arguments.iter().position(|argument| argument == "--").unwrap_or(arguments.len());
    arguments.splice(at..at, ["--run".to_owned(), run.to_owned()]);
    let output = morphquad(&arguments).output().expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code().is_some(), "{arguments:?}: {stderr}");
    assert!(output.status.code() != Some(101), "{arguments:?}: {stderr}");
}

/// Every process of this name that there is.
fn pids_of(run: &str, name: &str) -> Vec<u32> {
    let of_name = |p: &Process| p.arguments.first().is_some_and(|own| own == name);
    processes_of(run).into_iter().filter(of_name).map(|process| process.pid).collect()
}

fn send(pids: &[u32], signal: Signal) {
    for pid in pids {
        kill(*pid, signal);
    }
}
