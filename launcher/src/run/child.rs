//! One child process: started under its own name, its last words kept.

use runtime::Place;
use rustix::process::{Pid, Signal, kill_process};
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader};
use std::os::fd::AsFd as _;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

/// Lines of standard error kept for the obituary.
const LAST_WORDS: usize = 12;

/// How an executable is told what to be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Launch {
    /// `morphquad proc NAME`, perhaps with another scenario's configuration.
    Service { config: Option<PathBuf> },
    /// Somebody's own controller of a slot, perhaps with a configuration of its own.
    Foreign { slot: &'static str, config: Option<PathBuf> },
}

/// What to start.
#[derive(Debug, Clone)]
pub(crate) struct ChildSpec {
    /// Service name, and the process's name in `ps` and `top`.
    pub(crate) name: String,
    /// Executable.
    pub(crate) executable: PathBuf,
    /// What it is told.
    pub(crate) launch: Launch,
    /// Processor to stay on, if any.
    pub(crate) cpu: Option<usize>,
    /// How much to stand back for others, if at all.
    pub(crate) nice: Option<i32>,
    /// Pause before the first start \[ns\].
    pub(crate) pause_ns: u64,
}

/// A running child.
#[derive(Debug)]
pub(super) struct RunningChild {
    child: Child,
    last_words: Arc<Mutex<VecDeque<String>>>,
    listener: Option<thread::JoinHandle<()>>,
}

impl RunningChild {
    /// Starts the process with its own process group, so that a Ctrl-C at the terminal
    /// reaches the launcher alone.
    pub(super) fn start(
        spec: &ChildSpec,
        folder: &Path,
        place: Place,
        awaits_handover: bool,
    ) -> io::Result<Self> {
        let mut command = Command::new(&spec.executable);
        let config = match &spec.launch {
            Launch::Service { config } => {
                command.arg0(&spec.name).arg("proc").arg(&spec.name);
                config
            }
            Launch::Foreign { slot, config } => {
                command.args(["--slot", slot]);
                config
            }
        };
        if let Some(config) = config {
            command.arg("--config").arg(config);
        }
        command
            .arg("--run")
            .arg(folder)
            .args(["--seat", &place.seat.to_string()])
            .args(["--generation", &place.generation.to_string()])
            .args(["--launcher-pid", &std::process::id().to_string()])
            .stdin(Stdio::null())
            .stdout(launcher_stderr())
            .stderr(Stdio::piped())
            .process_group(0);
        if let Some(cpu) = spec.cpu {
            command.args(["--cpu", &cpu.to_string()]);
        }
        if let Some(nice) = spec.nice {
            command.args(["--nice", &nice.to_string()]);
        }
        if awaits_handover {
            command.arg("--await-handover");
        }
        let mut child = command.spawn()?;
        let last_words = Arc::new(Mutex::new(VecDeque::with_capacity(LAST_WORDS)));
        let listener = child.stderr.take().map(|pipe| {
            let words = Arc::clone(&last_words);
            thread::spawn(move || listen(BufReader::new(pipe), &words))
        });
        Ok(Self { child, last_words, listener })
    }

    pub(super) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// The exit status, once there is one.
    pub(super) fn exited(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Ends the child at once.
    pub(super) fn kill(&mut self) {
        // It may have ended by itself in the meantime.
        let _ = self.child.kill();
    }

    /// Stops the child where it is, without ending it.
    pub(super) fn stop(&mut self) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        // It may have ended by itself in the meantime.
        let _ = pid.map(|pid| kill_process(pid, Signal::STOP));
    }

    /// What the child said last; call after it has exited.
    pub(super) fn last_words(&mut self) -> String {
        if let Some(listener) = self.listener.take() {
            let _ = listener.join();
        }
        let words = self.last_words.lock().unwrap_or_else(PoisonError::into_inner);
        words.iter().cloned().collect::<Vec<_>>().join("\n")
    }
}

impl Drop for RunningChild {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

/// For words that must reach the user even when the launcher no longer can.
fn launcher_stderr() -> Stdio {
    io::stderr().as_fd().try_clone_to_owned().map_or_else(|_| Stdio::null(), Stdio::from)
}

fn listen(mut pipe: impl BufRead, words: &Mutex<VecDeque<String>>) {
    let mut line = Vec::new();
    while pipe.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
        let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
        if words.len() == LAST_WORDS {
            words.pop_front();
        }
        words.push_back(String::from_utf8_lossy(&line).trim_end().to_owned());
        line.clear();
    }
}

/// `exit status 3` or `killed by signal 9`.
pub(super) fn describe(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit status {code}"),
        (None, Some(signal)) => format!("killed by signal {signal}"),
        (None, None) => "unknown exit".to_owned(),
    }
}
