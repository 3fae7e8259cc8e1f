//! The run namespace of one process: its folder, its services, and a stand-in for each neighbour.

use super::super::stepper::InstanceMark;
use crate::setup::{RunError, require_descriptors, run_id};
use core::sync::atomic::{AtomicU32, Ordering};
use host::flight::Clock;
use protocol::control::runs::note_measurement;
use runtime::clock::mono_now_ns;
use runtime::graph::ROLES;
use runtime::ipc::{Bus, IpcSink, PortError, ServiceKind};
use runtime::leader::LeadError;
use runtime::namespace::{Membership, NamespaceError, sweep_dead_runs};
use runtime::{Graph, Sink as _};
use scenario::Scenario;
use scenario::needs::MemoryNeed;
use shared_types::{ClockMode, ClockRecord, Flag, NodeId, Progress, Role, Seat};
use std::path::Path;
use swap::RegistryWriter;
use swap::services::HeldServices;
use thiserror::Error;

/// Why a process cannot be given a flight.
#[derive(Debug, Error)]
pub(super) enum OutsideError {
    #[error(transparent)]
    Lead(#[from] LeadError),
    #[error(transparent)]
    Namespace(#[from] NamespaceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error(transparent)]
    Wiring(#[from] scenario::WiringError),
    #[error("{0}")]
    Memory(String),
    #[error("cannot {action}: {source}")]
    System { action: &'static str, source: std::io::Error },
}

impl OutsideError {
    pub(super) fn system(action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::System { action, source }
    }
}

/// A neighbour that the flight's thread stands in for. A sample counts by the transport's name for its
/// writer, so each instance has a connection of its own.
struct Neighbour {
    place: Seat,
    generation: u32,
    bus: Bus,
    /// None if the process does not wait for it.
    progress: Option<IpcSink<Progress>>,
    mark_ns: u64,
    present: bool,
}

impl Neighbour {
    /// A neighbour that has left has written all it had to write, and a process looks for samples only of
    /// those whose mark has moved.
    fn fall_silent(&mut self) {
        let (mark_ns, generation) = (u64::MAX, self.generation);
        if let Some(progress) = self.progress.as_mut().filter(|_| self.mark_ns < mark_ns) {
            progress.send(&mark(mark_ns, generation));
        }
        self.mark_ns = mark_ns;
    }
}

/// All ports of the process are open before the first of these.
fn mark(mark_ns: u64, generation: u32) -> Progress {
    Progress { mark_ns, generation, served_mono_ns: mono_now_ns(), ..Progress::default() }
}

/// A run with one process, and the flight's thread for all the others.
pub(super) struct Namespace {
    /// Period of each role's loop, by [`Role::index`] \[ns\].
    periods_ns: [u64; ROLES],
    /// Roles that the process waits for.
    upstream: [bool; ROLES],
    /// Roles that it waits for or wakes.
    neighbouring: [bool; ROLES],
    registry: RegistryWriter,
    clock: IpcSink<ClockRecord>,
    time: ClockRecord,
    neighbours: Vec<Neighbour>,
    _services: HeldServices,
    bus: Bus,
    /// Dropped last: the member that leaves last removes everything, and by then all ports must be closed.
    membership: Membership,
}

impl Namespace {
    /// Founds the run in which the process of `seat` will find the flight of `scenario`.
    pub(super) fn found(
        scenario: &Scenario,
        graph: &Graph,
        seat: Seat,
    ) -> Result<Self, OutsideError> {
        /// Distinguishes the runs of flights that begin side by side.
        static FOUNDED: AtomicU32 = AtomicU32::new(0);
        let _ = sweep_dead_runs();
        let room = MemoryNeed::LOCKSTEP.look(0).map_err(RunError::from);
        room.and_then(|()| require_descriptors())
            .map_err(|error| OutsideError::Memory(error.to_string()))?;
        let number = FOUNDED.fetch_add(1, Ordering::Relaxed);
        let membership = Membership::found(&format!("{}{number:x}", run_id()))?;
        let folder = membership.folder();
        // It is no flight that a client could look at or a launcher lead.
        note_measurement(folder).map_err(OutsideError::system("write into a run's folder"))?;
        let mut flight = scenario.flight()?;
        flight.clock = Clock::Lockstep;
        // No launcher can take this flight over.
        flight.grace_s = 0.0;
        flight.write(folder).map_err(OutsideError::system("describe the flight"))?;
        std::fs::write(folder.join("scenario.toml"), scenario.to_toml())
            .map_err(OutsideError::system("write the scenario"))?;
        let bus = Bus::join(&membership.ipc_config(), "launcher")?;
        bus.lead()?;
        let services = HeldServices::create_for(&bus, graph, seat)?;
        Ok(Self {
            periods_ns: Role::STEPPING
                .map(|role| graph.node(role).map_or(0, |node| node.rate.period_ns())),
            upstream: Role::STEPPING.map(|role| graph.reads_marks(seat.role, role)),
            neighbouring: Role::STEPPING.map(|role| {
                let waits = |a, b| graph.waits_for(a, b);
                role != seat.role && (waits(seat.role, role) || waits(role, seat.role))
            }),
            registry: RegistryWriter::open(&bus)?,
            clock: bus.open_writer(ServiceKind::Clock)?,
            time: ClockRecord {
                // When the flight ends is published when it does.
                end_ns: u64::MAX,
                speed: 1.0,
                mode: ClockMode::Lockstep,
                ..ClockRecord::default()
            },
            neighbours: Vec::new(),
            _services: services,
            bus,
            membership,
        })
    }

    /// The launcher's own connection.
    pub(super) fn bus(&self) -> &Bus {
        &self.bus
    }

    pub(super) fn folder(&self) -> &Path {
        self.membership.folder()
    }

    /// Enters an instance in the publisher registry and publishes it to the process.
    pub(super) fn enter(&mut self, node: NodeId, place: Seat, generation: u32, period_ns: u64) {
        self.registry.enter(node, place, generation, period_ns);
        self.registry.publish();
    }

    /// Publishes how far the neighbours have got, and which have left.
    pub(super) fn publish_marks(&mut self, instances: &[InstanceMark]) -> Result<(), PortError> {
        for instance in instances {
            let InstanceMark { place, generation, mark_ns, .. } = *instance;
            if !self.neighbouring[place.role.index()] {
                continue;
            }
            let neighbour = self.neighbour(place, generation, instance.period_ns)?;
            if let Some(progress) = &mut neighbour.progress
                && neighbour.mark_ns < mark_ns
            {
                neighbour.mark_ns = mark_ns;
                progress.send(&mark(mark_ns, generation));
            }
        }
        let flies = |n: &Neighbour| {
            instances.iter().any(|i| (i.place, i.generation) == (n.place, n.generation))
        };
        let mut has_left = false;
        for neighbour in self.neighbours.iter_mut().filter(|n| n.present && !flies(n)) {
            neighbour.present = false;
            neighbour.fall_silent();
            self.registry.leave(neighbour.place);
            has_left = true;
        }
        if has_left {
            self.registry.publish();
        }
        Ok(())
    }

    /// The connection of an instance, to write as it.
    pub(super) fn bus_of(&mut self, place: Seat, generation: u32) -> Result<&Bus, PortError> {
        let period_ns = self.periods_ns[place.role.index()];
        Ok(&self.neighbour(place, generation, period_ns)?.bus)
    }

    fn neighbour(
        &mut self,
        place: Seat,
        generation: u32,
        period_ns: u64,
    ) -> Result<&mut Neighbour, PortError> {
        let is_it = |n: &Neighbour| (n.place, n.generation) == (place, generation);
        let known = self.neighbours.iter().position(is_it);
        let at = if let Some(at) = known {
            at
        } else {
            self.neighbours
                .iter_mut()
                .filter(|n| n.place == place)
                .for_each(Neighbour::fall_silent);
            self.neighbours.retain(|n| n.place != place);
            let bus = Bus::join(&self.membership.ipc_config(), &place.label())?;
            let progress = self.upstream[place.role.index()]
                .then(|| bus.open_writer(ServiceKind::Progress(place)));
            let progress = progress.transpose()?;
            self.enter(bus.identity(), place, generation, period_ns);
            let (mark_ns, present) = (0, true);
            let new = Neighbour { place, generation, bus, progress, mark_ns, present };
            self.neighbours.push(new);
            self.neighbours.len() - 1
        };
        Ok(&mut self.neighbours[at])
    }

    /// Starts the clock, or lets time go on to `allowed_ns`; it never goes back.
    pub(super) fn allow(&mut self, allowed_ns: u64) {
        if !self.time.started.is_set() || self.time.allowed_ns < allowed_ns {
            self.time.started = Flag::Yes;
            self.time.allowed_ns = allowed_ns;
            self.clock.send(&self.time);
        }
    }

    /// Ends the flight at the release that the process has not run.
    pub(super) fn end(&mut self, mark_ns: u64) {
        self.time.end_ns = mark_ns;
        self.clock.send(&self.time);
    }

    /// Lets a process go that has finished.
    pub(super) fn let_leave(&mut self) {
        self.time.may_leave = Flag::Yes;
        self.clock.send(&self.time);
    }

    /// Lets a process that has just joined see what there is.
    pub(super) fn serve_late_joiners(&mut self) {
        self.clock.serve_late_joiners();
        self.registry.serve_late_joiners();
        for progress in self.neighbours.iter_mut().filter_map(|n| n.progress.as_mut()) {
            progress.serve_late_joiners();
        }
    }
}
