//! Flights where memory is short: shared memory, or what a group of processes may have, as a container is one.
//!
//! Each has a namespace of its own, whose `/dev/shm` and control groups the test makes; it is left out where that is not
//! permitted.

use crate::common::time::wait_until;
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// Writes into a file until a tmpfs has only so much room left \[bytes\].
fn fill(file: &Path, left: u64) {
    let mut filler =
        std::fs::File::create(file).expect("shared memory of the launcher's namespace");
    let block = vec![1; 1 << 20];
    loop {
        let stat = rustix::fs::statvfs(file).expect("its file system");
        if stat.f_bavail * stat.f_frsize < left + block.len() as u64 {
            return;
        }
        filler.write_all(&block).expect("room for a block");
    }
}

/// Files of the control groups: the limit of memory \[bytes\] and what is used of it.
const GROUP_FILES: [[&str; 2]; 2] = [
    ["memory.max", "memory.current"],
    ["memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"],
];
const GROUP_LIMIT: u64 = 4 << 30;

/// A launcher with shared memory, and a limit of memory, of its own.
struct Apart {
    /// What keeps the namespace.
    keeper: Child,
    launcher: Child,
    recordings: TempDir,
}

impl Drop for Apart {
    fn drop(&mut self) {
        let _ = self.keeper.kill();
        let _ = self.keeper.wait();
    }
}

impl Apart {
    /// Begins a flight where `/dev/shm` has so many megabytes; none where that is not permitted.
    fn fly(size_mb: u64, flight: &str) -> Option<Self> {
        let mut unshare = Command::new("unshare");
        let own = format!(
            "mount -t tmpfs -o size={size_mb}m tmpfs /dev/shm && mount -t tmpfs tmpfs /sys/fs/cgroup && \
             mkdir /sys/fs/cgroup/memory && echo ready && exec sleep 600"
        );
        let unshare = unshare.args(["--mount", "sh", "-c", &own]).stderr(Stdio::null());
        let mut keeper = unshare.stdout(Stdio::piped()).spawn().expect("a shell");
        let mut line = String::new();
        let stdout = keeper.stdout.take().expect("a pipe");
        BufReader::new(stdout).read_line(&mut line).expect("words or none");
        if line != "ready\n" {
            keeper.wait().expect("it has ended");
            return None;
        }
        let recordings = TempDir::new().expect("a folder for the recording");
        for [limit, _] in GROUP_FILES {
            let file = inside(keeper.id(), "sys/fs/cgroup").join(limit);
            std::fs::write(file, GROUP_LIMIT.to_string()).expect("our own folder");
        }
        let launcher =
            launch(&keeper, &recordings, &[&["run"], &split_arguments(flight)[..]].concat());
        let flight = Self { keeper, launcher, recordings };
        flight.use_memory(0);
        Some(flight)
    }

    /// Sets how much of the limit is used \[bytes\].
    fn use_memory(&self, used: u64) {
        for [_, file] in GROUP_FILES {
            let file = inside(self.keeper.id(), "sys/fs/cgroup").join(file);
            std::fs::write(file, used.to_string()).expect("our own folder");
        }
    }

    /// Kills the launcher and has another one take over.
    fn adopt(&mut self) {
        self.launcher.kill().expect("it runs");
        self.launcher.wait().expect("it has ended");
        self.launcher = launch(&self.keeper, &self.recordings, &["adopt"]);
        wait_until("the next one leads", || self.inside(&["ps"]).status.success());
    }

    fn inside(&self, arguments: &[&str]) -> Output {
        within(&self.keeper)
            .args(arguments)
            .output()
            .expect("a command in the launcher's namespace")
    }

    /// Orders a swap; its exit code, and its stderr in one line.
    fn swap(&self, arguments: &[&str]) -> (Option<i32>, String) {
        let swap = self.inside(&[&["swap"], arguments].concat());
        let stderr = String::from_utf8_lossy(&swap.stderr).replace(['│', '\n'], " ");
        (swap.status.code(), stderr.split_whitespace().collect::<Vec<_>>().join(" "))
    }

    fn wait_until_flown(&mut self, until_s: f64) {
        wait_until("it flies", || {
            assert_eq!(self.launcher.try_wait().expect("a child"), None, "it has ended");
            let status = self.inside(&["ps", "--format", "json"]).stdout;
            let status = serde_json::from_slice::<Value>(&status).unwrap_or_default();
            status["flown_s"].as_f64().is_some_and(|flown_s| flown_s > until_s)
        });
    }

    fn shared_memory(&self) -> PathBuf {
        inside(self.keeper.id(), "dev/shm")
    }

    /// Takes all of its shared memory but so much.
    fn fill(&self, left: u64) -> PathBuf {
        let filler = self.shared_memory().join("filler");
        fill(&filler, left);
        filler
    }

    /// Ends the flight, which must have been running.
    fn stop(mut self) {
        assert!(self.inside(&["stop"]).status.success());
        assert_eq!(self.launcher.wait().expect("it ends").code(), Some(130));
    }
}

/// A file as the process sees it.
fn inside(pid: u32, path: &str) -> PathBuf {
    Path::new("/proc").join(pid.to_string()).join("root").join(path)
}

/// The executable in the namespace of the keeper.
fn within(keeper: &Child) -> Command {
    let mut command = Command::new("nsenter");
    let pid = keeper.id().to_string();
    command.args(["--target", &pid, "--mount", env!("CARGO_BIN_EXE_morphquad")]);
    command
}

fn launch(keeper: &Child, recordings: &TempDir, arguments: &[&str]) -> Child {
    let mut command = within(keeper);
    command.args(arguments).arg("--record").arg(recordings.path());
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a launcher")
}

fn split_arguments(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// A process that joins, and those that it talks to, would die of SIGBUS as soon as they touch memory that is not there.
#[test]
fn no_process_is_started_in_flight_where_shared_memory_is_short() {
    let Some(mut flight) = Apart::fly(165, "hover --for 600s --speed 1") else { return };
    flight.wait_until_flown(0.5);
    let filler = flight.fill(4 << 20);
    let (code, stderr) = flight.swap(&["attitude", "--to", "attitude-pid"]);
    assert_ne!(code, Some(0), "{stderr}");
    assert!(stderr.contains("is not started: /dev/shm has"), "{stderr}");
    std::fs::remove_file(&filler).expect("our own file");
    let (code, stderr) = flight.swap(&["attitude", "--to", "attitude-pid", "--no-rehearsal"]);
    assert_eq!(code, Some(0), "{stderr}");
    flight.stop();
}

/// The kernel would kill a process of the group, and may choose the plant.
#[test]
fn no_process_is_started_in_flight_where_the_group_may_have_no_more_memory() {
    let Some(mut flight) = Apart::fly(600, "hover --for 600s --speed 1") else { return };
    flight.wait_until_flown(0.5);
    flight.use_memory(GROUP_LIMIT - (20 << 20));
    let (code, stderr) = flight.swap(&["attitude", "--to", "attitude-pid"]);
    assert_ne!(code, Some(0), "{stderr}");
    assert!(stderr.contains("is not started: /sys/fs/cgroup/memory"), "{stderr}");
    assert!(stderr.contains("leaves 20 MB of memory"), "{stderr}");
    let again = flight.inside(&["run", "hover", "--for", "1s", "--no-record"]);
    let stderr = String::from_utf8_lossy(&again.stderr);
    assert_eq!(again.status.code(), Some(3), "{stderr}");
    assert!(stderr.contains("too little memory for a flight"), "{stderr}");
    flight.use_memory(0);
    let (code, stderr) = flight.swap(&["attitude", "--to", "attitude-pid", "--no-rehearsal"]);
    assert_eq!(code, Some(0), "{stderr}");
    flight.stop();
}

/// Of the run's objects, those that have not all of their memory.
fn unreserved(flight: &Apart) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(flight.shared_memory()).expect("its folder").flatten();
    let files = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file()));
    let short = files
        .filter(|entry| entry.metadata().is_ok_and(|found| 512 * found.blocks() < found.len()));
    short.map(|entry| entry.path()).collect()
}

/// Its rings go on being filled for two seconds, so that it writes to memory that it has not touched before.
#[test]
fn a_realtime_flight_without_locked_memory_goes_on_where_all_of_it_is_taken() {
    let flight = "hover --clock realtime --for 600s --set realtime.lock_memory=false";
    let Some(mut flight) = Apart::fly(600, flight) else { return };
    flight.wait_until_flown(0.1);
    let stat = rustix::fs::statvfs(flight.shared_memory()).expect("its file system");
    let taken_mb = ((stat.f_blocks - stat.f_bfree) * stat.f_frsize) >> 20;
    assert!(taken_mb > 200, "{taken_mb} MB are reserved");
    flight.fill(1 << 20);
    flight.wait_until_flown(4.0);
    flight.stop();
}

/// What the flight has reserved already is not free any more, and need not be.
#[test]
fn a_launcher_that_takes_over_reserves_the_memory_of_what_joins() {
    let flight = "hover --clock realtime --speed 0.2 --for 600s --set realtime.lock_memory=false";
    let Some(mut flight) = Apart::fly(600, flight) else { return };
    flight.wait_until_flown(0.05);
    flight.adopt();
    let (code, stderr) = flight.swap(&["attitude", "--to", "attitude-pid", "--no-rehearsal"]);
    assert_eq!(code, Some(0), "{stderr}");
    wait_until("what has joined has its memory", || unreserved(&flight).is_empty());
    flight.stop();
}
