//! Processes die, stop and are interrupted at any moment; the flight goes on or ends in order, and
//! nothing is left behind.
//!
//! `MORPHQUAD_ROUNDS=20 cargo test --release --test flights faults` strikes 20 times per victim; every
//! round has a moment of its own, drawn from its number.

use crate::common::held::{Held, fly_released};
use crate::common::misdeeds::{config, rogue};
use crate::common::processes::{
    Running, all_processes, is_dead, kill, left_in_shared_memory, make_executable, processes_of,
};
use crate::common::recording::Recording;
use crate::common::spectator::Spectator;
use crate::common::time::{wait_for, wait_until};
use crate::common::{Flown, distance, fly, morphquad, rounds};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Resource, Rlimit, Signal, getrlimit, prlimit};
use serde_json::Value;
use shared_types::GateMode;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// Services that are restarted from their last state.
const MORTALS: [&str; 5] =
    ["estimator", "position-mpc", "attitude-mpc", "disturbance-injector", "pilot"];
/// Exit code when a crash ended the flight.
const CRASHED: i32 = 4;
/// Exit code when the user ended the flight.
const INTERRUPTED: i32 = 130;
/// A flight with wind and morphing.
const FLIGHT: [&str; 3] = ["figure8-morph", "--for", "8s"];
/// Slow enough to be hit at different instants.
const PACE: [&str; 2] = ["--speed", "2"];
/// Part of it in which it is struck \[s\].
const STRUCK_S: f64 = 4.0;

/// Where the flight waits until it has been struck.
const HELD_AT: &str = "7s";

/// Flies, strikes at a moment that only `seed` decides about, and flies on to the end.
fn fly_and_strike(more: &[&str], victims: &[&str], signal: Signal, seed: usize) -> Flown {
    let held = Held::start(&[&FLIGHT[..], &PACE, more].concat(), HELD_AT);
    // In the flight and not from now on: by now it may have come to where it waits.
    let moment = |running: &Running| running.fly_to(random_s(seed, STRUCK_S));
    strike(&held.running, victims, signal, moment);
    held.release()
}

/// Hash of the flight of [`fly_and_strike`] when nothing happens.
fn undisturbed_hash() -> &'static str {
    static HASH: OnceLock<String> = OnceLock::new();
    HASH.get_or_init(|| {
        let flown = fly_released(&FLIGHT, HELD_AT);
        flown.assert_clean();
        flown.hash().to_owned()
    })
}

/// Seconds that only `seed` decides about.
fn random_s(seed: usize, within_s: f64) -> f64 {
    ChaCha8Rng::seed_from_u64(seed as u64).random_range(0.0..within_s)
}

/// Waits for a moment of the next `within_s` of the flight that only `seed` decides about.
fn random_moment(running: &Running, seed: usize, within_s: f64) {
    running.fly_on(random_s(seed, within_s));
}

/// Strikes processes once `moment` has come. They are looked for before, so that little can come between the moment and
/// the signal.
fn strike(running: &Running, victims: &[&str], signal: Signal, moment: impl FnOnce(&Running)) {
    let find = |name: &&str| wait_for(name, || running.process(name).ok_or_else(String::new)).pid;
    let pids: Vec<u32> = victims.iter().map(find).collect();
    moment(running);
    for pid in pids {
        assert!(kill(pid, signal), "{victims:?} and {pid}");
    }
}

/// A flight that only what happens to it ends.
fn endless(more: &[&str]) -> Running {
    Running::start_and_fly(&[&["figure8-morph", "--for", "600s"], &PACE[..], more].concat())
}

fn in_realtime(duration: &str, more: &[&str]) -> Running {
    let base = ["hover", "--clock", "realtime", "--for", duration];
    Running::start_and_fly(&[&base[..], more].concat())
}

/// The flight went on after one crash that was reported, and its recording is complete.
fn assert_recovered(flown: &Flown, victim: &str, how: &str) {
    assert_eq!(flown.code, Some(0), "{}", flown.output_text());
    assert_eq!(flown.verdict(), "PASSED", "{}", flown.output_text());
    assert!(flown.stderr.contains(&format!("{victim} {how}")), "{}", flown.output_text());
    assert!(flown.number("recovered_crashes") >= 1.0, "{}", flown.output_text());
    assert!(flown.number("dropped_samples") == 0.0, "{}", flown.output_text());
    assert_nothing_left(flown);
    assert!(flown.recording().count_messages_of_a_complete_file() > 1000);
}

fn assert_nothing_left(flown: &Flown) {
    let run = flown.text("run");
    assert!(processes_of(run).is_empty(), "{:?}", processes_of(run));
    // Another test that looks at runs may hold the last leaver's lock for a moment.
    wait_until("nothing is left", || left_in_shared_memory(run).is_empty());
}

fn assert_the_next_run_works() {
    let flown = fly(&["hover", "--for", "1s"]);
    flown.assert_clean();
    assert_nothing_left(&flown);
}

#[test]
fn a_silence_of_the_imu_is_counted_and_the_gate_flies_until_it_ends() {
    let silence = "plant.imu.drop_outs=[{ from_s = 2.0, until_s = 2.1 }]";
    let flown = fly(&["hover", "--for", "5s", "--in-process", "--set", silence]);
    // The scenario states why, so that the verdict asks for no more than a recovery.
    assert_eq!(flown.verdict(), "PASSED", "{}", flown.output_text());
    assert_eq!(flown.summary()["safe_mode_episodes"], 1, "{}", flown.output_text());
    // The last sample is of 1.999 s, and 20 ms are integrated.
    assert_eq!(flown.summary()["imu_overdue_steps"], 80, "{}", flown.output_text());
    assert!(flown.number("position_max_m") < 0.25, "{}", flown.output_text());
    assert!(flown.number("position_last_second_m") < 0.05, "{}", flown.output_text());
}

fn strike_in_lockstep(victim: &str) {
    for round in 0..rounds(1) {
        let flown = fly_and_strike(&[], &[victim], Signal::KILL, round * 7 + victim.len());
        assert_recovered(&flown, victim, "killed by signal 9");
        assert_eq!(flown.hash(), undisturbed_hash(), "round {round}: {}", flown.output_text());
    }
}

#[test]
fn a_killed_estimator_leaves_no_trace_in_a_lockstep_flight() {
    strike_in_lockstep("estimator");
}

#[test]
fn a_killed_position_controller_leaves_no_trace_in_a_lockstep_flight() {
    strike_in_lockstep("position-mpc");
}

#[test]
fn a_killed_attitude_controller_leaves_no_trace_in_a_lockstep_flight() {
    strike_in_lockstep("attitude-mpc");
}

#[test]
fn a_killed_injector_leaves_no_trace_in_a_lockstep_flight() {
    strike_in_lockstep("disturbance-injector");
}

#[test]
fn a_killed_pilot_leaves_no_trace_in_a_lockstep_flight() {
    strike_in_lockstep("pilot");
}

/// What two neighbours had between them dies with both, so the hash may be another one.
#[test]
fn all_killed_at_once_come_back_and_the_vehicle_stays_on_its_way() {
    for round in 0..rounds(1) {
        let flown = fly_and_strike(&[], &MORTALS, Signal::KILL, round);
        for victim in MORTALS {
            assert_recovered(&flown, victim, "killed by signal 9");
        }
        assert!(flown.number("position_max_m") <= 0.15, "{}", flown.output_text());
    }
}

#[test]
fn a_process_that_got_sigterm_is_restarted_and_leaves_no_trace() {
    let flown = fly_and_strike(&[], &["attitude-mpc"], Signal::TERM, 11);
    assert_recovered(&flown, "attitude-mpc", "exit status 130");
    assert_eq!(flown.hash(), undisturbed_hash(), "{}", flown.output_text());
}

#[test]
fn a_stopped_process_is_killed_restarted_and_leaves_no_trace() {
    for (round, victim) in ["attitude-mpc", "position-mpc", "estimator"].into_iter().enumerate() {
        let limit = ["--set", "launcher.stall_timeout_s=2"];
        let flown = fly_and_strike(&limit, &[victim], Signal::STOP, round);
        assert_recovered(&flown, victim, "made no progress");
        assert_eq!(flown.hash(), undisturbed_hash(), "{victim}: {}", flown.output_text());
    }
}

/// A candidate that has just joined never receives the progress of a stopped process, and cannot step for that reason.
#[test]
fn a_candidate_is_not_killed_for_a_stopped_process_that_it_waits_for() {
    let limit = ["--set", "launcher.stall_timeout_s=2"];
    let held = Held::start(&[&FLIGHT[..], &limit].concat(), HELD_AT);
    wait_until("it waits for the candidate", || held.running.flown_s() >= Some(7.0));
    held.running.signal("position-mpc", Signal::STOP);
    let flown = held.release();
    assert_recovered(&flown, "position-mpc", "made no progress");
    assert!(!flown.stderr.contains("held made no progress"), "{}", flown.output_text());
    assert_eq!(flown.summary()["swaps"][0]["done"], true, "{}", flown.output_text());
    assert_eq!(flown.hash(), undisturbed_hash(), "{}", flown.output_text());
}

/// As where other programs have all there is for a moment. In a slot another controller takes over instead.
#[test]
fn a_process_that_cannot_be_started_for_a_moment_is_started_once_it_can() {
    let slowly = ["hover", "--clock", "realtime", "--speed", "0.1", "--for", "600s"];
    let mut running = Running::start_and_fly(&slowly);
    let launcher = i32::try_from(running.launcher_pid()).ok().and_then(Pid::from_raw);
    let allow = |descriptors: u64| {
        let maximum = getrlimit(Resource::Nofile).maximum;
        let limit = Rlimit { current: Some(descriptors), maximum };
        prlimit(launcher, Resource::Nofile, limit).expect("our own child")
    };
    let open = fs::read_dir(format!("/proc/{}/fd", running.launcher_pid())).expect("its files");
    let before = allow(open.count() as u64).current.expect("a limit");
    let killed = running.signal("estimator", Signal::KILL);
    running.fly_on(0.2);
    allow(before);
    wait_until("it is there again", || {
        running.process("estimator").is_some_and(|process| process.pid != killed)
    });
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!(flown.code, Some(130), "{}", flown.output_text());
    let said = "estimator cannot be started: Too many open files";
    assert!(flown.stderr.contains(said), "{}", flown.output_text());
}

/// No other process can do its work, so that it is dealt with as if it had been stopped from outside.
#[test]
fn a_monitor_that_the_script_stops_is_restarted_and_leaves_no_trace() {
    let flight = ["hover", "--for", "3s"];
    let stop = ["--set", "launcher.stall_timeout_s=1", "--fault", "stop:monitor@1s"];
    let flown = fly(&[&flight[..], &stop].concat());
    assert_recovered(&flown, "monitor", "made no progress");
    assert_eq!(flown.hash(), fly(&flight).hash(), "{}", flown.output_text());
}

/// The candidate is let through at the instant at which the owner stops. Time stands still while it is flown ahead, and
/// what the script has for that instant comes afterwards, as it does where nothing is flown ahead.
#[test]
fn a_fault_at_the_instant_of_a_verdict_is_the_same_with_a_rehearsal() {
    let arguments = ["--swap", "attitude=attitude-lqr@500ms,shadow=260ms,rollback=300ms"];
    let arguments =
        [&["hover", "--for", "2s", "--fault", "stop:attitude-mpc@760ms"], &arguments[..]];
    let rehearsed = fly(&arguments.concat());
    let unrehearsed =
        fly(&[&arguments.concat()[..], &["--set", "rehearsal.enabled=false"]].concat());
    for flown in [&rehearsed, &unrehearsed] {
        let swap = &flown.summary()["swaps"][0];
        assert_eq!(swap["done"], true, "{}", flown.output_text());
    }
    assert_eq!(rehearsed.summary()["hash"], unrehearsed.summary()["hash"]);
}

/// The controller that comes back receives what the one that dies then has published before, but not if that one dies
/// before it has served its new reader: this is left to chance unless the death waits for it.
#[test]
fn a_death_at_the_instant_of_another_ones_return_is_the_same_every_time() {
    let faults = ["--fault", "kill:attitude-mpc@1226ms", "--fault", "kill:position-mpc@1326ms"];
    let arguments = ["hover", "--for", "2s", "--no-record", "--goto", "0.3,0.2,1.4@800ms"];
    let hash = || fly(&[&arguments[..], &faults].concat()).hash().to_owned();
    let first = hash();
    for _ in 0..6 {
        assert_eq!(hash(), first);
    }
}

/// A window shorter than the time that is allowed ahead of the slowest process ends at the same instant, whether all of
/// that time is allowed at once or little by little: an owner that dies soon after has a fallback in both or in neither.
#[test]
fn a_short_rollback_window_ends_at_one_instant_at_every_pace() {
    let arguments = ["--swap", "attitude=attitude-mpc@668ms,shadow=260ms,rollback=230ms"];
    let arguments =
        [&["hover", "--for", "2s", "--fault", "kill:attitude-mpc@1170ms"], &arguments[..]];
    let at_once = fly(&arguments.concat());
    for pace in [&["--speed", "8"][..], &["--in-process"]] {
        let other = fly(&[&arguments.concat()[..], pace, &["--no-record"]].concat());
        assert_eq!(other.summary()["hash"], at_once.summary()["hash"], "{pace:?}");
    }
}

/// What the flight began with takes the place of a newcomer that has died twice, and dies before its first state: the
/// last one of the seat is of another layout, which it could not go on from.
#[test]
fn a_controller_that_dies_before_its_first_state_goes_on_from_none() {
    let mut arguments = vec!["hover", "--for", "3s", "--set", "rehearsal.enabled=false"];
    arguments.extend(["--swap", "attitude=attitude-pid@500ms,shadow=300ms,rollback=300ms"]);
    arguments.extend([
        "--fault",
        "kill:attitude-pid@1300ms",
        "--fault",
        "kill:attitude-pid@1602ms",
    ]);
    arguments.extend(["--fault", "kill:attitude-mpc@1706ms"]);
    let flown = fly(&arguments);
    flown.assert_flown("killed between its start and its first step");
    assert_eq!(flown.summary()["wrong_owner_ticks"], 0, "{}", flown.output_text());
    let alone = fly(&[&arguments[..], &["--in-process", "--no-record"]].concat());
    assert_eq!(alone.summary()["hash"], flown.summary()["hash"], "{}", alone.output_text());
}

/// A script that starts the controller and waits for it is no more than its name, in processes and in one.
#[test]
fn a_controller_that_a_script_has_started_flies_and_ends_with_the_script() {
    let folder = TempDir::new().expect("a folder");
    let script = folder.path().join("wrapped");
    let content = format!("#!/bin/sh\n'{}' \"$@\" &\nwait $!\n", rogue());
    make_executable(&script, content.as_bytes());
    let config = config(&folder, "nothing", 0.0, 0.0);
    let swap =
        format!("attitude={}@500ms,shadow=500ms,rollback=400ms,config={config}", script.display());
    let flight = ["hover", "--for", "4s", "--swap", &swap];
    let apart = fly(&[&flight[..], &["--fault", "kill:wrapped@3s"]].concat());
    assert_eq!((apart.code, apart.verdict()), (Some(0), "PASSED"), "{}", apart.output_text());
    assert_eq!(apart.summary()["swaps"][0]["done"], true, "{}", apart.output_text());
    let expected = "attitude-mpc@0 takes over from wrapped@1: its process ended";
    assert!(apart.stderr.contains(expected), "{}", apart.output_text());
    assert_nothing_left(&apart);
    let alone = fly(&[&flight[..], &["--in-process"]].concat());
    assert_eq!(alone.verdict(), "PASSED", "{}", alone.output_text());
    assert_eq!(alone.summary()["swaps"][0]["done"], true, "{}", alone.output_text());
    let left: Vec<_> = all_processes().filter(|p| p.arguments.contains(&config)).collect();
    assert!(left.is_empty(), "{left:?}");
}

/// However long a busy machine takes for the restarts, the flight lasts until it is interrupted.
#[test]
fn a_realtime_flight_goes_on_after_the_deaths_of_all_processes_but_the_plant() {
    let mut running = in_realtime("600s", &[]);
    for victim in MORTALS {
        let first = running.signal(victim, Signal::KILL);
        wait_until("the successor", || running.process(victim).is_some_and(|p| p.pid != first));
    }
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!(flown.code, Some(INTERRUPTED), "{}", flown.output_text());
    for victim in MORTALS {
        let killed = format!("{victim} killed by signal 9");
        // The launcher gives up a controller whose commands fail to come for a constant 200 ms, so that on a busy
        // machine it may do so before it is notified of the death. Only a controller can be reported so, and only with
        // this reason.
        let given_up = format!(
            "no fallback for {victim}@0, and the slot waits for a new process: its commands failed to come"
        );
        let is_reported = [killed, given_up].iter().any(|report| flown.stderr.contains(report));
        assert!(is_reported, "{victim}: {}", flown.output_text());
    }
    assert!(flown.number("recovered_crashes") >= 4.0, "{}", flown.output_text());
    assert_nothing_left(&flown);
    assert!(flown.recording().count_messages_of_a_complete_file() > 100);
}

/// Time is held for a candidate that has joined; how long that takes by the wall clock is nothing to it.
#[test]
fn a_launcher_that_is_stopped_for_six_seconds_in_lockstep_leaves_no_trace() {
    let scenario = ["hover", "--for", "4s"];
    let expected = fly_released(&scenario, "1s");
    let flown = Held::start(&scenario, "1s").release_while_the_launcher_is_stopped(6.0);
    assert_eq!((flown.code, flown.hash()), (Some(0), expected.hash()), "{}", flown.output_text());
}

/// How far the vehicle drifts meanwhile is a matter of the clock; that it comes back is not. Time runs slowly, so that
/// it is not on the ground before the launcher goes on.
#[test]
fn an_owner_that_dies_while_the_launcher_is_stopped_for_three_seconds_is_replaced() {
    let mut running = in_realtime("600s", &["--speed", "0.2"]);
    let mut spectator = Spectator::join(running.id());
    spectator.fly_on(0.2);
    let place_w_m = spectator.look().0.position_w_m;
    assert!(kill(running.launcher_pid(), Signal::STOP));
    let owner = running.process("attitude-mpc").expect("it flies");
    assert!(kill(owner.pid, Signal::KILL));
    spectator.fly_on(3.0 * 0.2);
    assert_eq!(spectator.look().1.mode, GateMode::Level, "nothing commands");
    assert!(kill(running.launcher_pid(), Signal::CONT));
    spectator.wait_until("the vehicle is back in its place", |truth, applied| {
        let speed_m_s = distance(&truth.velocity_w_m_s, &[0.0; 3]);
        let is_there = distance(&truth.position_w_m, &place_w_m) < 0.05;
        is_there && speed_m_s < 0.1 && applied.mode == GateMode::Normal
    });
    drop(spectator);
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!(flown.code, Some(INTERRUPTED), "{}", flown.output_text());
    assert!(
        flown.output_text().contains("this launcher stood still for"),
        "{}",
        flown.output_text()
    );
    // The owner records and commands that it could not read meanwhile are judged by when they were in effect.
    assert_eq!(flown.summary()["wrong_owner_ticks"], 0, "{}", flown.output_text());
}

#[test]
fn the_death_of_the_plant_ends_the_flight_with_4_a_reason_and_a_complete_recording() {
    for round in 0..rounds(1) {
        for realtime in [false, true] {
            let mut running = if realtime { in_realtime("600s", &[]) } else { endless(&[]) };
            let moment = |running: &Running| random_moment(running, round, 1.0);
            strike(&running, &["plant"], Signal::KILL, moment);
            let flown = running.wait();
            assert_eq!(flown.code, Some(CRASHED), "{}", flown.output_text());
            assert!(flown.reason().contains("plant killed by signal 9"), "{}", flown.output_text());
            assert_eq!(flown.verdict(), "CRASHED", "{}", flown.output_text());
            assert!(flown.recording().count_messages_of_a_complete_file() > 100);
            assert_nothing_left(&flown);
            assert_the_next_run_works();
        }
    }
}

/// Kills the launcher and waits until the rest has gone by itself.
fn assert_all_leave_after_the_launcher(mut running: Running) {
    let id = running.id().to_owned();
    let recording = running.recording_path().expect("it flies");
    assert!(kill(running.launcher_pid(), Signal::KILL));
    wait_until("all processes leave", || processes_of(&id).is_empty());
    // Another test that looks at runs may hold the last leaver's lock for a moment.
    wait_until("nothing is left", || left_in_shared_memory(&id).is_empty());
    assert!(Recording::read(&recording).count_messages_of_a_cut_file() > 100);
    let flown = running.wait();
    assert_eq!(flown.code, None, "{}", flown.stderr);
    assert!(flown.stderr.contains("launcher") && flown.stderr.contains("died"), "{}", flown.stderr);
    assert_the_next_run_works();
}

#[test]
fn when_the_launcher_dies_all_processes_leave_after_the_grace_and_nothing_is_left() {
    let no_grace = ["--set", "launcher.launcher_grace_s=0"];
    for round in 0..rounds(1) {
        let running = endless(&no_grace);
        random_moment(&running, round, 1.0);
        assert_all_leave_after_the_launcher(running);
        let running = in_realtime("600s", &no_grace);
        random_moment(&running, round + 1, 1.0);
        assert_all_leave_after_the_launcher(running);
    }
}

#[test]
fn a_controller_that_hangs_does_not_outlive_the_launcher() {
    let folder = TempDir::new().expect("a folder");
    let hangs = config(&folder, "never-ready", 0.0, 0.0);
    let swap = format!("attitude={}@200ms,config={hangs}", rogue());
    let running = endless(&["--set", "launcher.launcher_grace_s=0", "--swap", &swap]);
    wait_until("the candidate is there", || running.process(rogue()).is_some());
    let id = running.id().to_owned();
    running.kill_launcher();
    wait_until("all processes leave", || processes_of(&id).is_empty());
    // It has left as one that is killed does.
    assert_the_next_run_works();
    wait_until("nothing is left", || left_in_shared_memory(&id).is_empty());
}

#[test]
fn a_run_killed_as_a_whole_is_cleaned_up_by_the_next_one() {
    let mut running = endless(&[]);
    let id = running.id().to_owned();
    // The launcher first, or it would restart the others.
    assert!(kill(running.launcher_pid(), Signal::KILL));
    let victims = processes_of(&id);
    for victim in &victims {
        kill(victim.pid, Signal::KILL);
    }
    running.wait();
    wait_until("all are dead", || victims.iter().all(|victim| is_dead(victim.pid)));
    assert_the_next_run_works();
    wait_until("nothing is left", || left_in_shared_memory(&id).is_empty());
}

#[test]
fn one_interrupt_ends_the_flight_in_order_with_a_complete_recording() {
    let endless = ["figure8-morph", "--for", "600s", "--speed", "15"];
    let realtime = ["hover", "--clock", "realtime", "--for", "60s"];
    for (signal, flights) in [
        (Signal::INT, vec![&endless[..], &realtime]),
        (Signal::TERM, vec![&endless[..], &realtime]),
        // A terminal that is closed, and Ctrl-\\.
        (Signal::HUP, vec![&endless[..]]),
        (Signal::QUIT, vec![&realtime[..]]),
    ] {
        for flight in flights {
            let mut running = Running::start_and_fly(flight);
            random_moment(&running, 1, 1.0);
            assert!(kill(running.launcher_pid(), signal));
            let flown = running.wait();
            assert_eq!(flown.code, Some(INTERRUPTED), "{}", flown.output_text());
            assert_eq!(flown.text("ended"), "interrupted");
            assert!(flown.stderr.contains("interrupted"), "{}", flown.output_text());
            // In order: no process had to be killed, nothing was lost, all loops end together. Where the launcher gets
            // no processor for seconds its recorder loses samples, and reports that.
            let has_lost = flown.number("dropped_samples") > 0.0;
            let verdict = if has_lost { "FAILED" } else { "INCOMPLETE" };
            assert_eq!(flown.verdict(), verdict, "{}", flown.output_text());
            if !flight.contains(&"realtime") {
                assert!(!has_lost, "{}", flown.output_text());
                assert_eq!(flown.summary()["recovered_crashes"], 0, "{}", flown.output_text());
            }
            assert!(
                flown.number("flown_s") > 0.0 && flown.number("flown_s") < 60.0,
                "{}",
                flown.output_text()
            );
            assert!(flown.recording().count_messages_of_a_complete_file() > 100);
            assert_nothing_left(&flown);
        }
    }
}

#[test]
fn an_interrupted_flight_ends_in_order_however_slow_one_of_its_loops_is() {
    let folder = TempDir::new().expect("a folder");
    let slow = config(&folder, "late", 1.2, 0.6);
    let swap = format!("attitude={}@500ms,shadow=500ms,config={slow},no-rehearsal", rogue());
    let mut running = Running::start(&["hover", "--for", "600s", "--swap", &swap]);
    wait_until("it is slow", || running.flown_s() > Some(1.25));
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!(
        (flown.code, flown.verdict()),
        (Some(INTERRUPTED), "INCOMPLETE"),
        "{}",
        flown.output_text()
    );
    assert_nothing_left(&flown);
}

#[test]
fn a_second_interrupt_waits_for_no_process() {
    let mut running = endless(&[]);
    // With this one stopped, there is no orderly end to wait for.
    running.signal("estimator", Signal::STOP);
    assert!(kill(running.launcher_pid(), Signal::INT));
    wait_until("it answers after one interrupt", || running.flown_s().is_some());
    running.interrupt_until_it_ends();
    let flown = running.wait();
    assert_eq!(flown.code, Some(INTERRUPTED), "{}", flown.output_text());
    assert!(flown.recording().count_messages_of_a_complete_file() > 100);
    assert_nothing_left(&flown);
}

#[test]
fn another_build_that_hangs_is_ended_by_a_signal_and_leaves_nothing() {
    let flown = fly(&["hover", "--for", "100ms"]);
    let folder = TempDir::new().expect("a folder");
    let hanging = folder.path().join("hanging");
    make_executable(&hanging, b"#!/bin/sh\necho $$ > \"$0.pid\"\nexec sleep 600\n");
    let temporary = folder.path().join("tmp");
    fs::create_dir(&temporary).expect("a folder");
    for signal in [Signal::INT, Signal::TERM] {
        let mut command = morphquad(["replay"]);
        command.arg(flown.recording_path()).arg("--with").arg(&hanging);
        command.args(["--service", "attitude-mpc", "--format", "json"]);
        let child = command.env("TMPDIR", &temporary).spawn().expect("the executable starts");
        let pid = folder.path().join("hanging.pid");
        let started = || fs::read_to_string(&pid).ok()?.trim().parse::<u32>().ok();
        wait_until("the other build hangs", || started().is_some());
        assert!(kill(child.id(), signal));
        let output = child.wait_with_output().expect("an end");
        let complaint: Value = serde_json::from_slice(&output.stdout).expect("a complaint");
        assert_eq!(
            (output.status.code(), &complaint["exit"]),
            (Some(INTERRUPTED), &INTERRUPTED.into()),
            "{complaint}"
        );
        assert_eq!(fs::read_dir(&temporary).expect("a folder").count(), 0);
        let hung = started().expect("its number");
        assert!(!Path::new(&format!("/proc/{hung}")).exists(), "the other build still runs");
        fs::remove_file(&pid).expect("there until now");
    }
}
