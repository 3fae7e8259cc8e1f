//! What the machine sees of a run: separate, named processes, each with a memory of its own.

use crate::common::processes::{Process, Running, in_a_terminal, kill, processes_of, ps};
use crate::common::time::wait_until;
use crate::common::{Flown, fly, judged};
use runtime::ipc::Bus;
use rustix::process::Signal;
use serde_json::json;
use shared_types::topics;
use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

const SERVICES: [&str; 7] = [
    "plant",
    "estimator",
    "position-mpc",
    "attitude-mpc",
    "disturbance-injector",
    "monitor",
    "pilot",
];

/// A flight that lasts, and in which no process is started again because a machine is busy.
fn fly_on() -> Running {
    Running::start_and_fly(&["hover", "--for", "600s", "--speed", "1"])
}

fn end(mut running: Running) {
    assert!(kill(running.launcher_pid(), Signal::INT));
    assert_eq!(running.wait().code, Some(130));
}

fn parent_of(pid: u32) -> u32 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).expect("a living process");
    let line = status.lines().find_map(|line| line.strip_prefix("PPid:")).expect("a parent");
    line.trim().parse().expect("a number")
}

#[test]
fn the_launcher_and_seven_services_are_separate_processes_under_their_own_names() {
    let running = fly_on();
    let processes = processes_of(running.id());
    let names: BTreeSet<&str> = processes.iter().map(|p| p.arguments[0].as_str()).collect();
    assert_eq!(names, BTreeSet::from(SERVICES));
    assert_eq!(processes.len(), 7, "{processes:?}");
    for Process { pid, comm, arguments } in &processes {
        // Names of threads hold 15 characters.
        let name = arguments[0].as_str();
        assert_eq!(comm, if name == "disturbance-injector" { "disturbance" } else { name });
        assert_eq!(parent_of(*pid), running.launcher_pid());
    }
    let comm = fs::read_to_string(format!("/proc/{}/comm", running.launcher_pid()));
    assert_eq!(comm.expect("the launcher lives").trim_end(), "morphquad");
    end(running);
}

#[test]
fn a_flight_whose_executable_is_removed_still_starts_rehearses_and_swaps() {
    let folder = TempDir::new().expect("a folder for the executable");
    let executable = folder.path().join("morphquad");
    // By another process: a file that another thread's child has inherited open for writing cannot be executed.
    let copied = Command::new("cp").arg(env!("CARGO_BIN_EXE_morphquad")).arg(&executable).status();
    assert!(copied.expect("cp starts").success());
    let flight = Command::new(&executable)
        .args(["run", "hover", "--for", "3s", "--no-record", "--format", "json"])
        .args(["--swap", "attitude=attitude-lqr@500ms,shadow=500ms,rollback=500ms"])
        .args(["--fault", "kill:estimator@2500ms"])
        .args(judged(&[]))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let flight = flight.expect("the executable starts");
    // As the linker does when it builds anew; nothing but the launcher runs yet.
    fs::remove_file(&executable).expect("it can be removed");
    let flown = Flown::new(&flight.wait_with_output().expect("it ends"), folder);
    assert_eq!(flown.code, Some(0), "{}", flown.output_text());
    assert_eq!(flown.summary()["swaps"][0]["done"], true, "{}", flown.output_text());
    assert_eq!(flown.summary()["recovered_crashes"], 1, "{}", flown.output_text());
}

#[test]
fn a_runs_folder_and_memory_are_closed_to_other_users() {
    let running = fly_on();
    let folder = Path::new("/dev/shm").join(format!("mq-{}", running.id()));
    let mode = |path: &Path| fs::metadata(path).map(|m| m.permissions().mode());
    assert_eq!(mode(&folder).expect("the run's folder") & 0o777, 0o700);
    let object = format!("mqshm-{}_", running.id());
    let mut seen = 0;
    for entry in fs::read_dir("/dev/shm").expect("/dev/shm").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !name.starts_with(&object) {
            continue;
        }
        // A connection may be closed while we look.
        let Ok(mode) = mode(&entry.path()) else { continue };
        assert_eq!(mode & 0o077, 0, "{name} is {mode:o}");
        seen += 1;
    }
    assert!(seen > 50, "only {seen} objects");
    end(running);
}

/// What another user can do in a folder where all may write: name folders after the run and lock them, and try what its
/// objects permit. It prints which do, and keeps its locks until its input ends.
const ATTACK: &str = r#"
cd /dev/shm
exec 3>&1
for name in mq-mq-$1 .mq-$1; do mkdir $name && touch -d @0 $name; done
mkfifo mq-pipe$1
for object in mqshm-$1_*; do
    # What has vanished meanwhile fails all three and is not made anew.
    if dd if=/dev/null of=$object conv=nocreat,notrunc || cat $object || rm $object; then
        echo "open to all: $object" >&3
    fi >/dev/null 2>&1
done
touch mqshm-$1_forged
exec 8<mq-mq-$1 9<.mq-$1
flock 8; flock 9
echo $(ls | grep -c ^mqshm-$1_); read -r _
rm -rf mq-mq-$1 .mq-$1 mq-pipe$1 mqshm-$1_forged
"#;

#[test]
fn another_user_can_neither_wipe_a_run_nor_keep_its_successors_out() {
    const OTHER: u32 = 65534;
    if !rustix::process::geteuid().is_root() {
        return;
    }
    let running = fly_on();
    let mut attack = Command::new("sh");
    attack.args(["-c", ATTACK, "sh", running.id()]).uid(OTHER).gid(OTHER);
    attack.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut attack = attack.spawn().expect("a shell of another user");
    let mut lines = BufReader::new(attack.stdout.take().expect("a pipe")).lines();
    let objects = lines.next().expect("a line").expect("text");
    assert!(objects.parse::<u32>().is_ok_and(|count| count > 50), "{objects}");

    let listed = ps(running.id()).expect("the run is listed");
    assert_eq!(listed["run"], running.id(), "{listed}");
    let killed = running.signal("attitude-mpc", Signal::KILL);
    wait_until("its successor", || {
        running.process("attitude-mpc").is_some_and(|process| process.pid != killed)
    });
    drop(attack.stdin.take());
    attack.wait().expect("it ends");
    let mut running = running;
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!((flown.code, &flown.summary()["recovered_crashes"]), (Some(130), &json!(1)));
}

#[test]
fn truth_has_no_reader_in_the_flight_and_one_in_all_the_recorder() {
    for info in [topics::TRUTH.info, topics::ACTUATOR_STATE.info] {
        assert!(info.to.is_empty(), "{} is read by {:?}", info.name, info.to);
    }
    let running = fly_on();
    let config = format!("/dev/shm/mq-{}/iceoryx2.toml", running.id());
    let bus = Bus::join(Path::new(&config), "observer").expect("the run is there");
    let truth = bus.open_topic(&topics::TRUTH).expect("the topic is there");
    assert_eq!(truth.readers(), 1);
    assert_eq!(truth.writers(), 1);
    // Two controllers, the plant, the monitor and the recorder: the counter does count.
    let estimate = bus.open_topic(&topics::STATE_ESTIMATE).expect("the topic is there");
    assert_eq!(estimate.readers(), 5);
    drop((truth, estimate, bus));
    end(running);
}

#[test]
fn a_restarted_process_keeps_its_name_and_changes_its_number() {
    let running = fly_on();
    let first = running.signal("attitude-mpc", Signal::KILL);
    wait_until("the successor", || running.process("attitude-mpc").is_some_and(|p| p.pid != first));
    let of_successor = |p: &Process| p.arguments.windows(2).any(|w| w == ["--generation", "1"]);
    assert!(running.process("attitude-mpc").is_some_and(|p| of_successor(&p)));
    end(running);
}

/// What a flight prints in a terminal of its own in which `key` is pressed once it flies; after a flight that is
/// stopped, `then` is run.
fn flown_at_a_terminal(arguments: &str, key: u8, then: &str) -> String {
    let folder = TempDir::new().expect("a folder");
    // A busy machine may take its time.
    let patience = judged(&[]).join(" ");
    let run = format!("{} run {arguments} {patience}", env!("CARGO_BIN_EXE_morphquad"));
    let print_code = "echo \"code $?.\"";
    let shell = format!("{run} --record {}; {print_code}; {then}", folder.path().display());
    // With job control, as at a prompt.
    let command = format!("bash -m -c '{shell}'");
    let mut terminal = in_a_terminal(&command);
    let recorded = || {
        let mut files = fs::read_dir(folder.path()).expect("a folder").flatten();
        files.any(|file| file.metadata().is_ok_and(|file| file.len() > 1_000_000))
    };
    wait_until("it flies", recorded);
    terminal.stdin.as_mut().expect("a keyboard").write_all(&[key]).expect("it reads");
    let stdout = terminal.wait_with_output().expect("it ends").stdout;
    String::from_utf8_lossy(&stdout).into_owned()
}

#[test]
fn control_z_stops_a_flight_at_its_terminal_and_fg_takes_it_up() {
    let stdout = flown_at_a_terminal("hover --for 20s --speed 2", 0x1a, "fg; echo \"code $?.\"");
    assert!(stdout.contains("code 148.") && stdout.contains("code 0."), "{stdout}");
    let undisturbed = fly(&["hover", "--for", "20s"]);
    assert!(stdout.contains(&format!("hash {}", undisturbed.hash())), "{stdout}");
}

#[test]
fn control_c_at_its_terminal_ends_a_flight_in_order() {
    let stdout = flown_at_a_terminal("hover --for 600s --speed 2", 0x03, ":");
    assert!(stdout.contains("code 130.") && stdout.contains("interrupted"), "{stdout}");
}
