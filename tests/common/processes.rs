//! A running flight and its processes, seen from outside through /proc and /dev/shm.

use super::recording::Recording;
use super::time::wait_until;
use super::{Flown, Place, judged, morphquad};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use tempfile::TempDir;

/// About what a second of a flight takes in its recording.
const RECORDED_BYTES_PER_S: f64 = 1.7e6;

/// Makes a file that may be executed. Another process writes it: a child that a test beside this one is starting
/// would hold it open for writing for a moment, and the system starts no such file.
pub(crate) fn make_executable(path: &Path, bytes: &[u8]) {
    let content = path.with_extension("content");
    fs::write(&content, bytes).expect("room");
    let made = Command::new("install").args(["-m", "755"]).arg(&content).arg(path).status();
    assert!(made.expect("it starts").success(), "{}", path.display());
}

/// Sends a signal to one process; false if it is gone.
pub(crate) fn kill(pid: u32, signal: Signal) -> bool {
    let pid = i32::try_from(pid).ok().and_then(Pid::from_raw).expect("a process id");
    kill_process(pid, signal).is_ok()
}

/// True once a process has ended and has given up its files, whether or not its parent has been notified.
pub(crate) fn is_dead(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok();
    let state = stat.and_then(|stat| stat.rsplit_once(") ")?.1.chars().next());
    state.is_none_or(|state| state == 'Z')
}

/// One process of a run.
#[derive(Debug, Clone)]
pub(crate) struct Process {
    pub(crate) pid: u32,
    pub(crate) comm: String,
    pub(crate) arguments: Vec<String>,
}

/// Every living process, other than its launcher, whose arguments name the run `id`.
pub(crate) fn processes_of(id: &str) -> Vec<Process> {
    let folder = format!("/dev/shm/mq-{id}");
    all_processes().filter(|p| p.arguments.contains(&folder)).collect()
}

pub(crate) fn all_processes() -> impl Iterator<Item = Process> {
    let entries = fs::read_dir("/proc").expect("/proc").flatten();
    entries.filter_map(|entry| {
        let pid = entry.file_name().to_str()?.parse().ok()?;
        // A process that has gone in the meantime has no files; a zombie has no command line.
        let line = fs::read_to_string(entry.path().join("cmdline")).ok()?;
        let comm = fs::read_to_string(entry.path().join("comm")).ok()?.trim_end().to_owned();
        let arguments = line.split_terminator('\0').map(str::to_owned).collect::<Vec<_>>();
        (!arguments.is_empty()).then_some(Process { pid, comm, arguments })
    })
}

/// A command in a terminal of its own, with what is typed and shown as pipes.
pub(crate) fn in_a_terminal(command: &str) -> Child {
    let mut script = Command::new("script");
    script.args(["-qfc", command, "/dev/null"]).stdin(Stdio::piped()).stdout(Stdio::piped());
    script.spawn().expect("a terminal")
}

/// The status that `ps` prints of a run; none while its launcher does not answer.
pub(crate) fn ps(run: &str) -> Option<Value> {
    let output = morphquad(["ps", "--run", run, "--format", "json"]).output();
    serde_json::from_slice(&output.expect("the executable starts").stdout).ok()
}

/// Everything that a run has in shared memory.
pub(crate) fn left_in_shared_memory(id: &str) -> Vec<PathBuf> {
    let (folder, object) = (format!("mq-{id}"), format!("mqshm-{id}_"));
    let entries = fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
    let paths = entries.map(|entry| entry.path()).filter(|path| {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        name.is_some_and(|name| name.contains(&folder) || name.starts_with(&object))
    });
    paths.collect()
}

/// A running flight. Nothing of it survives the test.
pub(crate) struct Running {
    launcher: Option<Child>,
    pid: u32,
    folder: Option<TempDir>,
    id: String,
    /// Of a flight by the wall clock.
    place: Option<Place>,
}

impl Running {
    /// Starts a run and waits until it has its processes.
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let folder = TempDir::new().expect("a folder for the recording");
        let place = arguments.contains(&"realtime").then(Place::for_realtime);
        let mut command = morphquad(["run"]);
        command.args(arguments).args(judged(arguments));
        command.args(["--format", "json", "--record"]).arg(folder.path());
        let launcher = command.spawn().expect("the executable starts");
        let pid = launcher.id();
        let mut running =
            Self { launcher: Some(launcher), pid, folder: Some(folder), id: String::new(), place };
        running.wait_in_flight("the recording", |running| running.recording_path().is_some());
        let path = running.recording_path().expect("just seen");
        running.id = path.file_stem().expect("a name").to_string_lossy().into_owned();
        running
    }

    /// As [`Running::start`], and waits until a sample of the flight is recorded: not until the file grows, since a
    /// flight that waits for a candidate stands still, and all that it flew before may be in the file at the first
    /// look.
    pub(crate) fn start_and_fly(arguments: &[&str]) -> Self {
        let mut running = Self::start(arguments);
        // A candidate of its script may be there as soon as these are.
        running.wait_in_flight("its processes", |running| processes_of(&running.id).len() >= 7);
        running.wait_in_flight("the first samples", |running| {
            running.recording_path().is_some_and(|path| Recording::read(&path).has_begun("truth"))
        });
        running
    }

    /// Waits for something of a flight; if it ends without that, the failure shows why.
    fn wait_in_flight(&mut self, what: &str, is_there: impl Fn(&Self) -> bool) {
        wait_until(what, || {
            let is_over = self.has_ended();
            let is_there = is_there(self);
            assert!(is_there || !is_over, "ended before {what}: {}", self.wait().output_text());
            is_there
        });
    }

    /// Waits until about so much more of the flight has been recorded \[s\], however long that takes.
    pub(crate) fn fly_on(&self, flown_s: f64) {
        self.fly_to(self.recorded_s() + flown_s);
    }

    /// Waits until about so much of the flight has been recorded \[s\], however long that takes.
    pub(crate) fn fly_to(&self, flown_s: f64) {
        wait_until("more of the flight", || self.recorded_s() >= flown_s);
    }

    /// About how much of the flight has been recorded \[s\].
    fn recorded_s(&self) -> f64 {
        let bytes = self.recording_path().and_then(|p| fs::metadata(p).ok()).map_or(0, |m| m.len());
        bytes as f64 / RECORDED_BYTES_PER_S
    }

    pub(crate) fn id(&self) -> &str {
        &self.id
    }

    pub(crate) fn launcher_pid(&self) -> u32 {
        self.pid
    }

    pub(crate) fn recording_path(&self) -> Option<PathBuf> {
        let folder: &Path = self.folder.as_ref()?.path();
        fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).next()
    }

    /// The process that fills a service now, if any.
    pub(crate) fn process(&self, name: &str) -> Option<Process> {
        processes_of(&self.id).into_iter().find(|p| p.arguments[0] == name)
    }

    /// Sends a signal to the process of a service, and returns its process id. A process that is just being
    /// restarted, for whatever reason, gets it as soon as it is there.
    pub(crate) fn signal(&self, name: &str, signal: Signal) -> u32 {
        let mut pid = 0;
        wait_until(&format!("{name} gets a signal"), || {
            let process = self.process(name);
            pid = process.as_ref().map_or(0, |process| process.pid);
            process.is_some_and(|process| kill(process.pid, signal))
        });
        pid
    }

    /// Kills the launcher and waits until it is dead, of which it may be asked otherwise.
    pub(crate) fn kill_launcher(&self) {
        assert!(kill(self.pid, Signal::KILL), "it had gone");
        wait_until("the launcher is dead", || is_dead(self.pid));
    }

    /// Interrupts it again and again until it has ended, as an impatient user does.
    pub(crate) fn interrupt_until_it_ends(&mut self) {
        wait_until("the launcher gives up", || {
            kill(self.pid, Signal::INT);
            self.has_ended()
        });
    }

    /// How much of the flight is flown \[s\], as `ps` prints it; none while it does not answer.
    pub(crate) fn flown_s(&self) -> Option<f64> {
        ps(&self.id)?["flown_s"].as_f64()
    }

    fn has_ended(&mut self) -> bool {
        self.launcher.as_mut().is_some_and(|launcher| !matches!(launcher.try_wait(), Ok(None)))
    }

    /// Waits for the end of the launcher.
    pub(crate) fn wait(&mut self) -> Flown {
        let launcher = self.launcher.take().expect("waited for once");
        // A child that keeps the pipes open must not make the test wait for ever.
        let waiting = thread::spawn(move || launcher.wait_with_output());
        wait_until("the launcher leaves", || waiting.is_finished());
        let output: Output = waiting.join().expect("no panic").expect("an exit status");
        self.place = None;
        Flown::new(&output, self.folder.take().expect("there until now"))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(launcher) = &mut self.launcher {
            let _ = launcher.kill();
            let _ = launcher.wait();
        }
        for process in processes_of(&self.id) {
            kill(process.pid, Signal::KILL);
        }
    }
}
