//! A running flight is asked from outside: through the command, and through its socket.

use crate::common::morphquad;
use crate::common::processes::{Running, kill, processes_of};
use crate::common::time::wait_until;
use rustix::process::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// A command that has ended.
struct CommandOutput {
    code: Option<i32>,
    out: String,
    diagnostics: String,
}

fn run_command(arguments: &[&str]) -> CommandOutput {
    let output = morphquad(arguments).output().expect("the executable starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    CommandOutput {
        code: output.status.code(),
        out: text(&output.stdout),
        diagnostics: text(&output.stderr),
    }
}

fn ps(run: &Running) -> Option<Value> {
    let output = run_command(&["ps", "--run", run.id(), "--format", "json"]);
    (output.code == Some(0)).then(|| serde_json::from_str(&output.out).expect("JSON"))
}

fn process<'v>(status: &'v Value, name: &str) -> &'v Value {
    let mut processes = status["processes"].as_array().expect("processes").iter();
    processes.find(|p| p["name"] == name).unwrap_or_else(|| panic!("no {name} in {status}"))
}

fn socket(run: &Running) -> PathBuf {
    PathBuf::from(format!("/dev/shm/mq-{}/control.sock", run.id()))
}

fn end(mut running: Running) {
    assert!(kill(running.launcher_pid(), Signal::INT));
    assert_eq!(running.wait().code, Some(130));
}

const REALTIME: [&str; 7] = ["hover", "--clock", "realtime", "--for", "60s", "--speed", "0.1"];
/// A lockstep flight that lasts.
const LOCKSTEP: [&str; 5] = ["hover", "--for", "60s", "--speed", "1"];

/// A flight half a second in, its status by `ps`, and its processes by name as the system lists them.
fn half_a_second_in(arguments: &[&str]) -> (Running, Value, BTreeMap<String, u64>) {
    let running = Running::start_and_fly(arguments);
    let mut seen = None;
    wait_until("half a second flown", || {
        seen = ps(&running);
        seen.as_ref().is_some_and(|status| status["flown_s"].as_f64() > Some(0.5))
    });
    let processes = processes_of(running.id()).into_iter();
    let pids = processes.map(|p| (p.arguments[0].clone(), u64::from(p.pid))).collect();
    (running, seen.expect("just seen"), pids)
}

fn assert_every_process_is_shown(arguments: &[&str]) {
    let (running, status, pids) = half_a_second_in(arguments);
    assert_eq!(status["scenario"], "hover");
    assert_eq!(status["launcher_pid"], running.launcher_pid());
    for (name, role, state, rate_hz) in [
        ("plant", "plant", "running", 1000.0),
        ("estimator", "estimator", "running", 1000.0),
        ("position-mpc", "position", "owner", 50.0),
        ("attitude-mpc", "attitude", "owner", 100.0),
        ("disturbance-injector", "disturbance", "running", 200.0),
        ("monitor", "monitor", "running", 100.0),
        ("pilot", "pilot", "running", 50.0),
    ] {
        let shown = process(&status, name);
        assert_eq!(shown["pid"].as_u64(), pids.get(name).copied(), "{shown}");
        assert_eq!((&shown["role"], &shown["state"]), (&role.into(), &state.into()));
        assert_eq!(shown["rate_hz"].as_f64(), Some(rate_hz), "{shown}");
        assert_eq!(shown["generation"], 0);
        assert!(shown["mark_s"].as_f64() > Some(0.4), "{shown}");
        assert!(shown["mark_age_s"].as_f64() < Some(60.0), "{shown}");
        assert!(shown["rss_bytes"].as_u64() > Some(1 << 20), "{shown}");
        assert!(shown["cpu_percent"].as_f64() >= Some(0.0), "{shown}");
    }
    let slots = status["slots"].as_array().expect("slots");
    let slots: Vec<_> = slots.iter().map(|s| (&s["slot"], &s["epoch"], &s["owner"])).collect();
    assert!(slots.contains(&(&"attitude".into(), &1.into(), &"attitude-mpc".into())));
    assert!(slots.contains(&(&"position".into(), &1.into(), &"position-mpc".into())));
    let table = run_command(&["ps", "--run", &running.id()[..8]]);
    assert_eq!(table.code, Some(0), "{}", table.diagnostics);
    for part in ["PROCESS", "disturbance-injector", "attitude-mpc", "owner", running.id()] {
        assert!(table.out.contains(part), "{part}: {}", table.out);
    }
    end(running);
}

#[test]
fn ps_shows_every_process_as_the_system_does_and_the_owners_of_the_slots() {
    assert_every_process_is_shown(&LOCKSTEP);
}

#[test]
fn ps_shows_every_process_of_a_realtime_flight_as_the_system_does() {
    assert_every_process_is_shown(&REALTIME);
}

#[test]
fn a_restarted_process_is_shown_with_its_new_number_and_generation() {
    let running = Running::start_and_fly(&LOCKSTEP);
    let first = running.signal("attitude-mpc", Signal::KILL);
    wait_until("the successor", || {
        let Some(status) = ps(&running) else { return false };
        let shown = process(&status, "attitude-mpc");
        let back = shown["generation"] == 1 && shown["state"] == "owner";
        assert!(!back || (shown["pid"].is_u64() && shown["pid"] != first), "{shown}");
        back
    });
    let status = ps(&running).expect("still there");
    let slots = status["slots"].as_array().expect("slots");
    let owned = |s: &Value| s["slot"] == "attitude" && s["owner"] == "attitude-mpc";
    assert!(slots.iter().any(owned), "{status}");
    end(running);
}

#[test]
fn a_run_that_is_not_there_or_not_named_ends_with_2_and_lists_which_there_are() {
    let unknown = run_command(&["ps", "--run", "no-such-run"]);
    assert_eq!((unknown.code, unknown.out.as_str()), (Some(2), ""));
    assert!(
        unknown.diagnostics.contains("no run is called no-such-run"),
        "{}",
        unknown.diagnostics
    );
    let runs = [Running::start_and_fly(&LOCKSTEP), Running::start_and_fly(&LOCKSTEP)];
    let several = run_command(&["ps"]);
    assert_eq!((several.code, several.out.as_str()), (Some(2), ""));
    for run in &runs {
        assert!(several.diagnostics.contains(run.id()), "{}", several.diagnostics);
        assert!(ps(run).is_some());
    }
    assert!(several.diagnostics.contains("--run"), "{}", several.diagnostics);
    let [first, second] = runs;
    let id = first.id().to_owned();
    end(first);
    assert_eq!(run_command(&["ps", "--run", &id]).code, Some(2));
    end(second);
}

#[test]
fn an_order_that_makes_no_sense_ends_with_2_and_the_flight_goes_on() {
    let running = Running::start_and_fly(&LOCKSTEP);
    let id = running.id();
    for (order, expected) in [
        (&["swap", "altitude", "--to", "attitude-mpc"][..], "slot"),
        (&["swap", "attitude", "--to", "./nowhere/controller"], "×"),
        (&["swap", "attitude", "--to", "attitude-mpc", "--max-bump", "lots"], "write 1% or 0.01"),
        (&["swap", "attitude", "--to", "attitude-mpc", "--shadow", "soon"], "--shadow"),
        (&["swap", "attitude"], "--to"),
        (&["rollback", "altitude"], "slot"),
        (&["retire", "no-such-process"], "×"),
        (&["standby", "altitude", "attitude-mpc"], "slot"),
    ] {
        let output = run_command(&[order, &["--run", id]].concat());
        assert_eq!((output.code, output.out.as_str()), (Some(2), ""), "{}", output.diagnostics);
        assert!(output.diagnostics.contains(expected), "{order:?}: {}", output.diagnostics);
        let output = run_command(&[order, &["--run", "no-such-run"]].concat());
        assert_eq!(output.code, Some(2), "{}", output.diagnostics);
    }
    assert!(ps(&running).is_some());
    end(running);
}

#[test]
fn a_launcher_that_was_killed_leaves_its_run_listed_and_unanswered_until_it_is_gone() {
    // Grace and landing are times of the flight, for which the test waits.
    let short = ["hover", "--clock", "realtime", "--for", "60s"];
    let grace = ["--set", "launcher.launcher_grace_s=5"];
    let running = Running::start_and_fly(&[&short[..], &grace].concat());
    running.kill_launcher();
    let mut output = run_command(&["ps", "--run", running.id()]);
    wait_until("no launcher answers", || {
        output = run_command(&["ps", "--run", running.id()]);
        output.code != Some(0)
    });
    assert_eq!(output.code, Some(3), "{}", output.diagnostics);
    let line = output.diagnostics.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(line.contains("has died") && line.contains("morphquad adopt"), "{line}");
    wait_until("the last process has left", || {
        run_command(&["ps", "--run", running.id()]).code == Some(2)
    });
}

/// As in a container that shares the host's memory: the system has no number for a client that is outside of the
/// launcher's namespace. To make one takes rights that not every machine gives.
#[test]
fn a_launcher_in_a_pid_namespace_of_its_own_follows_orders_from_outside() {
    let unshare = || {
        let mut unshare = Command::new("unshare");
        unshare.args(["--pid", "--fork", "--kill-child", "--mount-proc"]);
        unshare.stdout(Stdio::null()).stderr(Stdio::null());
        unshare
    };
    if !unshare().arg("true").status().is_ok_and(|status| status.success()) {
        return;
    }
    let folder = TempDir::new().expect("a folder for the recording");
    let mut launcher = unshare();
    launcher.arg(env!("CARGO_BIN_EXE_morphquad")).arg("run").args(LOCKSTEP);
    launcher.arg("--record").arg(folder.path());
    let mut launcher = launcher.spawn().expect("a launcher");
    let mut id = String::new();
    wait_until("it answers", || {
        let ended = launcher.try_wait().expect("a child");
        assert_eq!(ended, None, "it has ended");
        let mut files = folder.path().read_dir().expect("the folder").flatten();
        let Some(recording) = files.next() else { return false };
        id = recording.path().file_stem().expect("a name").to_string_lossy().into_owned();
        run_command(&["ps", "--run", &id]).code == Some(0)
    });
    let output = run_command(&["stop", "--run", &id]);
    assert_eq!(output.code, Some(0), "{}", output.diagnostics);
    assert_eq!(launcher.wait().expect("it ends").code(), Some(130));
}

#[test]
fn proc_of_another_namespace_is_refused_with_the_remedy() {
    let mut unshare = Command::new("unshare");
    unshare.args(["--pid", "--fork", "--kill-child"]);
    if !Command::new("unshare")
        .args(["--pid", "--fork", "true"])
        .status()
        .is_ok_and(|s| s.success())
    {
        return;
    }
    let executable = env!("CARGO_BIN_EXE_morphquad");
    let output = unshare.args([executable, "run", "hover", "--for", "1s", "--no-record"]).output();
    let output = output.expect("a launcher");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    assert!(stderr.contains("--mount-proc"), "{stderr}");
}

#[test]
fn the_socket_is_private_and_what_strangers_do_to_it_disturbs_nothing() {
    let running = Running::start_and_fly(&LOCKSTEP);
    let mode = std::fs::metadata(socket(&running)).expect("the socket").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    let connect = || UnixStream::connect(socket(&running)).expect("the launcher listens");
    let mut silent = connect();
    silent.write_all(b"{\"requ").expect("room for seven bytes");
    let mut garbage = connect();
    garbage.write_all(b"\x00\xffGET / HTTP/1.1\r\n\r\n").expect("room for a line");
    let mut answer = String::new();
    let _ = garbage.read_to_string(&mut answer);
    let refusal: Value = serde_json::from_str(&answer).expect("a refusal");
    assert_eq!((&refusal["reply"], &refusal["exit_code"]), (&"refused".into(), &2.into()));
    let mut flood = connect();
    let _ = flood.write_all(&vec![b'x'; 1 << 20]);
    drop(connect());
    // Any language can ask.
    let mut plain = connect();
    plain.write_all(b"{\"request\":\"ps\"}\n").expect("room for a line");
    let mut line = String::new();
    BufReader::new(plain).read_line(&mut line).expect("an answer");
    let status: Value = serde_json::from_str(&line).expect("JSON");
    assert_eq!((&status["reply"], &status["run"]), (&"status".into(), &running.id().into()));
    assert!(ps(&running).is_some());
    end(running);
}
