//! A realtime flight whose launcher is killed goes on: alone for a grace, then under the next launcher, or
//! down to the ground. All of it by the wall clock, so only survival and order are asserted.

use crate::common::misdeeds::{config, config_from, rogue};
use crate::common::processes::{Running, kill, left_in_shared_memory, processes_of, ps};
use crate::common::recording::Recording;
use crate::common::spectator::Spectator;
use crate::common::time::{wait_for, wait_until};
use crate::common::{distance, morphquad};
use rustix::process::Signal;
use serde_json::Value;
use shared_types::{AppliedCommand, Truth};
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// A launcher that takes over.
struct Adopter(Child);

impl Adopter {
    fn start(run: &str) -> Self {
        let adopter = morphquad(["adopt", run, "--format", "json"]).spawn();
        Self(adopter.expect("the executable starts"))
    }

    /// What it has written to stderr, once it has ended.
    fn stderr_so_far(&mut self) -> String {
        let mut text = String::new();
        if let Some(stderr) = self.0.stderr.as_mut() {
            std::io::Read::read_to_string(stderr, &mut text).expect("text");
        }
        text
    }

    /// Waits for its end: exit code, summary and stderr.
    fn end(self) -> (Option<i32>, Value, String) {
        let Output { status, stdout, stderr } = self.0.wait_with_output().expect("an end");
        let stderr = String::from_utf8_lossy(&stderr).into_owned();
        (status.code(), serde_json::from_slice(&stdout).unwrap_or(Value::Null), stderr)
    }
}

/// A child of the test in the process group of another process. The kernel wakes the stopped processes of a group
/// that becomes an orphan, as one does whose only parent outside is the launcher when it dies.
struct GroupMember(Child);

impl GroupMember {
    fn beside(leader: u32) -> Self {
        let group = i32::try_from(leader).expect("a process");
        let member = Command::new("sleep").arg("infinity").process_group(group).spawn();
        Self(member.expect("`sleep` starts"))
    }
}

impl Drop for GroupMember {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn realtime(more: &[&str]) -> Running {
    Running::start_and_fly(&[&["hover", "--clock", "realtime"], more].concat())
}

/// A flight in which all deadlines are ten times as long, so that none is missed on a busy machine.
fn slowly(more: &[&str]) -> Running {
    realtime(&[&["--speed", "0.1"], more].concat())
}

/// Exit code of a command, and its stdout and stderr in one line.
fn run_command(arguments: &[&str]) -> (Option<i32>, String) {
    let output = morphquad(arguments).output().expect("the executable starts");
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).replace("\n  │", "");
    (output.status.code(), text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Process in the attitude slot that is `owner` or `fallback`, and its seat.
fn in_attitude(run: &str, state: &str) -> Option<(u64, u64)> {
    let status = ps(run)?;
    let mut processes = status["processes"].as_array()?.iter();
    let found = processes.find(|p| p["role"] == "attitude" && p["state"] == state)?;
    Some((found["pid"].as_u64()?, found["seat"].as_u64()?))
}

fn strike(pid: u64, signal: Signal) {
    assert!(kill(u32::try_from(pid).expect("a process"), signal), "{pid} has gone");
}

fn stand_by(run: &str) {
    let order = ["standby", "attitude", "attitude-mpc", "--shadow", "400ms", "--run", run];
    let result = run_command(&order);
    assert_eq!(result.0, Some(0), "{result:?}");
}

fn assert_nothing_left(run: &str) {
    wait_until("all processes leave", || processes_of(run).is_empty());
    wait_until("nothing is left", || left_in_shared_memory(run).is_empty());
}

fn continued_by(path: &Path) -> String {
    let bytes = fs::read(path).expect("a recording");
    let summary = mcap::Summary::read(&bytes).expect("an end").expect("a summary");
    let index = summary.metadata_indexes.iter().find(|index| index.name == "run");
    let metadata = mcap::read::metadata(&bytes, index.expect("facts"));
    metadata.expect("metadata").metadata["continues"].clone()
}

#[test]
fn without_a_launcher_the_fallback_takes_over_and_the_next_launcher_goes_on() {
    let running = slowly(&["--for", "60s"]);
    let (run, first) = (running.id().to_owned(), running.recording_path().expect("it records"));
    stand_by(&run);
    let (owner, _) = in_attitude(&run, "owner").expect("an owner");
    let (standby, _) = in_attitude(&run, "fallback").expect("a standby");
    let flown_s = ps(&run).and_then(|status| status["flown_s"].as_f64()).expect("a running flight");
    running.kill_launcher();
    strike(owner, Signal::KILL);
    wait_until("all but the dead fly on", || processes_of(&run).len() == 7);
    let adopter = Adopter::start(&run);
    let mut now = None;
    wait_until("the standby commands under the new launcher", || {
        now = ps(&run).filter(|status| status["launcher_pid"] == adopter.0.id());
        now.is_some() && in_attitude(&run, "owner").is_some_and(|(pid, _)| pid == standby)
    });
    let now = now.expect("just seen");
    let pilot = now["processes"].as_array().expect("processes").iter();
    assert!(pilot.clone().any(|p| p["name"] == "pilot" && p["generation"] == 0), "{now}");
    let swap = ["swap", "attitude", "--to", "attitude-mpc", "--shadow", "400ms", "--run", &run];
    let swap = [&swap[..], &["--rollback", "100ms"]].concat();
    let mut result = (None, String::new());
    // First the lost standby is replaced, which a swap has to wait for.
    wait_until("a swap", || {
        result = run_command(&swap);
        result.0 == Some(0)
    });
    assert!(kill(adopter.0.id(), Signal::INT));
    let (code, summary, stderr) = adopter.end();
    assert_eq!(code, Some(130), "{summary} {stderr}");
    assert!(stderr.contains("took run") && stderr.contains(&run), "{stderr}");
    assert_eq!(summary["ended"], "interrupted", "{summary} {stderr}");
    assert_eq!(summary["verdict"]["verdict"], "INCOMPLETE", "{summary} {stderr}");
    assert!(summary["flown_s"].as_f64() < Some(60.0), "{summary}");
    assert!(summary["position_max_m"].as_f64() <= Some(0.5), "{summary}");
    let first = Recording::read(&first);
    assert!(first.count_messages_of_a_cut_file() > 100);
    let lost_ms = 1e3 * (flown_s - first.end_of_a_cut_file("truth"));
    println!("of what had been drained when its launcher was killed, {lost_ms:.0} ms are lost");
    let second: PathBuf = summary["recording"].as_str().expect("a recording").into();
    assert!(second.ends_with(format!("{run}-adopted-1.mcap")), "{}", second.display());
    let recording = Recording::read(&second);
    assert!(recording.count_messages_of_a_complete_file() > 1000);
    let records = recording.series("attitude_owner", &["epoch"]);
    let ticks = recording.series("applied_command", &["epoch"]);
    assert!(records[0].t_s < ticks[0].t_s, "the record then in effect is there: {records:?}");
    assert_eq!(continued_by(&second), format!("{run}.mcap"));
    let (code, output_text) = run_command(&["replay", &second.to_string_lossy(), "--verify"]);
    assert_eq!(code, Some(2), "{output_text}");
    assert!(output_text.contains(&format!("a continuation of {run}.mcap")), "{output_text}");
    assert_nothing_left(&run);
}

/// Loops without which nothing commands; they have one seat, and the one that is taken of several.
const LOST: [&str; 4] = ["estimator", "attitude-mpc", "position-mpc", "pilot"];

/// The one process of each of these loops that runs, without those that were killed.
fn one_of_each_lost(run: &str, killed: &[u32]) -> Result<[u32; 4], String> {
    let processes = processes_of(run);
    let mut found = [0; 4];
    for (found, name) in found.iter_mut().zip(LOST) {
        let of_name = processes.iter().filter(|p| p.arguments[0] == name).map(|p| p.pid);
        let pids: Vec<u32> = of_name.filter(|pid| !killed.contains(pid)).collect();
        let [pid] = pids[..] else { return Err(format!("{name}: {pids:?}")) };
        *found = pid;
    }
    Ok(found)
}

/// If a launcher dies as it takes over, the next one ends the processes that it has started and not yet led on, starts
/// others, and announces these to the flight. Those that it has led on fly on.
#[test]
fn what_dies_without_a_launcher_is_started_once_however_many_take_over() {
    let running = slowly(&["--for", "60s"]);
    let run = running.id().to_owned();
    running.kill_launcher();
    let killed = LOST.map(|name| running.signal(name, Signal::KILL));
    let mut first = Adopter::start(&run);
    let of_first = wait_for("the first starts them", || one_of_each_lost(&run, &killed));
    first.0.kill().expect("it leads");
    first.0.wait().expect("it ends");
    let adopter = Adopter::start(&run);
    // Once the second leads, one process of each loop runs, and the flight knows this one.
    let running_and_flown = || -> Result<([u32; 4], f64), String> {
        let status = ps(&run).ok_or("no launcher answers")?;
        let pids = one_of_each_lost(&run, &killed)?;
        let processes = status["processes"].as_array().ok_or("no processes")?;
        let runs = |pid: u32| {
            let mut of_pid = processes.iter().filter(|p| p["pid"] == pid);
            of_pid.any(|p| p["state"] == "running" || p["state"] == "owner")
        };
        let is_led = status["launcher_pid"] == adopter.0.id();
        match status["flown_s"].as_f64() {
            Some(flown_s) if is_led && pids.into_iter().all(runs) => Ok((pids, flown_s)),
            _ => Err(format!("{pids:?} {status}")),
        }
    };
    let (pids, ran_s) = wait_for("they run", running_and_flown);
    wait_for("the same ones fly on", || match running_and_flown()? {
        (now, flown_s) if now != pids || flown_s > ran_s + 0.05 => {
            assert_eq!(now, pids, "none is started twice");
            Ok(())
        }
        (_, flown_s) => Err(format!("{flown_s} s")),
    });
    assert!(kill(adopter.0.id(), Signal::INT));
    let (code, summary, stderr) = adopter.end();
    assert_eq!(code, Some(130), "{summary} {stderr}");
    for ((name, pid), of_first) in LOST.into_iter().zip(pids).zip(of_first) {
        let text = format!("{name} has died while the flight had no launcher");
        let is_slot = name.ends_with("-mpc");
        assert!(is_slot || stderr.contains(&text) == (pid != of_first), "{name}: {stderr}");
    }
    assert_eq!(summary["restarts"], 0, "{summary} {stderr}");
    assert_nothing_left(&run);
}

/// Before its slot has asked for it, or after: it is the slot's to start again.
#[test]
fn a_controller_that_a_new_launcher_has_started_and_that_dies_is_started_again() {
    let name = "position-mpc";
    let running = slowly(&["--for", "60s"]);
    let run = running.id().to_owned();
    running.kill_launcher();
    let mut gone = vec![running.signal(name, Signal::KILL)];
    let adopter = Adopter::start(&run);
    let of_name = || processes_of(&run).into_iter().filter(|p| p.arguments[0] == name);
    let next = |gone: &[u32]| of_name().map(|p| p.pid).find(|pid| !gone.contains(pid));
    let mut second = None;
    wait_until("another one", || {
        second = next(&gone);
        second.is_some()
    });
    gone.extend(second.filter(|pid| kill(*pid, Signal::KILL)));
    let mut status = None;
    let owns = |status: &Value| {
        let mut processes = status["processes"].as_array().into_iter().flatten();
        processes.any(|p| p["name"] == name && p["state"] == "owner" && p["pid"] != gone[1])
    };
    wait_for("a third one commands", || {
        status = ps(&run);
        if status.as_ref().is_some_and(owns) { Ok(()) } else { Err(format!("{status:?}")) }
    });
    assert!(kill(adopter.0.id(), Signal::INT));
    let (code, summary, stderr) = adopter.end();
    assert_eq!(code, Some(130), "{summary} {stderr}");
    assert_nothing_left(&run);
}

#[test]
fn a_process_that_writes_in_the_place_of_a_dead_launcher_is_not_followed() {
    // After it has written for a while, and while it frees what the dead launcher has left.
    for lines in [3, 0] {
        assert_not_followed(lines);
    }
}

/// As long as the usurper has not written so many lines nothing takes over. It writes two in a second.
fn assert_not_followed(lines: usize) {
    let running = slowly(&["--for", "60s"]);
    let run = running.id().to_owned();
    running.kill_launcher();
    let mut usurper = Command::new(rogue());
    usurper.args(["usurp", &format!("/dev/shm/mq-{run}")]).stdout(Stdio::piped());
    let mut usurper = usurper.spawn().expect("it starts");
    let mut written = BufReader::new(usurper.stdout.take().expect("a pipe")).lines();
    let mut writes = || written.next().expect("it goes on").expect("a line");
    (0..lines).for_each(|_| drop(writes()));
    let mut adopter = Adopter::start(&run);
    wait_until("another launcher leads", || {
        assert!(matches!(adopter.0.try_wait(), Ok(None)), "{:?}", adopter.stderr_so_far());
        ps(&run).is_some_and(|status| status["launcher_pid"] == adopter.0.id())
    });
    writes();
    let flown_s = || ps(&run).and_then(|status| status["flown_s"].as_f64()).unwrap_or(0.0);
    let written_s = flown_s();
    wait_until("it flies on", || flown_s() > written_s + 0.1);
    assert!(matches!(usurper.try_wait(), Ok(None)), "it still writes");
    // The last process of a run, if it is killed, leaves the run's files for the next run to remove.
    usurper.kill().expect("it is there");
    usurper.wait().expect("it ends");
    assert!(kill(adopter.0.id(), Signal::INT));
    let (code, summary, stderr) = adopter.end();
    assert_eq!(code, Some(130), "{summary} {stderr}");
    assert!(summary["position_max_m"].as_f64() <= Some(0.5), "{summary}");
    assert_eq!(summary["wrong_owner_ticks"], 0, "{summary}");
    let named = format!("process {} (rogue) publishes without being registered on", usurper.id());
    assert!(stderr.contains(&named), "{stderr}");
    assert_nothing_left(&run);
}

/// The watch needs no launcher: it is a process of the flight, and each consumer follows its trips by itself.
#[test]
fn without_a_launcher_an_owner_that_turns_away_is_tripped_and_the_fallback_flies_on() {
    let (rogue, folder) = (rogue(), TempDir::new().expect("a folder"));
    let running = slowly(&["--for", "60s"]);
    let run = running.id().to_owned();
    let mut spectator = Spectator::join(&run);
    let proven = in_attitude(&run, "owner").expect("an owner");
    let turns = folder.path().join("turns");
    let config = config_from(&folder, "gain", &turns, -1.0);
    let swap = ["swap", "attitude", "--to", rogue, "--config", &config, "--shadow", "400ms"];
    let swap = [&swap[..], &["--rollback", "100ms", "--no-rehearsal", "--run", &run]].concat();
    let mut result = (None, String::new());
    wait_until("a swap", || {
        result = run_command(&swap);
        result.0 == Some(0)
    });
    let bad = in_attitude(&run, "owner").expect("an owner");
    assert_ne!(bad, proven, "{result:?}");
    running.kill_launcher();
    fs::write(&turns, "").expect("room");
    spectator.wait_until("it is tripped, and the proven one commands", |_, applied| {
        applied.tripped.is_set() && u64::from(applied.seat) == proven.1
    });
    drop(spectator);
    let adopter = Adopter::start(&run);
    wait_until("the new launcher", || {
        ps(&run).is_some_and(|status| status["launcher_pid"] == adopter.0.id())
    });
    wait_until("the proven owner commands", || in_attitude(&run, "owner") == Some(proven));
    assert!(kill(adopter.0.id(), Signal::INT));
    let (code, summary, stderr) = adopter.end();
    assert_eq!(code, Some(130), "{summary} {stderr}");
    assert_eq!(summary["verdict"]["verdict"], "INCOMPLETE", "{summary} {stderr}");
}

/// What it writes goes through pipes whose other ends its launcher had.
#[test]
fn a_controller_that_prints_outlives_its_launcher_and_the_next_one_shows_it() {
    let (rogue, folder) = (rogue(), TempDir::new().expect("a folder"));
    let config = config(&folder, "prints", 0.0, 1.0);
    let running = realtime(&["--for", "600s", "--set", "launcher.launcher_grace_s=600"]);
    let run = running.id().to_owned();
    let swap = ["swap", "attitude", "--to", rogue, "--config", &config, "--shadow", "400ms"];
    let how = ["--rollback", "100ms", "--no-rehearsal", "--force", "--run", &run];
    wait_for("a swap", || {
        let (code, output_text) = run_command(&[&swap[..], &how].concat());
        if code == Some(0) { Ok(()) } else { Err(output_text) }
    });
    running.kill_launcher();
    let flown_s = || ps(&run).and_then(|status| status["flown_s"].as_f64()).unwrap_or(0.0);
    let adopter = Adopter::start(&run);
    wait_until("the new launcher", || {
        ps(&run).is_some_and(|status| status["launcher_pid"] == adopter.0.id())
    });
    let taken_s = flown_s();
    wait_until("it flies on", || flown_s() > taken_s + 0.5);
    assert!(kill(adopter.0.id(), Signal::INT));
    let (code, summary, stderr) = adopter.end();
    assert_eq!(code, Some(130), "{summary} {stderr}");
    assert!(stderr.contains("rogue: line 0\n"), "{stderr}");
    // It would have been that of a pipe without a reader.
    assert!(!stderr.contains("last words"), "{stderr}");
    assert_nothing_left(&run);
}

#[test]
fn without_a_launcher_to_take_over_the_vehicle_lands_and_nothing_is_left() {
    let mut running = realtime(&["--for", "60s", "--set", "launcher.launcher_grace_s=0.5"]);
    let run = running.id().to_owned();
    assert!(kill(running.launcher_pid(), Signal::KILL));
    assert_nothing_left(&run);
    let flown = running.wait();
    assert!(flown.stderr.contains("morphquad adopt") && flown.stderr.contains("lands"));
    let (code, output_text) = run_command(&["adopt", &run]);
    assert_eq!(code, Some(2), "{output_text}");
    assert!(output_text.contains(&format!("no run is called {run}")), "{output_text}");
}

/// However slowly time runs, and from wherever the vehicle has been sent.
#[test]
fn without_a_launcher_the_processes_land_before_they_leave() {
    for (speed, height_m) in [("0.5", None), ("1", Some(4.0))] {
        let grace = ["--for", "600s", "--set", "launcher.launcher_grace_s=0.5"];
        let running = realtime(&[&grace[..], &["--speed", speed]].concat());
        let run = running.id().to_owned();
        let mut spectator = Spectator::join(&run);
        if let Some(height_m) = height_m {
            let order = ["goto", "0", "0", &format!("{height_m}"), "--run", &run];
            let result = run_command(&order);
            assert_eq!(result.0, Some(0), "{result:?}");
            spectator.wait_until("it is there", |truth, _| truth.position_w_m[2] > 0.9 * height_m);
        }
        running.kill_launcher();
        spectator.wait_until("it lands", |truth, _| {
            truth.position_w_m[2] < 0.1 && distance(&truth.velocity_w_m_s, &[0.0; 3]) < 0.05
        });
        drop(spectator);
        assert_nothing_left(&run);
    }
}

#[test]
fn without_a_launcher_an_order_is_flown_and_without_a_pilot_too_the_vehicle_lands() {
    let running = realtime(&["--for", "600s", "--set", "launcher.launcher_grace_s=600"]);
    let run = running.id().to_owned();
    // Beside the dead launcher's there is no room for a third.
    let (mut spectator, other) = (Spectator::join(&run), Spectator::join(&run));
    let result = run_command(&["goto", "1", "0", "1.5", "--run", &run]);
    running.kill_launcher();
    assert_eq!(result.0, Some(0), "{result:?}");
    let goal = [1.0, 0.0, 1.5];
    let is_there = |truth: &Truth, _: &AppliedCommand| distance(&truth.position_w_m, &goal) < 0.1;
    spectator.wait_until("it is there", is_there);
    running.signal("pilot", Signal::KILL);
    spectator.wait_until("it lands", |truth, _| truth.position_w_m[2] < 0.1);
    let adopter = Adopter::start(&run);
    spectator.wait_until("another pilot leads it back", is_there);
    drop((spectator, other));
    assert!(kill(adopter.0.id(), Signal::INT));
    let (code, summary, stderr) = adopter.end();
    assert_eq!(code, Some(130), "{summary} {stderr}");
    assert!(stderr.contains("pilot has died while the flight had no launcher"), "{stderr}");
    assert_nothing_left(&run);
}

/// A run is not taken over by a launcher that another program starts like this; it flies on.
fn assert_refused_under(program: &str, run: &str, why: &str) {
    let mut words = program.split(' ');
    let mut command = Command::new(words.next().expect("a program"));
    command.args(words).args([env!("CARGO_BIN_EXE_morphquad"), "adopt", run]);
    let output = command.output().expect("util-linux");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{program}: {stderr}");
    assert!(stderr.contains(why), "{program}: {stderr}");
}

#[test]
fn a_run_that_is_led_or_in_lockstep_is_not_adopted_and_of_two_launchers_one_wins() {
    let running = realtime(&["--for", "600s", "--set", "launcher.launcher_grace_s=600"]);
    let run = running.id().to_owned();
    let launcher = running.launcher_pid();
    let (code, output_text) = run_command(&["adopt", &run]);
    assert_eq!(code, Some(3), "{output_text}");
    assert!(output_text.contains(&format!("process {launcher} leads it")), "{output_text}");
    running.kill_launcher();
    let notes = PathBuf::from(format!("/dev/shm/mq-{run}/launcher.json"));
    let ours = fs::read_to_string(&notes).expect("notes");
    let mut other: Value = serde_json::from_str(&ours).expect("JSON");
    other["author"]["layouts"]["Imu"] = "0000000000000000".into();
    fs::write(&notes, other.to_string()).expect("room");
    let (code, output_text) = run_command(&["adopt", &run]);
    assert_eq!(code, Some(3), "{output_text}");
    assert!(output_text.contains("Imu is laid out otherwise"), "{output_text}");
    fs::write(&notes, ours).expect("room");
    assert_refused_under("prlimit --nofile=256:256", &run, "may open 256 files");
    if Command::new("unshare").args(["--pid", "true"]).status().is_ok_and(|s| s.success()) {
        assert_refused_under("unshare --pid --fork", &run, "--mount-proc");
        let elsewhere = "in the PID namespace in which it was started";
        assert_refused_under("unshare --pid --fork --mount-proc", &run, elsewhere);
    }
    let mut adopters = [Adopter::start(&run), Adopter::start(&run)];
    let mut lost = None;
    wait_until("one of them loses", || {
        lost = adopters.iter_mut().position(|a| !matches!(a.0.try_wait(), Ok(None)));
        lost.is_some()
    });
    let [first, second] = adopters;
    let (winner, loser) = if lost == Some(0) { (second, first) } else { (first, second) };
    let leader = winner.0.id();
    let (code, _, stderr) = loser.end();
    assert_eq!(code, Some(3), "{stderr}");
    assert!(stderr.contains(&format!("process {leader} leads it")), "{stderr}");
    wait_until("the winner leads", || {
        ps(&run).is_some_and(|status| status["launcher_pid"] == leader)
    });
    assert!(kill(leader, Signal::INT));
    let (code, summary, stderr) = winner.end();
    assert_eq!((code, &summary["ended"]), (Some(130), &"interrupted".into()), "{summary} {stderr}");
    let rest = summary["recording"].as_str().expect("a recording");
    assert!(Recording::read(Path::new(rest)).count_messages_of_a_complete_file() > 100);
    assert!(rest.ends_with("adopted-1.mcap"), "what was refused has left a recording: {rest}");
    assert_nothing_left(&run);

    let lockstep = Running::start_and_fly(&["hover", "--for", "60s", "--speed", "1"]);
    let run = lockstep.id().to_owned();
    // The run is there for as long as one of its processes, however late it is asked for.
    let companion = GroupMember::beside(lockstep.signal("monitor", Signal::STOP));
    lockstep.kill_launcher();
    let (code, output_text) = run_command(&["adopt", &run]);
    assert_eq!(code, Some(2), "{output_text}");
    assert!(
        output_text.contains("lockstep") && output_text.contains("leave within 2 s"),
        "{output_text}"
    );
    lockstep.signal("monitor", Signal::CONT);
    drop(companion);
    assert_nothing_left(&run);
}

#[test]
fn an_adopted_flight_ends_as_planned() {
    let running = slowly(&["--for", "1.5s"]);
    running.kill_launcher();
    let (code, summary, stderr) = Adopter::start(running.id()).end();
    assert!(matches!(code, Some(0 | 1)), "{code:?} {stderr}");
    assert_eq!(summary["ended"], "as planned", "{summary} {stderr}");
    assert!(summary["flown_s"].as_f64() >= Some(1.5), "{summary}");
}
