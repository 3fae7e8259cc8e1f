//! Every service of a run, held by its launcher for as long as that lives.

use runtime::Graph;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::{Bus, HANDOVER_DEPTH, PortError, STATE_DEPTH, ServiceKind, WakeNotifier};
use runtime::namespace::SpareLinks;
use shared_types::wire::Shared;
use shared_types::{
    ClockRecord, Hello, Progress, Registry, Role, Sample, Seat, Slot, Topic, TopicInfo,
    TopicVisitor, topics,
};
use std::any::Any;
use std::io;

/// Keeps the services alive; children only open what is held here.
#[derive(Debug)]
pub struct HeldServices {
    _factories: Vec<Box<dyn Any>>,
    /// Their names.
    names: Vec<String>,
    /// What puts them back, once they are protected.
    spare: Option<SpareLinks>,
}

/// Services that another program has removed, or made anew.
#[derive(Debug)]
pub struct RemovedServices {
    /// Their names, as far as they are known.
    pub names: Vec<String>,
    /// Whether they could be put back.
    pub put_back: io::Result<()>,
}

/// For how long a service that can be neither opened nor made is tried again, while another program may be removing it
/// \[ns\].
const REMOVAL_LIMIT_NS: u64 = 5_000_000_000;
/// From one attempt to the next \[ns\].
const AGAIN_AFTER_NS: u64 = 5_000_000;

/// Makes services, or finds those of a launcher that has died and makes what is missing: another program may have freed
/// what that launcher alone held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Create,
    TakeOver,
}

struct Holder<'a> {
    bus: &'a Bus,
    way: Way,
    /// The loop whose topics are wanted; none for all topics.
    only_for: Option<(&'a Graph, Role)>,
    factories: Vec<Box<dyn Any>>,
    names: Vec<String>,
}

impl TopicVisitor for Holder<'_> {
    type Error = PortError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), PortError> {
        if self.only_for.is_some_and(|(graph, role)| !concerns(graph, role, &topic.info)) {
            return Ok(());
        }
        let bus = self.bus;
        self.hold(topic.info.name.to_owned(), || bus.create_topic(topic), || bus.open_topic(topic))
    }
}

impl<'a> Holder<'a> {
    fn new(bus: &'a Bus, way: Way, only_for: Option<(&'a Graph, Role)>) -> Self {
        Self { bus, way, only_for, factories: Vec::new(), names: Vec::new() }
    }

    /// Holds a service. One that another program is just removing may be there when it is looked for and not when it is
    /// opened, or not be gone when it is made: that is a matter of milliseconds.
    fn hold<F: 'static>(
        &mut self,
        name: String,
        create: impl Fn() -> Result<F, PortError>,
        open: impl Fn() -> Result<F, PortError>,
    ) -> Result<(), PortError> {
        let give_up_ns = mono_now_ns() + REMOVAL_LIMIT_NS;
        let factory = loop {
            let is_removed = |error: &PortError| {
                self.way == Way::TakeOver && matches!(error, PortError::Transport { .. })
            };
            let held =
                match self.way {
                    Way::Create => create(),
                    // As a rule it is there, which to ask first would take as long as to open it.
                    Way::TakeOver => open().or_else(|error| {
                        if self.bus.has_service(&name) { Err(error) } else { create() }
                    }),
                };
            match held {
                Err(error) if is_removed(&error) && mono_now_ns() < give_up_ns => {
                    sleep_until(mono_now_ns() + AGAIN_AFTER_NS);
                }
                held => break held?,
            }
        };
        self.factories.push(Box::new(factory));
        self.names.push(name);
        Ok(())
    }

    fn held(self) -> HeldServices {
        HeldServices { _factories: self.factories, names: self.names, spare: None }
    }

    fn service<T: Shared>(&mut self, kind: ServiceKind, capacity: usize) -> Result<(), PortError> {
        let bus = self.bus;
        let create = || bus.create_service::<T>(kind, capacity);
        self.hold(kind.name(), create, || bus.open_service::<T>(kind))
    }

    /// What the process of a seat has for itself.
    fn seat(&mut self, seat: Seat) -> Result<(), PortError> {
        self.service::<Progress>(ServiceKind::Progress(seat), 4)?;
        self.states(ServiceKind::State(seat), STATE_DEPTH)?;
        self.states(ServiceKind::Handover(seat), HANDOVER_DEPTH)
    }

    /// What is between the launcher and all processes.
    fn launcher(&mut self) -> Result<(), PortError> {
        self.service::<Registry>(ServiceKind::Registry, 2)?;
        self.service::<ClockRecord>(ServiceKind::Clock, 4)?;
        self.service::<Hello>(ServiceKind::Hello, 64)
    }

    fn states(&mut self, kind: ServiceKind, depth: usize) -> Result<(), PortError> {
        let bus = self.bus;
        let create = || bus.create_state_service(kind, depth);
        self.hold(kind.name(), create, || bus.open_state_service(kind))
    }
}

impl HeldServices {
    /// Creates the topics of the floor plan and the services beside them.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn create(bus: &Bus) -> Result<Self, PortError> {
        for seat in Role::STEPPING.into_iter().flat_map(Seat::all) {
            bus.create_wake(seat)?;
        }
        Self::hold(bus, Way::Create)
    }

    /// Holds what a launcher has left that has died. Without a process that holds them, services would
    /// vanish with what it left behind; so this comes before the dead are swept. Those that have vanished already,
    /// because another program has swept, are made anew.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn take_over(bus: &Bus) -> Result<Self, PortError> {
        Self::hold(bus, Way::TakeOver)
    }

    /// Creates what the process of one seat opens, in a run that has no other process: the topics that
    /// its role reads and writes, and the services beside them. Whatever wakes another loop wakes
    /// the launcher, which waits at the pipe of [`stand_in`].
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn create_for(bus: &Bus, graph: &Graph, seat: Seat) -> Result<Self, PortError> {
        let mut holder = Holder::new(bus, Way::Create, Some((graph, seat.role)));
        topics::visit_all(&mut holder)?;
        let (pipe, mut neighbours) = (stand_in(graph, seat.role), Vec::new());
        bus.create_wake(seat)?;
        bus.create_wake(pipe)?;
        for node in graph.nodes().iter().filter(|node| node.role != seat.role) {
            let upstream = graph.reads_marks(seat.role, node.role);
            let downstream = graph.waits_for(node.role, seat.role);
            neighbours.extend(Seat::all(node.role).filter(|_| upstream));
            for woken in Seat::all(node.role).filter(|woken| downstream && *woken != pipe) {
                bus.share_wake(woken, pipe)?;
            }
        }
        for neighbour in neighbours {
            holder.service::<Progress>(ServiceKind::Progress(neighbour), 4)?;
        }
        holder.seat(seat)?;
        holder.launcher()?;
        Ok(holder.held())
    }

    /// Links all files a second time, so that they can be put back.
    ///
    /// # Errors
    /// The run's folder cannot be written.
    pub fn protect(&mut self, bus: &Bus) -> Result<(), PortError> {
        self.spare = Some(bus.spare_services()?);
        Ok(())
    }

    /// Puts back what another program has removed since the last look, perhaps for others of their names: any client of
    /// the transport can remove a service by force. What is seen at once is a change in the list of services, everything
    /// else only if `all_files` are to be looked at.
    pub fn put_back(&mut self, bus: &Bus, all_files: bool) -> Option<RemovedServices> {
        let spare = self.spare.as_mut()?;
        if spare.are_in_place(all_files) {
            // Without room for a link the file itself is still there.
            let _ = all_files.then(|| spare.renew());
            return None;
        }
        let mut names: Vec<_> =
            self.names.iter().filter(|name| !bus.has_service(name)).cloned().collect();
        if names.is_empty() {
            names.push("one whose files are others now".to_owned());
        }
        Some(RemovedServices { names, put_back: spare.put_back() })
    }

    fn hold(bus: &Bus, way: Way) -> Result<Self, PortError> {
        let mut holder = Holder::new(bus, way, None);
        topics::visit_all(&mut holder)?;
        Role::STEPPING.into_iter().flat_map(Seat::all).try_for_each(|seat| holder.seat(seat))?;
        holder.launcher()?;
        Ok(holder.held())
    }
}

/// True if a process of `role` reads or writes a topic.
#[must_use]
pub fn concerns(graph: &Graph, role: Role, topic: &TopicInfo) -> bool {
    // Owner records state when each member of a slot is to leave; statistics are about every loop.
    let of_all = [&topics::LOOP_STATS.info, &topics::DEVIATION.info];
    topic.to.contains(&role)
        || graph.producer(topic) == role
        || Slot::of_owner_records(topic).is_some()
        || of_all.iter().any(|one| one.name == topic.name)
}

/// The seat whose pipe stands for all that a process of `role` wakes, in a run that has no other process.
#[must_use]
pub fn stand_in(graph: &Graph, role: Role) -> Seat {
    let woken = |other: &Role| *other != role && graph.waits_for(*other, role);
    let roles = graph.nodes().iter().map(|node| node.role);
    Seat::first(roles.into_iter().find(woken).unwrap_or(Role::Plant))
}

/// Wakes the processes on all seats.
#[derive(Debug)]
pub struct Wakers {
    wakers: Vec<WakeNotifier>,
}

impl Wakers {
    /// Opens the wake-ups of these roles.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn open(bus: &Bus, roles: &[Role]) -> Result<Self, PortError> {
        let seats = roles.iter().flat_map(|&role| Seat::all(role));
        let wakers = seats.map(|seat| WakeNotifier::open(bus, seat)).collect::<Result<_, _>>()?;
        Ok(Self { wakers })
    }

    /// Wakes every process.
    pub fn wake_all(&self) {
        for waker in &self.wakers {
            waker.wake();
        }
    }
}
