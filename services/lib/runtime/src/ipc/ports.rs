//! Typed publishers and subscribers behind the [`Source`] and [`Sink`] of a service.

use super::payload::{Reader, Service, Writer, sample};
use super::registry::{Accepts, Guard, RegistryReader, SharedRegistry, Stray, node_id, pid_of};
use super::{Bus, Crowd, FLYING_CAPACITY, PortError, ServiceKind};
use crate::clock::mono_now_ns;
use crate::input::Source;
use crate::output::Sink;
use crate::upkeep::in_transport;
use core::marker::PhantomData;
use iceoryx2::identifiers::UniqueNodeId;
use shared_types::wire::Shared;
use shared_types::{
    ClockRecord, Edge as EdgeKind, NodeId, Progress, Registry, RegistryEntry, Role, Sample, Seat,
    Topic, topics,
};
use std::rc::Rc;

/// A service of one type of sample, from which ports are made. It is there for as long as it is held.
pub struct TopicFactory<T> {
    pub(super) service: Box<dyn Service>,
    samples: PhantomData<fn() -> T>,
}

impl<T> core::fmt::Debug for TopicFactory<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("TopicFactory").field(&self.service.name()).finish()
    }
}

impl<T> TopicFactory<T> {
    pub(super) fn new(service: Box<dyn Service>) -> Self {
        Self { service, samples: PhantomData }
    }

    /// Readers that there are now, in all processes.
    #[must_use]
    pub fn readers(&self) -> usize {
        self.service.readers()
    }

    /// Writers that there are now, in all processes.
    #[must_use]
    pub fn writers(&self) -> usize {
        self.service.writers()
    }
}

/// A subscriber, perhaps of those in the registry alone.
pub struct IpcSource<T> {
    reader: Box<dyn Reader>,
    /// From where samples are taken; without it, from every process.
    guard: Option<Guard<T>>,
}

impl<T: Shared> core::fmt::Debug for IpcSource<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("IpcSource").field("type", &T::SCHEMA.name).finish_non_exhaustive()
    }
}

impl<T: Shared> IpcSource<T> {
    /// A reader of a chosen depth, without history beyond it.
    ///
    /// # Errors
    /// The topic has too many readers, or is not that deep.
    pub fn with_capacity(factory: &TopicFactory<T>, capacity: usize) -> Result<Self, PortError> {
        Ok(Self { reader: factory.service.reader(Some(capacity))?, guard: None })
    }

    /// What has come next, none if it is no sample, with its writer's process: identity and process id.
    pub fn receive_from(&mut self) -> Option<(Option<T>, NodeId, u32)> {
        let mut received = None;
        self.reader.show_next(&mut |node, bytes| {
            received = Some((sample(bytes).copied(), node_id(node), pid_of(node)));
        });
        received
    }

    /// The sample in these bytes, if their writer may have written it.
    fn accepted<'a>(&self, node: UniqueNodeId, bytes: &'a [u8]) -> Option<&'a T> {
        let Some(guard) = &self.guard else { return sample(bytes) };
        guard.accepted(node, sample(bytes))
    }
}

impl<T: Shared> Source<T> for IpcSource<T> {
    fn receive(&mut self) -> Option<T> {
        let mut received = None;
        while received.is_none() {
            let mut show = |node: UniqueNodeId, bytes: &[u8]| {
                received = self.accepted(node, bytes).copied();
            };
            self.reader.show_next(&mut show).then_some(())?;
        }
        received
    }

    fn drain(&mut self, take: &mut dyn FnMut(&T, u64)) {
        let mut show = |node: UniqueNodeId, bytes: &[u8]| {
            // Before anything of it is read: a clock lets no later look begin, and each line of a sample
            // has to come from the writer's processor.
            let receive_mono_ns = mono_now_ns();
            if let Some(sample) = self.accepted(node, bytes) {
                take(sample, receive_mono_ns);
            }
        };
        while self.reader.show_next(&mut show) {}
    }
}

/// A publisher.
pub struct IpcSink<T> {
    writer: Box<dyn Writer>,
    samples: PhantomData<fn(T)>,
}

impl<T: Shared> core::fmt::Debug for IpcSink<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("IpcSink").field("type", &T::SCHEMA.name).finish_non_exhaustive()
    }
}

impl<T: Shared> IpcSink<T> {
    fn over(writer: Box<dyn Writer>) -> Self {
        Self { writer, samples: PhantomData }
    }

    /// A writer.
    ///
    /// # Errors
    /// The topic has too many writers, or shared memory is full.
    pub fn new(factory: &TopicFactory<T>) -> Result<Self, PortError> {
        factory.service.writer(size_of::<T>()).map(Self::over)
    }
}

impl<T: Shared> Sink<T> for IpcSink<T> {
    fn send(&mut self, sample: &T) {
        // With overflow on, sending fails only if the segment is gone; the reader then sees a gap
        // in the sequence, which is counted there.
        in_transport(&mut || {
            self.writer.try_send(bytemuck::bytes_of(sample));
        });
    }

    fn serve_late_joiners(&mut self) {
        self.writer.serve_late_joiners();
    }
}

/// A reader that only wants the newest sample.
#[derive(Debug)]
pub struct LatestPort<T: Shared> {
    source: IpcSource<T>,
    latest: Option<T>,
}

impl<T: Shared> LatestPort<T> {
    /// Opens a service that is not a topic, for what `accepts` lets pass.
    fn open(bus: &Bus, kind: ServiceKind, accepts: Accepts<T>) -> Result<Self, PortError> {
        Ok(Self { source: bus.guarded(&kind.name(), 2, accepts)?, latest: None })
    }

    /// The newest sample, if there ever was one.
    pub fn latest(&mut self) -> Option<&T> {
        self.for_each_new(|_| {});
        self.latest.as_ref()
    }

    /// Shows everything that has arrived since the last look. Two writers (a process and its
    /// successor) come in no particular order.
    pub fn for_each_new(&mut self, mut show: impl FnMut(&T)) {
        while let Some(sample) = self.source.receive() {
            show(&sample);
            self.latest = Some(sample);
        }
    }
}

impl LatestPort<Progress> {
    /// Opens the progress of a seat, as reported by the process that sits there.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn progress(bus: &Bus, seat: Seat) -> Result<Self, PortError> {
        Self::open(bus, ServiceKind::Progress(seat), Accepts::from_seat(seat))
    }
}

impl LatestPort<ClockRecord> {
    /// Opens the clock, as the launcher publishes it.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn clock(bus: &Bus) -> Result<Self, PortError> {
        Self::open(bus, ServiceKind::Clock, Accepts::Launcher)
    }
}

impl Bus {
    /// Creates a service that is not a topic (launcher only).
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_service<T: Shared>(
        &self,
        kind: ServiceKind,
        capacity: usize,
    ) -> Result<TopicFactory<T>, PortError> {
        let crowd = match kind {
            ServiceKind::Clock | ServiceKind::Registry => Crowd::ANNOUNCED,
            _ => Crowd::ALL,
        };
        self.create(&kind.name(), &T::SCHEMA, (capacity, 1), crowd).map(TopicFactory::new)
    }

    /// Opens a service that is not a topic.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_service<T: Shared>(&self, kind: ServiceKind) -> Result<TopicFactory<T>, PortError> {
        self.open(&kind.name(), &T::SCHEMA).map(TopicFactory::new)
    }

    /// Opens a service that is not a topic for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_writer<T: Shared>(&self, kind: ServiceKind) -> Result<IpcSink<T>, PortError> {
        self.writer_on(&kind.name(), &T::SCHEMA, size_of::<T>()).map(IpcSink::over)
    }

    /// Opens a topic for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn writer<T: Sample>(&self, topic: &'static Topic<T>) -> Result<IpcSink<T>, PortError> {
        self.writer_on(topic.info.name, &T::SCHEMA, size_of::<T>()).map(IpcSink::over)
    }

    /// Opens a topic for reading: what the processes of role `from` publish on it, and no others.
    /// Topics that every process writes about itself come from all in the registry, owner records from the launcher.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn reader_of<T: Sample>(
        &self,
        topic: &'static Topic<T>,
        from: Role,
        capacity: usize,
    ) -> Result<IpcSource<T>, PortError> {
        let accepts = match (from, topic.info.edge) {
            // What processes report of themselves; who takes a seat is the launcher's to say.
            (Role::Supervisor, EdgeKind::RecordOnly)
                if topic.info.name != topics::SEATING.info.name =>
            {
                Accepts::from_all()
            }
            (Role::Supervisor, _) => Accepts::Launcher,
            _ => Accepts::from_role(from),
        };
        self.guarded(topic.info.name, capacity, accepts)
    }

    /// Opens a topic for reading in flight.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn reader<T: Sample>(
        &self,
        topic: &'static Topic<T>,
        from: Role,
    ) -> Result<IpcSource<T>, PortError> {
        self.reader_of(topic, from, FLYING_CAPACITY)
    }
}

impl Bus {
    /// Opens a service for reading what `accepts` lets pass.
    fn guarded<T: Shared>(
        &self,
        service: &str,
        capacity: usize,
        accepts: Accepts<T>,
    ) -> Result<IpcSource<T>, PortError> {
        let reader = self.reader_on(service, &T::SCHEMA, Some(capacity))?;
        Ok(IpcSource { reader, guard: Some(self.guard(service, accepts)?) })
    }

    /// Sets from which writers a reader of `service` takes samples.
    pub(super) fn guard<T>(
        &self,
        service: &str,
        accepts: Accepts<T>,
    ) -> Result<Guard<T>, PortError> {
        let registry = match accepts {
            Accepts::Launcher => None,
            Accepts::Registered { .. } => Some(self.opened_registry()?),
        };
        Ok(Guard::new(Rc::clone(&self.authority), registry, service, accepts))
    }

    /// The registry, which is opened with the first reader that needs it.
    fn opened_registry(&self) -> Result<SharedRegistry, PortError> {
        let mut registry = self.registry.borrow_mut();
        if registry.is_none() {
            let service = ServiceKind::Registry.name();
            let port = self.guarded::<Registry>(&service, 2, Accepts::Launcher)?;
            *registry = Some(RegistryReader::new(Box::new(port)));
        }
        Ok(Rc::clone(&self.registry))
    }

    /// Shows which process sits where, as far as it is known here now.
    ///
    /// # Errors
    /// The run has no registry.
    pub fn read_registry<R>(
        &self,
        look: impl FnOnce(&[RegistryEntry]) -> R,
    ) -> Result<R, PortError> {
        let registry = self.opened_registry()?;
        let mut registry = registry.borrow_mut();
        let Some(registry) = registry.as_mut() else { unreachable!("it was opened above") };
        registry.refresh();
        Ok(look(registry.entries()))
    }

    /// Writers whose samples this process's readers have ignored.
    #[must_use]
    pub fn strays(&self) -> Vec<Stray> {
        self.authority.strays()
    }

    /// Counts a sample on a service whose writers no registry has yet, which its reader has ignored.
    pub fn count_stray(&self, kind: ServiceKind, node: NodeId, pid: u32) {
        self.authority.count_stray(node, pid, &Rc::from(kind.name()));
    }
}
