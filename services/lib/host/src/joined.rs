//! One process of a run: joins it, opens its ports, flies, leaves.

use crate::realtime::Setup;
use crate::staying::Staying;
use crate::thread::{name_thread, stay_on};
use crate::{Flight, HostError, PlaceArguments};
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::connect::connect;
use runtime::ipc::Bus;
use runtime::namespace::Membership;
use runtime::watch::{LauncherNews, StopFlags};
use runtime::{Component, Ending, Executor, Graph, Node, Process, Timing};
use rustix::process::{Signal, getpid, kill_process};
use shared_types::Role;
use std::io::{self, Write as _};

/// How long a process may take to leave once no launcher will come any more, before it counts as one that hangs \[ns\]:
/// long enough for the last one to wipe on a busy machine.
const LEAVE_LIMIT_NS: u64 = 10_000_000_000;

/// A process that has joined its run and does not fly yet.
#[derive(Debug)]
pub struct Joined {
    bus: Bus,
    flight: Flight,
    graph: Graph,
    node: Node,
    stop: StopFlags,
    arguments: PlaceArguments,
    name: String,
    /// Declared last, dropped last: the last process to leave wipes the run's folder, and by then its
    /// own ports must be closed.
    _membership: Membership,
}

impl Joined {
    /// Joins a run as the process `name` of `role`.
    ///
    /// # Errors
    /// The run or its launcher is gone, or the run is of another build.
    pub fn join(name: &str, role: Role, arguments: PlaceArguments) -> Result<Self, HostError> {
        name_thread(name);
        if let Some(cpu) = arguments.cpu {
            stay_on(cpu);
        }
        if let Some(nice) = arguments.nice {
            // Without permission the process keeps its priority.
            let _ = rustix::process::nice(nice);
        }
        let watch = |what| move |source| HostError::Watch { what, source };
        let stop = StopFlags::watch_signals().map_err(watch("signals"))?;
        let membership = Membership::join(&arguments.run)?;
        let flight = Flight::read(membership.folder())?;
        let name_of_run = membership.name();
        let realtime = flight.is_realtime();
        let (known, folder) = (Staying::of(&flight), membership.folder().to_path_buf());
        let reports = role == Role::Plant;
        let follow = move |news| {
            let staying = Staying::noted(&folder, known);
            if news == LauncherNews::Abandoned {
                end_if_it_hangs();
            } else if reports && let Some(text) = of_launcher(news, &name_of_run, realtime, staying)
            {
                // A child's standard output is the launcher's standard error; its own may be closed.
                let _ = writeln!(io::stdout(), "morphquad: {text}");
            }
            if role == Role::Pilot { staying.grace_s } else { staying.leave_s }
        };
        stop.watch_launcher(membership.folder(), arguments.launcher_pid, follow)
            .map_err(watch("the launcher"))?;
        let bus = Bus::join(&membership.ipc_config(), name)?.waiting_for_room();
        let graph = flight.graph()?;
        let node = *graph.node(role).ok_or(HostError::NoSuchLoop(role.label()))?;
        let name = name.to_owned();
        Ok(Self { bus, flight, graph, node, stop, arguments, name, _membership: membership })
    }

    /// The flight that it takes part in.
    #[must_use]
    pub fn flight(&self) -> &Flight {
        &self.flight
    }

    /// Flies a component to its end.
    ///
    /// # Errors
    /// The component is of another slot, a port cannot be had, or the hand-over fails.
    pub fn fly(self, component: Component) -> Result<Ending, HostError> {
        let Self { bus, flight, graph, node, stop, arguments, name, .. } = &self;
        let executor = Executor::new(component, *node, arguments.place());
        // A processor that the command line has named stays.
        let setup = flight.setup(node.role).map(|setup| Setup {
            cpus: if arguments.cpu.is_some() { Vec::new() } else { setup.cpus },
            ..setup
        });
        let prepare = || {
            let shortfalls = setup.map(|setup| setup.apply()).unwrap_or_default();
            match shortfalls.first() {
                // The launcher has reported what it could foresee.
                Some(shortfall) if flight.is_strict() => Err(HostError::from(*shortfall)),
                _ => Ok(()),
            }
        };
        let (graph, stop) = (graph.clone(), stop.clone());
        let timing = flight.timing.clone();
        let timing = timing.map(|script| Timing::new(script, name, flight.is_realtime()));
        fly_component(bus, graph, stop, (executor, timing), (arguments.await_handover, prepare))
    }
}

/// Ends this process if it does not leave by itself: without a launcher no other process finds that it hangs, and it
/// would stay for ever.
fn end_if_it_hangs() {
    sleep_until(mono_now_ns() + LEAVE_LIMIT_NS);
    let _ = kill_process(getpid(), Signal::KILL);
}

/// What the plant reports about the launcher, on behalf of all; nothing that it has reported before.
fn of_launcher(
    news: LauncherNews,
    run: &str,
    realtime: bool,
    Staying { grace_s, leave_s }: Staying,
) -> Option<String> {
    Some(match news {
        LauncherNews::Succeeded { pid } => format!("run {run} is led by process {pid} now"),
        // The message about the death stated when that will be.
        LauncherNews::Abandoned => return None,
        LauncherNews::Died if !realtime => format!(
            "the launcher of run {run} died; its time stands still, and all leave in {leave_s:.1} s"
        ),
        LauncherNews::Died if grace_s <= 0.0 => {
            format!("the launcher of run {run} died; all leave at once")
        }
        LauncherNews::Died => format!(
            "the launcher of run {run} died; the flight goes on for {grace_s:.1} s, in which `morphquad adopt {run}` can take it over, then the vehicle lands, and all leave in {leave_s:.1} s"
        ),
    })
}

/// Opens every port of a component, prepares its thread, sends its hello, waits for a hand-over if
/// one is announced, and flies.
///
/// # Errors
/// As [`Joined::fly`].
fn fly_component(
    bus: &Bus,
    graph: Graph,
    stop: StopFlags,
    (mut executor, timing): (Executor, Option<Timing>),
    (await_handover, prepare): (bool, impl FnOnce() -> Result<(), HostError>),
) -> Result<Ending, HostError> {
    refuse_other_outputs(&executor, &graph)?;
    connect(bus, &graph, &mut executor, timing.as_ref())?;
    let mut process = Process::open(bus, executor, graph, stop)?;
    if let Some(timing) = timing {
        process.take_time(timing)?;
    }
    prepare()?;
    // Held until the end: a dropped writer's last sample may not have been read yet.
    let _hello = process.send_hello()?;
    if await_handover {
        process.take_over()?;
    }
    Ok(process.run())
}

/// No reader would accept what a component writes on a topic of another role.
fn refuse_other_outputs(executor: &Executor, graph: &Graph) -> Result<(), HostError> {
    let role = executor.node().role;
    let mut topics = executor.component.layout().writes();
    let Some(topic) = topics.find(|topic| graph.producer(topic) != role) else { return Ok(()) };
    let (owner, slot) = (graph.producer(topic).label(), role.label());
    Err(HostError::WrongSlot { topic: topic.name, owner, slot })
}
