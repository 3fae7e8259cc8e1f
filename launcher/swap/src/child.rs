//! One process: started under its own name, its last lines on standard error kept; or taken over
//! from a launcher that has died.

use crate::last_stderr::LastStderr;
use crate::output_pipe::OutputPipe;
use crate::relay::Relay;
use runtime::Place;
use runtime::leader::process_start;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{
    Pid, PidfdFlags, Signal, WaitId, WaitIdOptions, getpgid, kill_process_group, pidfd_open,
    pidfd_send_signal, waitid,
};
use serde::{Deserialize, Serialize};
use shared_types::Slot;
use std::io;
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

/// How long a killed process may take to be gone \[s\].
const END_LIMIT_S: i64 = 1;

/// The arguments that make an executable the process that it is to be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Launch {
    /// `morphquad proc NAME`, perhaps with another scenario's configuration.
    Service {
        /// Its configuration; none for that of the flight.
        config: Option<PathBuf>,
    },
    /// A user's own controller of a slot, perhaps with a configuration of its own.
    Foreign {
        /// The slot that it flies.
        slot: Slot,
        /// Its configuration; none for that of the flight.
        config: Option<PathBuf>,
    },
}

/// What to start.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ChildSpec {
    /// Service name, and the process's name in `ps` and `top`.
    pub name: String,
    pub executable: PathBuf,
    /// Its arguments.
    pub launch: Launch,
    /// Processor to stay on, if any.
    pub cpu: Option<usize>,
    /// How much to stand back for others, if at all.
    pub nice: Option<i32>,
    /// Pause before the first start \[ns\].
    pub pause_ns: u64,
}

/// How a process has ended.
#[derive(Debug, Clone, Copy)]
pub enum Death {
    /// As the system reports it to the parent.
    Status(ExitStatus),
    /// It was another launcher's child: that it is gone is all there is to know.
    Unseen,
}

/// A running process.
#[derive(Debug)]
pub struct RunningChild {
    hold: Hold,
    /// The controller, if what was started is a script that has started it.
    inner: Option<Caught>,
    last_stderr: LastStderr,
    /// What a controller prints; a service of this program prints on the launcher's standard error itself.
    printed: Option<Relay>,
    pipes: OutputPipes,
}

/// Numbers by which the system knows the pipes of a process.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct OutputPipes {
    /// Of its standard output, if that is a pipe.
    printed: Option<u64>,
    /// Of its standard error.
    errors: Option<u64>,
}

/// What a process is held by.
#[derive(Debug)]
enum Hold {
    /// With its status once it has been waited for: its number may be another's then.
    Child(Child, Option<ExitStatus>),
    TakenOver(Caught),
}

/// A process that is no child of this one.
#[derive(Debug)]
struct Caught {
    pid: u32,
    pidfd: OwnedFd,
}

impl Caught {
    fn of(pid: u32) -> Option<Self> {
        Some(Self { pid, pidfd: pidfd_open(raw(pid)?, PidfdFlags::empty()).ok()? })
    }

    /// Waits until the process is gone, at most so many seconds.
    fn is_gone(&self, limit_s: i64) -> bool {
        let limit = Timespec { tv_sec: limit_s, tv_nsec: 0 };
        poll(&mut [PollFd::new(&self.pidfd, PollFlags::IN)], Some(&limit))
            .is_ok_and(|ready| ready > 0)
    }
}

impl RunningChild {
    /// Starts the process with its own process group, so that a Ctrl-C at the terminal reaches the launcher alone, and
    /// that what it starts in turn can be ended with it: the executable may be a script around the controller.
    ///
    /// # Errors
    /// If the executable cannot be started.
    pub fn start(
        spec: &ChildSpec,
        folder: &Path,
        place: Place,
        awaits_handover: bool,
    ) -> io::Result<Self> {
        let errors = OutputPipe::open()?;
        let mut pipes = OutputPipes { errors: Some(errors.inode()?), printed: None };
        let mut printed = None;
        let mut inherited = Vec::new();
        let mut command = Command::new(&spec.executable);
        let config = match &spec.launch {
            Launch::Service { config } => {
                command.arg0(&spec.name).arg("proc").arg(&spec.name).stdout(launcher_stderr());
                config
            }
            Launch::Foreign { slot, config } => {
                let output = OutputPipe::open()?;
                output.enlarge();
                errors.enlarge();
                pipes.printed = Some(output.inode()?);
                command.args(["--slot", slot.label()]).stdout(output.writer);
                printed = Some(Relay::of(output.reader, &spec.name)?);
                inherited.push(output.inherited);
                config
            }
        };
        inherited.push(errors.inherited);
        let last_stderr = LastStderr::of(errors.reader)?;
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
            .stderr(errors.writer)
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
        let child = command.spawn()?;
        drop(inherited);
        Ok(Self { hold: Hold::Child(child, None), inner: None, last_stderr, printed, pipes })
    }

    /// A process that another launcher has started under a name, with these pipes; none if it is gone. What it writes
    /// is read on.
    #[must_use]
    pub fn take_over(pid: u32, started: u64, name: &str, pipes: OutputPipes) -> Option<Self> {
        // Looked at after it has been caught: a process that has been given its number since is another one.
        let caught = Caught::of(pid).filter(|_| process_start(pid) == Some(started))?;
        let reader = |inode: Option<u64>| OutputPipe::of_process(pid, inode?);
        let errors = reader(pipes.errors).and_then(|pipe| LastStderr::of(pipe).ok());
        let printed = reader(pipes.printed).and_then(|pipe| Relay::of(pipe, name).ok());
        let last_stderr = errors.unwrap_or_default();
        Some(Self { hold: Hold::TakenOver(caught), inner: None, last_stderr, printed, pipes })
    }

    /// What it writes to, for the next launcher.
    #[must_use]
    pub fn pipes(&self) -> OutputPipes {
        self.pipes
    }

    /// Process number of the controller.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.inner.as_ref().map_or_else(|| self.first_pid(), |inner| inner.pid)
    }

    /// Process number of what was started.
    fn first_pid(&self) -> u32 {
        match &self.hold {
            Hold::Child(child, _) => child.id(),
            Hold::TakenOver(caught) => caught.pid,
        }
    }

    /// True of the process itself and of one that it has started, which is then known to be the controller.
    pub fn is_controller(&mut self, pid: u32) -> bool {
        let first = self.first_pid();
        if pid != first && raw(pid).and_then(|pid| getpgid(Some(pid)).ok()) == raw(first) {
            self.inner = Caught::of(pid);
        }
        pid == self.pid()
    }

    /// How it has ended, once it has; what it has started ends with it.
    pub fn exited(&mut self) -> Option<Death> {
        let death = self.found_dead()?;
        self.show_the_rest();
        Some(death)
    }

    /// What it has printed comes before the report of its death.
    fn show_the_rest(&mut self) {
        drop(self.printed.take().inspect(Relay::finish));
    }

    fn found_dead(&mut self) -> Option<Death> {
        match &mut self.hold {
            Hold::Child(_, Some(status)) => Some(Death::Status(*status)),
            Hold::Child(child, status) => {
                has_ended(child.id()).then(|| signal_group(child.id(), Signal::KILL))?;
                // It must not print anything more when its death is reported.
                let _ = self.inner.take().is_none_or(|inner| inner.is_gone(END_LIMIT_S));
                *status = child.try_wait().ok().flatten();
                status.map(Death::Status)
            }
            Hold::TakenOver(caught) => caught.is_gone(0).then_some(Death::Unseen),
        }
    }

    /// Ends the process at once, and what it has started.
    pub fn kill(&mut self) {
        self.signal(Signal::KILL);
    }

    fn signal(&self, signal: Signal) {
        match &self.hold {
            Hold::Child(child, None) => signal_group(child.id(), signal),
            Hold::Child(_, Some(_)) => {}
            // A script around it has nothing to wait for any more when it has ended.
            Hold::TakenOver(caught) => {
                let _ = pidfd_send_signal(&caught.pidfd, signal);
            }
        }
    }

    /// Ends the process, and waits until it is gone.
    pub fn end(mut self) {
        self.kill();
        if let Hold::TakenOver(caught) = &self.hold {
            caught.is_gone(END_LIMIT_S);
        }
    }

    /// Stops the process where it is, without ending it, and what it has started.
    pub fn stop(&mut self) {
        self.signal(Signal::STOP);
    }

    /// The last lines on a child's standard error; call after it has exited.
    #[must_use]
    pub fn last_stderr(&self) -> String {
        self.last_stderr.complete()
    }

    /// The last lines on a child's standard error until now.
    #[must_use]
    pub fn stderr_so_far(&self) -> String {
        self.last_stderr.so_far()
    }
}

/// A child ends with its launcher; one that has been taken over can be taken over again.
impl Drop for RunningChild {
    fn drop(&mut self) {
        if let Hold::Child(child, None) = &mut self.hold {
            signal_group(child.id(), Signal::KILL);
            let _ = child.wait();
            self.show_the_rest();
        }
    }
}

fn raw(pid: u32) -> Option<Pid> {
    i32::try_from(pid).ok().and_then(Pid::from_raw)
}

/// Whether a child has ended. It is not waited for: until then nothing else gets its number, which is its group's too.
fn has_ended(pid: u32) -> bool {
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    let seen = raw(pid).and_then(|pid| waitid(WaitId::Pid(pid), options).ok());
    seen.flatten().is_some()
}

/// Sends a signal to a process that has not been waited for, and to what it has started.
fn signal_group(pid: u32, signal: Signal) {
    // All of them may have ended in the meantime.
    let _ = raw(pid).map(|pid| kill_process_group(pid, signal));
}

/// For messages that must reach the user even when the launcher no longer can.
fn launcher_stderr() -> Stdio {
    io::stderr().as_fd().try_clone_to_owned().map_or_else(|_| Stdio::null(), Stdio::from)
}

/// `exit status 3` or `killed by signal 9`.
#[must_use]
pub fn describe(death: Death) -> String {
    let Death::Status(status) = death else { return "died".to_owned() };
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit status {code}"),
        (None, Some(signal)) if signal == Signal::BUS.as_raw() => {
            format!("killed by signal {signal}, as where shared memory is full")
        }
        (None, Some(signal)) => format!("killed by signal {signal}"),
        (None, None) => "unknown exit".to_owned(),
    }
}

/// As [`describe`], of a process that has not flown yet, with what the system may have killed it for.
#[must_use]
pub fn describe_unready(death: Death) -> String {
    let how = describe(death);
    match death {
        Death::Status(status) if status.signal() == Some(Signal::KILL.as_raw()) => {
            format!("{how}; the system kills so where memory is short, and `dmesg` shows it")
        }
        _ => how,
    }
}
