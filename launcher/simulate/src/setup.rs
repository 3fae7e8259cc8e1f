//! What a flight needs before it starts: options, facts, folder, processor, room in memory.

use crate::in_process::InProcessError;
use host::tasks::Tasks;
use record::{Clock, Facts, Machine, RecordError};
use runtime::clock::mono_now_ns;
use runtime::ipc::PortError;
use runtime::leader::LeadError;
use runtime::namespace::NamespaceError;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use scenario::needs::Shortage;
pub use scenario::settings::Speed;
use scenario::{Scenario, needs};
use shared_types::ClockMode;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Which processor a flight's processes stay on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pin {
    /// One processor for all in lockstep, where waking a neighbour on the same one is cheapest;
    /// free in realtime.
    Auto,
    /// Wherever the system puts them.
    None,
    /// This one.
    Cpu(usize),
}

/// What to fly and how.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// What to fly.
    pub scenario: Scenario,
    /// Pace.
    pub speed: Speed,
    /// Folder for the recording; none for no recording.
    pub record: Option<PathBuf>,
    /// Name of the recording; the id of the run if none.
    pub name: Option<String>,
    /// Processor choice.
    pub pin: Pin,
    /// Seed of a start in disorder; none for the usual order.
    pub disorder: Option<u64>,
    /// Whether to show progress on standard error.
    pub progress: bool,
    /// Whether and where to serve it to viewers while it flies.
    pub live: Option<LiveOptions>,
}

/// How a flight is served to viewers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveOptions {
    /// Where the `WebSocket` listens; the page has another port of the same address.
    pub listen: SocketAddr,
    /// Whether to open the page in a browser.
    pub open: bool,
    /// Of a demo: the scenario that configures its bad controller.
    pub demo: Option<PathBuf>,
}

/// Why a flight could not be started.
#[derive(Debug, Error)]
pub enum RunError {
    /// The run's folder.
    #[error(transparent)]
    Namespace(#[from] NamespaceError),
    /// Another launcher leads the run.
    #[error(transparent)]
    Lead(#[from] LeadError),
    /// The transport.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The recording.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Too little memory.
    #[error(
        "too little memory for a flight: {0}; one in real time needs less with `--set realtime.lock_memory=false`"
    )]
    Memory(#[from] Shortage),
    /// Too few file descriptors.
    #[error(
        "a process may open {limit} files here at most and a flight may need {needed}: raise the hard limit, nofile in /etc/security/limits.conf, or `ulimit -Hn {needed}` as root"
    )]
    Descriptors {
        /// The largest limit that may be asked for.
        limit: u64,
        /// Descriptors that a flight may have open.
        needed: u64,
    },
    /// The system's tables of processes are of another namespace.
    #[error(
        "/proc is not that of this process's PID namespace, and no process would find another: `mount -t proc proc /proc` in it, or `unshare --pid --fork --mount-proc`"
    )]
    ForeignProc,
    /// Too few processes and threads.
    #[error("{tasks}, and a flight may need {needed} more: {}", tasks.remedy(*needed))]
    Tasks {
        /// Those that are there, and as many as may be.
        tasks: Tasks,
        /// As many as a flight may add.
        needed: u64,
    },
    /// Something of the operating system.
    #[error("cannot {action}: {source}")]
    System {
        /// What was tried.
        action: String,
        /// Why it failed.
        source: std::io::Error,
    },
    /// The scenario cannot be wired.
    #[error("{0}")]
    Wiring(String),
    /// The user asked to stop before the start.
    #[error("interrupted before the start: nothing was flown")]
    Interrupted,
    /// A processor that this machine, or this process, does not have.
    #[error("{key} {cpu}: this process may run on processor {allowed} only")]
    NoSuchProcessor {
        /// Flag or key that names it.
        key: String,
        /// As asked for.
        cpu: usize,
        /// As possible, separated by commas.
        allowed: String,
    },
    /// The flight is strict about what the system must grant.
    #[error("realtime.strict: {0}")]
    NotGranted(host::realtime::Shortfall),
    /// A realtime flight without processes.
    #[error(
        "--clock realtime needs processes, whose waiting and lateness it is about: leave --in-process away, or pace the same flight with --clock lockstep --speed 1"
    )]
    RealtimeInProcess,
    /// A script for processes, without processes.
    #[error("--in-process: {0}")]
    ScriptInProcess(InProcessError),
    /// Viewers cannot be served.
    #[error("{reason}")]
    NotServed {
        /// Why not.
        reason: String,
        /// What the process that was to serve them ended with.
        exit_code: u8,
    },
    /// The processes did not get ready.
    #[error("{0}")]
    NotReady(String),
}

/// The error of a call to the system, with what was to be done.
pub fn system(action: impl Into<String>) -> impl FnOnce(std::io::Error) -> RunError {
    let action = action.into();
    move |source| RunError::System { action, source }
}

/// Raises the soft limit on open files to what a flight needs, and refuses to fly if the hard limit is below that.
///
/// # Errors
/// [`RunError::Descriptors`].
pub fn require_descriptors() -> Result<(), RunError> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current.is_none_or(|current| current >= needs::DESCRIPTORS) {
        return Ok(());
    }
    let raised = Rlimit { current: Some(needs::DESCRIPTORS), maximum };
    setrlimit(Resource::Nofile, raised).map_err(|_| {
        let limit = maximum.unwrap_or(u64::MAX);
        RunError::Descriptors { limit, needed: needs::DESCRIPTORS }
    })
}

/// Refuses to fly where `/proc` shows other processes than those that this one can see.
///
/// # Errors
/// [`RunError::ForeignProc`].
pub fn require_own_proc() -> Result<(), RunError> {
    let own = std::fs::read_link("/proc/self").ok();
    let is_own = own.is_some_and(|own| own == Path::new(&std::process::id().to_string()));
    if is_own { Ok(()) } else { Err(RunError::ForeignProc) }
}

/// Refuses to fly where there may not be as many processes and threads as a flight has.
///
/// # Errors
/// [`RunError::Tasks`].
pub fn require_tasks() -> Result<(), RunError> {
    match Tasks::here().filter(|tasks| tasks.left() < needs::TASKS) {
        Some(tasks) => Err(RunError::Tasks { tasks, needed: needs::TASKS }),
        None => Ok(()),
    }
}

/// Lower-case hexadecimal from process id and clock: unique on this machine while it lives.
#[must_use]
pub fn run_id() -> String {
    format!("{:04x}{:06x}", std::process::id() & 0xffff, (mono_now_ns() / 1000) & 0xff_ffff)
}

/// Path of a recording in a folder, which is made if it is not there.
///
/// # Errors
/// [`RunError`] if the folder cannot be made.
pub fn recording_path(folder: &Path, name: &str) -> Result<PathBuf, RunError> {
    std::fs::create_dir_all(folder)
        .map_err(|cause| RecordError::Create { path: folder.to_owned(), cause })?;
    Ok(folder.join(format!("{name}.mcap")))
}

impl RunOptions {
    /// Path of the recording of run `id`, if it is to be recorded.
    ///
    /// # Errors
    /// As [`recording_path`].
    pub fn recording_path(&self, id: &str) -> Result<Option<PathBuf>, RunError> {
        let name = self.name.as_deref().unwrap_or(id);
        self.record.as_deref().map(|folder| recording_path(folder, name)).transpose()
    }
}

/// The recording of a flight that has not begun. One that never begins leaves no file: it would hold nothing, and be
/// the latest.
#[derive(Debug)]
pub struct Unflown(Option<PathBuf>);

impl Unflown {
    /// The file that has just been created, if there is one.
    #[must_use]
    pub fn of(created: Option<&Path>) -> Self {
        Self(created.map(Path::to_owned))
    }

    /// The flight has begun.
    pub fn begins(mut self) {
        self.0 = None;
    }
}

impl Drop for Unflown {
    fn drop(&mut self) {
        if let Some(path) = &self.0 {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// What a recording states about the flight.
#[must_use]
pub fn facts(id: &str, options: &RunOptions) -> Facts {
    let scenario = &options.scenario;
    Facts {
        run_id: id.to_owned(),
        scenario_name: scenario.settings().scenario.name.clone(),
        scenario_toml: scenario.to_toml().to_owned(),
        seed: scenario.settings().scenario.seed,
        clock: stamps_of(options),
        epoch_unix_ns: runtime::clock::unix_now_ns(),
        machine: Machine::read(),
        vehicle: scenario.real_vehicle(),
        branch: None,
        continues: None,
    }
}

/// How the stamps of the flight run.
#[must_use]
pub fn stamps_of(options: &RunOptions) -> Clock {
    let speed = if let Speed::Times(times) = options.speed { times } else { 1.0 };
    match clock_of(&options.scenario) {
        ClockMode::Realtime => Clock::Realtime { speed },
        _ => Clock::Lockstep,
    }
}

/// The clock of a scenario.
#[must_use]
pub fn clock_of(scenario: &Scenario) -> ClockMode {
    scenario.settings().scenario.clock.into()
}

/// Refuses a processor that the children could not be moved to.
///
/// # Errors
/// [`RunError`] if this process may not run there.
pub fn require_processor(pin: Pin) -> Result<(), RunError> {
    let Pin::Cpu(cpu) = pin else { return Ok(()) };
    let allowed = allowed_processors()?;
    if allowed.contains(&cpu) {
        return Ok(());
    }
    let allowed = allowed.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    Err(RunError::NoSuchProcessor { key: "--pin".to_owned(), cpu, allowed })
}

/// Processors that this process may run on.
///
/// # Errors
/// [`RunError`] if the system does not report them.
pub fn allowed_processors() -> Result<Vec<usize>, RunError> {
    let allowed = rustix::thread::sched_getaffinity(None)
        .map_err(|error| system("look at the processors")(error.into()))?;
    Ok((0..rustix::thread::CpuSet::MAX_CPU).filter(|cpu| allowed.is_set(*cpu)).collect())
}

/// The processor on which all processes stay; none if they are free.
pub fn pinned_cpu(pin: Pin, clock: ClockMode) -> Option<usize> {
    match pin {
        Pin::None => None,
        Pin::Cpu(cpu) => Some(cpu),
        Pin::Auto => (clock == ClockMode::Lockstep).then(runtime::clock::current_cpu),
    }
}

/// Shows the logical time flown on standard error.
#[must_use]
pub fn progress_bar(duration_ns: u64) -> indicatif::ProgressBar {
    let style = indicatif::ProgressStyle::with_template("{bar:40} {pos}/{len} ms flown {elapsed}")
        .unwrap_or_else(|_| indicatif::ProgressStyle::default_bar());
    indicatif::ProgressBar::new(duration_ns / 1_000_000).with_style(style)
}
