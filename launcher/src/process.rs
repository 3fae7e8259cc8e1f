//! One flying process: joins its run, opens its ports, flies, leaves.

use crate::components::{self, Component, ComponentVisitor};
use crate::exit;
use crate::scenario::Scenario;
use crate::scenario::settings::Clock;
use runtime::connect::connect;
use runtime::ipc::Bus;
use runtime::namespace::Membership;
use runtime::priority::take_fifo;
use runtime::watch::StopFlags;
use runtime::{Ending, Executor, Graph, Node, Place, Process, ProcessError, Service};
use rustix::thread::{CpuSet, sched_setaffinity, set_name};
use shared_types::Role;
use std::ffi::CString;
use std::io;
use std::path::PathBuf;

/// How a process is started by the launcher.
#[derive(Debug, Clone)]
pub struct ProcOptions {
    /// Service to run.
    pub service: String,
    /// Folder of the run to join.
    pub run: PathBuf,
    /// Which of the role's seats to take, and how many have had it before.
    pub place: Place,
    /// Process to watch: the flight ends when it is gone.
    pub launcher_pid: u32,
    /// Begin where, and from what state, a hand-over says.
    pub await_handover: bool,
    /// Scenario that configures the service, if not the run's.
    pub config: Option<PathBuf>,
    /// Processor to stay on.
    pub cpu: Option<usize>,
    /// How much to stand back for others, as `nice` counts.
    pub nice: Option<i32>,
}

/// Wall time that a realtime flight is given to land after the grace period \[s\].
const LANDING_S: f64 = 4.0;

/// Runs one process of a flight to its end and returns its exit code.
#[must_use]
pub fn run_process(options: &ProcOptions) -> u8 {
    let Some(role) = components::role_of(&options.service) else {
        let known = components::names().join(", ");
        let line = format!("{}: no such service; there are {known}", options.service);
        say(&mut io::stderr(), &line);
        return exit::USAGE;
    };
    match fly(role, options) {
        Ok(Ending::Finished | Ending::Retired) => exit::PASS,
        Ok(Ending::Signalled) => {
            say(&mut io::stderr(), &format!("{}: stopped by a signal", options.service));
            exit::INTERRUPTED
        }
        Ok(Ending::LauncherGone) => exit::CRASHED,
        Err(error) => {
            say(&mut io::stderr(), &format!("{}: {error}", options.service));
            exit::UNFIT
        }
    }
}

/// Writes a line that nobody may be left to read.
fn say(to: &mut dyn io::Write, line: &str) {
    let _ = writeln!(to, "{line}");
}

fn fly(role: Role, options: &ProcOptions) -> Result<Ending, Box<dyn std::error::Error>> {
    name_thread(&options.service);
    if let Some(cpu) = options.cpu {
        stay_on(cpu);
    }
    if let Some(nice) = options.nice {
        // Without permission the process keeps its priority.
        let _ = rustix::process::nice(nice);
    }
    let stop = StopFlags::watch_signals()?;
    // Declared first, dropped last: the last process to leave wipes the run's folder, and by then
    // its own ports must be closed.
    let membership = Membership::join(&options.run)?;
    let file = options.run.join("scenario.toml");
    let scenario = Scenario::load(&file.to_string_lossy(), &[])?;
    // Without permission it flies on as it is; the launcher says so.
    let _ = scenario.fifo_priority().map(take_fifo);
    let grace_s = scenario.settings().launcher.launcher_grace_s;
    let realtime = scenario.settings().scenario.clock == Clock::Realtime;
    let lands = realtime && grace_s > 0.0;
    let leave_s = if lands { grace_s + LANDING_S } else { grace_s };
    let run = membership.folder().display().to_string();
    stop.watch_launcher(options.launcher_pid, leave_s, move || {
        if role == Role::Plant {
            // A child's standard output is the launcher's standard error; its own may be closed.
            let what =
                if realtime { "the vehicle hovers, then lands" } else { "time stands still" };
            let line =
                format!("morphquad: the launcher of {run} died; {what}, all leave in {leave_s} s");
            say(&mut io::stdout(), &line);
        }
    })?;
    let bus = Bus::join(&membership.ipc_config(), &options.service)?;
    let graph = scenario.graph()?;
    let node = *graph.node(role).ok_or("this flight has no such process")?;
    let flight = Fly { bus: &bus, graph, node, stop, options };
    let configured = match &options.config {
        Some(file) => &Scenario::load(&file.to_string_lossy(), &[])?,
        None => &scenario,
    };
    components::build_service(Some(&options.service), configured, flight)?
}

/// Connects and flies whatever component it is given.
struct Fly<'a> {
    bus: &'a Bus,
    graph: Graph,
    node: Node,
    stop: StopFlags,
    options: &'a ProcOptions,
}

impl ComponentVisitor for Fly<'_> {
    type Output = Result<Ending, Box<dyn std::error::Error>>;
    fn visit<S: Service>(self, component: Component<S>) -> Self::Output {
        let options = self.options;
        let seat = SeatOptions { place: options.place, await_handover: options.await_handover };
        Ok(fly_service(self.bus, self.graph, self.node, self.stop, component, seat)?)
    }
}

/// How a service takes its seat.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeatOptions {
    pub(crate) place: Place,
    pub(crate) await_handover: bool,
}

/// Opens every port of a component, says hello and flies; also used for the pilot, which lives in
/// the launcher's own process.
pub(crate) fn fly_service<S: Service>(
    bus: &Bus,
    graph: Graph,
    node: Node,
    stop: StopFlags,
    component: Component<S>,
    seat: SeatOptions,
) -> Result<Ending, ProcessError> {
    let mut executor = Executor::new(component.service, node, seat.place, component.state_every);
    connect(bus, &graph, &mut executor)?;
    let mut process = Process::open(bus, executor, graph, stop)?;
    // Held until the end: a dropped writer's last sample may not have been read yet.
    let _hello = process.say_hello()?;
    if seat.await_handover {
        process.take_over()?;
    }
    Ok(process.run())
}

/// Name in `ps -L`, `top -H` and debuggers.
pub(crate) fn name_thread(name: &str) {
    if let Ok(name) = CString::new(components::thread_name(name)) {
        // A missing name disturbs nobody.
        let _ = set_name(&name);
    }
}

/// Keeps the calling thread on one processor; without permission it stays where it is.
pub(crate) fn stay_on(cpu: usize) {
    let mut set = CpuSet::new();
    set.set(cpu);
    let _ = sched_setaffinity(None, &set);
}

/// True if `role` is filled by a process of its own.
#[must_use]
pub fn has_process(role: Role) -> bool {
    role != Role::Pilot
}
