//! Controllers that are processes of their own in a flight that is flown in one: the flight is that of the
//! processes, a process that fails is named, and nothing is left behind.

mod common;

use common::misdeeds::{config, rogue};
use common::processes::{Process, Running, all_processes, kill, make_executable};
use common::time::wait_until;
use common::{Flown, SWAP_FAILED, fly};
use observe::Observer;
use observe::{FlightHash, LogHash};
use rustix::process::Signal;
use scenario::{Override, Scenario};
use serde_json::Value;
use shared_types::{Role, Sample, Topic};
use simulate::in_process::{Conclusion, InProcess, Outside, StateSource};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use tempfile::TempDir;

/// What these tests find of the processes of this one must be their own.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    // A failed test has spoilt nothing for the next.
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn swaps(flown: &Flown) -> &[Value] {
    flown.summary()["swaps"].as_array().map_or(&[], Vec::as_slice)
}

/// What the processes that `pid` has started, and their run namespaces, have left.
fn left_by(pid: u32) -> Vec<PathBuf> {
    let begins = [format!("mq-{:04x}", pid & 0xffff), format!("mqshm-{:04x}", pid & 0xffff)];
    let entries = std::fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
    let paths = entries.map(|entry| entry.path()).filter(|path| {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        name.is_some_and(|name| {
            begins.iter().any(|begin| name.trim_start_matches('.').starts_with(begin))
        })
    });
    paths.collect()
}

/// Processes whose arguments name this one as their launcher.
fn led_by(pid: u32) -> Vec<Process> {
    let pid = pid.to_string();
    let leads = |p: &Process| {
        let mut pairs = p.arguments.windows(2);
        pairs.any(|pair| pair[0] == "--launcher-pid" && pair[1] == pid)
    };
    all_processes().filter(leads).collect()
}

#[test]
fn an_executable_that_takes_over_makes_the_flight_of_the_processes() {
    let _alone = alone();
    let folder = TempDir::new().expect("a folder");
    let behaves = config(&folder, "nothing", 0.0, 0.0);
    for (rate, swaps_of_position) in [("100", &[][..]), ("500", &["position=position-pid@1200ms"])]
    {
        let swap = format!("attitude={}@1s,shadow=600ms,rollback=300ms,config={behaves}", rogue());
        let rate = format!("attitude-mpc={rate}");
        let mut flight =
            vec!["figure8-morph", "--for", "4s", "--seed", "3", "--rate", &rate, "--swap", &swap];
        flight.extend(swaps_of_position.iter().flat_map(|swap| ["--swap", *swap]));
        let processes = fly(&flight);
        let alone = fly(&[&flight[..], &["--in-process"]].concat());
        assert_eq!(swaps(&processes)[0]["done"], true, "{}", processes.output_text());
        assert_eq!(alone.code, processes.code, "{}", alone.output_text());
        assert_eq!(swaps(&alone), swaps(&processes));
        assert_eq!(alone.hash(), processes.hash(), "{}", alone.output_text());
        assert_eq!(alone.text("log_hash"), processes.text("log_hash"), "{}", alone.output_text());
    }
}

/// When the launcher is notified of it must not matter.
#[test]
fn an_executable_that_fails_after_its_window_makes_one_flight_however_it_is_run() {
    let _alone = alone();
    let folder = TempDir::new().expect("a folder");
    for what in ["not-a-number", "crash"] {
        let fails = config(&folder, what, 2.5, 0.0);
        let how = format!("shadow=400ms,rollback=300ms,no-rehearsal,config={fails}");
        let swap = format!("attitude={}@1s,{how}", rogue());
        let flight = ["figure8-morph", "--for", "4s", "--swap", &swap];
        let first = fly(&flight);
        let outcome = swaps(&first)[0]["outcome"].as_str().unwrap_or_default();
        assert!(outcome.starts_with("taken back: "), "{what}: {}", first.output_text());
        for more in [&[][..], &["--in-process"]] {
            let again = fly(&[&flight[..], more].concat());
            assert_eq!(again.hash(), first.hash(), "{what} {more:?}: {}", again.output_text());
            assert_eq!(swaps(&again), swaps(&first), "{what}: {}", again.output_text());
            if what == "not-a-number" {
                let [again_log, first_log] = [&again, &first].map(|flown| flown.text("log_hash"));
                assert_eq!(again_log, first_log, "{more:?}: {}", again.output_text());
            }
        }
    }
}

/// What came of a flight in this process.
type Hashes = (String, String);

/// Flies a scripted flight in which services join as `outside` has it.
fn fly_here(settings: &[&str], outside: impl Fn(Outside) -> Outside) -> (Hashes, Conclusion) {
    fly_watched(settings, outside, (FlightHash::default(), LogHash::default()), |seen| {
        (seen.0.hex(), seen.1.hex())
    })
}

fn fly_watched<O: Observer, R>(
    settings: &[&str],
    outside: impl Fn(Outside) -> Outside,
    observer: O,
    look: impl Fn(&mut O) -> R,
) -> (R, Conclusion) {
    let folder = TempDir::new().expect("a folder");
    let base = Scenario::load("figure8-morph", &[]).expect("a shipped scenario");
    let path = folder.path().join("scripted.toml");
    std::fs::write(&path, format!("{}\n{}", base.to_toml(), settings.join("\n"))).expect("room");
    let short = Override::set("scenario.duration_s=4").expect("a setting");
    let scenario = Scenario::load(path.to_str().expect("a path"), &[short]).expect("a scenario");
    let outside = outside(Outside::of(scenario.settings()));
    let mut flight =
        InProcess::with_processes(&scenario, StateSource::Estimator, observer, &outside)
            .expect("a flight");
    flight.fly_until(u64::MAX).expect("it is flown");
    flight.finish();
    let conclusion = flight.conclude();
    (flight.seen(look), conclusion)
}

const SWAPS: [&str; 4] = [
    "[[swap]]\nslot = 'attitude'\nto = 'attitude-mpc'\nat_s = 0.3\nshadow_s = 0.3\nrollback_s = 0.5",
    "[[swap]]\nslot = 'position'\nto = 'position-pid'\nat_s = 0.5\nshadow_s = 0.6\nrollback_s = 0.6",
    "[[swap]]\nslot = 'attitude'\nto = 'attitude-lqr'\nat_s = 1.4\nshadow_s = 0.4\nrollback_s = 0.5",
    "[[fault]]\nname = 'attitude-lqr'\nkind = 'kill'\nat_s = 2.6",
];

fn as_processes(mut outside: Outside) -> Outside {
    outside.services = Some(env!("CARGO_BIN_EXE_morphquad").into());
    outside
}

#[test]
fn services_as_processes_and_as_loops_of_the_thread_make_one_flight() {
    let _alone = alone();
    let (within, conclusion_within) = fly_here(&SWAPS, |outside| outside);
    let (as_processes, conclusion) = fly_here(&SWAPS, as_processes);
    assert_eq!(conclusion_within.swaps.len(), 3);
    assert_eq!(format!("{:?}", conclusion.swaps), format!("{:?}", conclusion_within.swaps));
    assert_eq!(as_processes, within);
    assert_eq!(conclusion.exits, []);
}

#[test]
fn flights_side_by_side_in_one_process_are_each_the_same_and_leave_nothing() {
    let _alone = alone();
    let (expected, _) = fly_here(&SWAPS, |outside| outside);
    thread::scope(|scope| {
        let flights: Vec<_> = (0..3)
            .map(|_| {
                scope.spawn(|| {
                    let here = |o| Outside { nice: Some(5), cpu: Some(0), ..as_processes(o) };
                    fly_here(&SWAPS, here).0
                })
            })
            .collect();
        for flight in flights {
            assert_eq!(flight.join().expect("no panic"), expected);
        }
    });
    wait_until("nothing is left", || left_by(std::process::id()).is_empty());
    assert!(led_by(std::process::id()).is_empty());
}

/// Kills the process that has joined, once, at an instant of the flight.
struct Killer {
    at_ns: u64,
    hash: FlightHash,
    killed: bool,
}

impl Observer for Killer {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.hash.observe(topic, sample);
        // Pilot and injector run ahead of all others.
        let is_time = topic.info.from == Role::Plant && sample.header().release_ns >= self.at_ns;
        if !self.killed && is_time {
            let joined = led_by(std::process::id());
            self.killed = joined.iter().any(|process| kill(process.pid, Signal::KILL));
        }
    }
}

/// The owner's death is made good in place; a shadow's ends its swap.
#[test]
fn a_process_that_is_killed_leaves_no_trace_as_owner_and_is_named_as_candidate() {
    let _alone = alone();
    let swap = ["[[swap]]\nslot = 'attitude'\nto = 'attitude-lqr'\nat_s = 0.5\nshadow_s = 1.0\n\
                 rollback_s = 0.3"];
    let ((expected, _), _) = fly_here(&swap, |outside| outside);
    let kill_at = |at_ns| {
        let killer = Killer { at_ns, hash: FlightHash::default(), killed: false };
        fly_watched(&swap, as_processes, killer, |seen| (seen.hash.hex(), seen.killed))
    };
    let ((hash, killed), conclusion) = kill_at(2_503_000_000);
    assert!(killed);
    assert_eq!(hash, expected, "{conclusion:?}");
    assert_eq!(conclusion.recovered, 1);
    assert!(conclusion.swaps[0].done, "{conclusion:?}");
    let exit = &conclusion.exits[0];
    assert_eq!((exit.name.as_str(), exit.how.as_str()), ("attitude-lqr", "killed by signal 9"));
    assert_eq!(exit.at_ns, 2_510_000_000);
    let ((_, killed), conclusion) = kill_at(1_003_000_000);
    assert!(killed && !conclusion.swaps[0].done, "{conclusion:?}");
    assert_eq!(conclusion.exits[0].at_ns, 1_010_000_000);
    assert_eq!(conclusion.recovered, 0);
    assert!(led_by(std::process::id()).is_empty());
}

/// Each in turn in one flight: what the candidate does from when in its shadow on, how much of it, and
/// what is reported of it.
type Misdeed = (&'static str, f64, f64, &'static str);

const MISDEEDS: [Misdeed; 4] = [
    ("crash-at-once", 0.0, 0.0, "rogue ended before it was ready (killed by signal 6)"),
    ("crash", 0.3, 0.0, "rogue killed by signal 6"),
    ("old-build", 0.0, 0.0, "lays out"),
    ("not-a-number", 0.3, 0.0, "torque x (N m) at"),
];

/// Those that hang are alone in their flight, because a limit of wall time holds for every process.
const HANGS: [(Misdeed, &str); 2] = [
    (
        ("never-ready", 0.0, 0.0, "rogue was not ready within 2 s, and was killed"),
        "launcher.startup_timeout_s=2",
    ),
    (
        ("late", 0.3, 1e6, "rogue made no progress for 2 s although it could, and was killed"),
        "launcher.stall_timeout_s=2",
    ),
];

/// Flies with these candidates, one after the other, and asserts that each is named and none has an effect.
fn assert_without_effect(misdeeds: &[Misdeed], limits: &[&str]) {
    let folder = TempDir::new().expect("a folder");
    let scenario = ["figure8-morph", "--for", "6s", "--no-record", "--in-process"];
    let expected = fly(&scenario);
    let plan: Vec<String> = misdeeds
        .iter()
        .enumerate()
        .map(|(k, (what, from_s, amount, _))| {
            let at_s = 0.5 + 1.2 * k as f64;
            let config = config(&folder, what, at_s + from_s, *amount);
            format!("attitude={}@{at_s:.1}s,shadow=600ms,rollback=100ms,config={config}", rogue())
        })
        .collect();
    let flags = plan.iter().flat_map(|swap| ["--swap", swap]);
    let limits = limits.iter().flat_map(|limit| ["--set", *limit]);
    let flown = fly(&scenario.into_iter().chain(limits).chain(flags).collect::<Vec<_>>());
    assert_eq!(flown.code, Some(SWAP_FAILED), "{}", flown.output_text());
    assert_eq!(swaps(&flown).len(), misdeeds.len(), "{}", flown.output_text());
    for (report, (what, _, _, reason)) in swaps(&flown).iter().zip(misdeeds) {
        let outcome = report["outcome"].as_str().unwrap_or_default();
        assert_eq!((&report["done"], &report["flipped_s"]), (&false.into(), &Value::Null));
        let is_named = outcome.contains(reason) || flown.stderr.contains(reason);
        assert!(is_named, "{what}: {outcome}\n{}", flown.stderr);
    }
    assert_eq!(flown.hash(), expected.hash(), "{}", flown.output_text());
}

#[test]
fn no_misdeed_of_a_process_ends_or_changes_the_flight_and_each_is_named() {
    let _alone = alone();
    assert_without_effect(&MISDEEDS, &[]);
}

#[test]
fn a_process_that_hangs_neither_ends_nor_changes_the_flight_and_is_named() {
    let _alone = alone();
    for (misdeed, limit) in HANGS {
        assert_without_effect(&[misdeed], &[limit]);
    }
}

/// A script that is no controller: its last lines on stderr are reported, whatever they are.
#[test]
fn the_last_lines_on_stderr_of_an_executable_that_ends_are_reported() {
    let _alone = alone();
    let folder = TempDir::new().expect("a folder");
    for (text, how) in [
        ("echo Traceback >&2\necho 'ValueError: no gains' >&2\nexit 1", "(exit status 1)"),
        ("echo 'ValueError: no gains' >&2", "(exit status 0)"),
    ] {
        let path = folder.path().join("stumbles");
        make_executable(&path, format!("#!/bin/sh\n{text}\n").as_bytes());
        let swap = format!("attitude={}@300ms,shadow=100ms", path.display());
        let flown = fly(&["hover", "--for", "1s", "--no-record", "--in-process", "--swap", &swap]);
        assert_eq!(swaps(&flown)[0]["done"], false, "{}", flown.output_text());
        let expected = format!("stumbles ended before it was ready {how}, its last words:");
        assert!(flown.stderr.contains(&expected), "{}", flown.output_text());
        assert!(flown.stderr.contains("ValueError: no gains"), "{}", flown.output_text());
    }
}

#[test]
fn a_controller_that_prints_without_end_is_shown_in_part_and_flies_as_before() {
    let _alone = alone();
    let folder = TempDir::new().expect("a folder");
    let fly_one = |what, how: &[&str]| {
        let config = config(&folder, what, 0.0, 1000.0);
        let swap = format!("attitude={}@300ms,shadow=300ms,no-rehearsal,config={config}", rogue());
        fly(&[&["hover", "--for", "2s", "--no-record", "--swap", &swap], how].concat())
    };
    let silent = fly_one("nothing", &["--in-process"]);
    for how in [&["--in-process"][..], &[]] {
        let prints = fly_one("prints", how);
        assert_eq!(prints.hash(), silent.hash(), "{how:?}");
        let shown = prints.stderr.lines().filter(|line| line.starts_with("rogue: line ")).count();
        // It prints more than a hundred thousand.
        assert!((10..20_000).contains(&shown), "{shown} lines");
        assert!(prints.stderr.contains("rogue: lines left out: "), "{how:?}");
    }
}

#[test]
fn nothing_is_left_when_the_flight_is_killed() {
    let _alone = alone();
    let swap = format!("attitude={}@100ms,shadow=30s", rogue());
    let mut running =
        Running::start(&["hover", "--in-process", "--speed", "1", "--for", "60s", "--swap", &swap]);
    let pid = running.launcher_pid();
    wait_until("the process has joined", || !led_by(pid).is_empty() && !left_by(pid).is_empty());
    assert!(kill(pid, Signal::KILL));
    running.wait();
    wait_until("the process leaves", || led_by(pid).is_empty() && left_by(pid).is_empty());
}
