//! One process of a run: joins it, opens its ports, flies, leaves.

use crate::thread::{name_thread, stay_on};
use crate::{Flight, HostError, PlaceArguments};
use runtime::connect::connect;
use runtime::ipc::Bus;
use runtime::namespace::Membership;
use runtime::priority::take_fifo;
use runtime::watch::StopFlags;
use runtime::{
    Ending, Executor, Graph, Node, Output, OutputSet as _, OutputVisitor, Process, Service,
};
use shared_types::{Role, Sample, Topic};
use std::io::{self, Write as _};

/// Wall time that a realtime flight is given to land after the grace period \[s\].
const LANDING_S: f64 = 4.0;

/// A process that has joined its run and does not fly yet.
#[derive(Debug)]
pub struct Joined {
    bus: Bus,
    flight: Flight,
    graph: Graph,
    node: Node,
    stop: StopFlags,
    arguments: PlaceArguments,
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
        // Without permission it flies on as it is; the launcher says so.
        let _ = flight.fifo_priority().map(take_fifo);
        let lands = flight.is_realtime() && flight.grace_s > 0.0;
        let leave_s = if lands { flight.grace_s + LANDING_S } else { flight.grace_s };
        let run = membership.folder().display().to_string();
        let realtime = flight.is_realtime();
        stop.watch_launcher(arguments.launcher_pid, leave_s, move || {
            if role == Role::Plant {
                // A child's standard output is the launcher's standard error; its own may be closed.
                let what =
                    if realtime { "the vehicle hovers, then lands" } else { "time stands still" };
                let _ = writeln!(
                    io::stdout(),
                    "morphquad: the launcher of {run} died; {what}, all leave in {leave_s} s"
                );
            }
        })
        .map_err(watch("the launcher"))?;
        let bus = Bus::join(&membership.ipc_config(), name)?;
        let graph = flight.graph()?;
        let node = *graph.node(role).ok_or(HostError::NoSuchLoop(role.label()))?;
        Ok(Self { bus, flight, graph, node, stop, arguments, _membership: membership })
    }

    /// The flight that it takes part in.
    #[must_use]
    pub fn flight(&self) -> &Flight {
        &self.flight
    }

    /// Flies a component, whose state is published every `state_every` steps, to its end.
    ///
    /// # Errors
    /// The component is of another slot, a port cannot be had, or the hand-over fails.
    pub fn fly<S: Service>(self, service: S, state_every: u64) -> Result<Ending, HostError> {
        let executor = Executor::new(service, self.node, self.arguments.place(), state_every);
        fly_service(&self.bus, self.graph, self.stop, executor, self.arguments.await_handover)
    }
}

/// Opens every port of a component, says hello, waits for a hand-over if told to, and flies; also
/// used for the pilot, which lives in the launcher's own process.
///
/// # Errors
/// As [`Joined::fly`].
pub fn fly_service<S: Service>(
    bus: &Bus,
    graph: Graph,
    stop: StopFlags,
    mut executor: Executor<S>,
    await_handover: bool,
) -> Result<Ending, HostError> {
    refuse_other_outputs(&mut executor, &graph)?;
    connect(bus, &graph, &mut executor)?;
    let mut process = Process::open(bus, executor, graph, stop)?;
    // Held until the end: a dropped writer's last sample may not have been read yet.
    let _hello = process.say_hello()?;
    if await_handover {
        process.take_over()?;
    }
    Ok(process.run())
}

/// Nobody would hear what a component writes on a topic of another role.
fn refuse_other_outputs<S: Service>(
    executor: &mut Executor<S>,
    graph: &Graph,
) -> Result<(), HostError> {
    struct Check<'a> {
        role: Role,
        graph: &'a Graph,
    }
    impl OutputVisitor for Check<'_> {
        type Error = HostError;
        fn visit<T: Sample>(
            &mut self,
            topic: &'static Topic<T>,
            _output: &mut Output<T>,
        ) -> Result<(), HostError> {
            let owner = self.graph.producer(&topic.info);
            if owner == self.role {
                return Ok(());
            }
            let (topic, slot) = (topic.info.name, self.role.label());
            Err(HostError::WrongSlot { topic, owner: owner.label(), slot })
        }
    }
    let role = executor.node().role;
    executor.outputs.visit(&mut Check { role, graph })
}
