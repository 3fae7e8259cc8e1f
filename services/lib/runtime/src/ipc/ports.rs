//! Typed publishers and subscribers behind the [`Source`] and [`Sink`] of a service.

use super::payload::{Reader, Service, Writer};
use super::registry::{Accepts, Guard, RegistryReader, Stray};
use super::{Bus, Crowd, FLYING_CAPACITY, PortError, ServiceKind};
use crate::input::Source;
use crate::output::Sink;
use shared_types::wire::Wire;
use shared_types::{
    ClockRecord, Edge as EdgeKind, NodeId, Progress, Registry, RegistryEntry, Role, Sample, Seat,
    Topic, topics,
};
use std::rc::Rc;

/// A service of one payload, from which ports are made. It is there for as long as it is held.
pub struct TopicFactory<T>(pub(super) Box<dyn Service<T>>);

impl<T> core::fmt::Debug for TopicFactory<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("TopicFactory").field(&self.0.name()).finish()
    }
}

impl<T> TopicFactory<T> {
    /// Readers that there are now, in all processes.
    #[must_use]
    pub fn readers(&self) -> usize {
        self.0.readers()
    }

    /// Writers that there are now, in all processes.
    #[must_use]
    pub fn writers(&self) -> usize {
        self.0.writers()
    }
}

/// A subscriber, perhaps of those in the registry alone.
pub struct IpcSource<T>(Box<dyn Reader<T>>);

impl<T: Wire> core::fmt::Debug for IpcSource<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("IpcSource").field("type", &T::SCHEMA.name).finish_non_exhaustive()
    }
}

impl<T> IpcSource<T> {
    /// A reader of a chosen depth, without history beyond it.
    ///
    /// # Errors
    /// The topic has too many readers, or is not that deep.
    pub fn with_capacity(factory: &TopicFactory<T>, capacity: usize) -> Result<Self, PortError> {
        factory.0.reader(capacity).map(Self)
    }

    /// The next sample with its writer's process: identity and process id.
    pub fn receive_from(&mut self) -> Option<(T, NodeId, u32)> {
        self.0.receive_from()
    }
}

impl<T> Source<T> for IpcSource<T> {
    fn receive(&mut self) -> Option<T> {
        self.0.receive()
    }

    fn drain(&mut self, take: &mut dyn FnMut(&T, u64)) {
        self.0.drain(take);
    }
}

/// A publisher.
pub struct IpcSink<T>(Box<dyn Writer<T>>);

impl<T: Wire> core::fmt::Debug for IpcSink<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("IpcSink").field("type", &T::SCHEMA.name).finish_non_exhaustive()
    }
}

impl<T> IpcSink<T> {
    /// A writer.
    ///
    /// # Errors
    /// The topic has too many writers, or shared memory is full.
    pub fn new(factory: &TopicFactory<T>) -> Result<Self, PortError> {
        factory.0.writer().map(Self)
    }
}

impl<T> Sink<T> for IpcSink<T> {
    fn send(&mut self, sample: &T) {
        self.0.send(sample);
    }

    fn serve_late_joiners(&mut self) {
        self.0.serve_late_joiners();
    }
}

/// A reader that only wants the newest sample.
#[derive(Debug)]
pub struct LatestPort<T: Wire> {
    source: IpcSource<T>,
    latest: Option<T>,
}

impl<T: Wire + 'static> LatestPort<T> {
    /// Opens a service that is not a topic, for what `accepts` lets pass.
    fn open(bus: &Bus, kind: ServiceKind, accepts: Accepts<T>) -> Result<Self, PortError> {
        let factory = bus.open::<T>(&kind.name())?;
        let mut source = bus.with_room(|| IpcSource::with_capacity(&factory, 2))?;
        source.0.guard(bus.guard(&kind.name(), accepts)?);
        Ok(Self { source, latest: None })
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
    pub fn create_service<T: Wire + 'static>(
        &self,
        kind: ServiceKind,
        capacity: usize,
    ) -> Result<TopicFactory<T>, PortError> {
        let crowd = match kind {
            ServiceKind::Clock | ServiceKind::Registry => Crowd::ANNOUNCED,
            _ => Crowd::ALL,
        };
        self.create::<T>(&kind.name(), capacity, 1, crowd)
    }

    /// Opens a service that is not a topic.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_service<T: Wire + 'static>(
        &self,
        kind: ServiceKind,
    ) -> Result<TopicFactory<T>, PortError> {
        self.open::<T>(&kind.name())
    }

    /// Opens a service that is not a topic for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_writer<T: Wire + 'static>(
        &self,
        kind: ServiceKind,
    ) -> Result<IpcSink<T>, PortError> {
        let factory = self.open::<T>(&kind.name())?;
        self.with_room(|| IpcSink::new(&factory))
    }

    /// Opens a topic for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn writer<T: Sample>(&self, topic: &'static Topic<T>) -> Result<IpcSink<T>, PortError> {
        let factory = self.open_topic(topic)?;
        self.with_room(|| IpcSink::new(&factory))
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
        let factory = self.open_topic(topic)?;
        let mut source = self.with_room(|| IpcSource::with_capacity(&factory, capacity))?;
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
        source.0.guard(self.guard(topic.info.name, accepts)?);
        Ok(source)
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
    /// Sets from which writers a reader of `service` takes samples.
    pub(super) fn guard<T>(
        &self,
        service: &str,
        accepts: Accepts<T>,
    ) -> Result<Guard<T>, PortError> {
        let registry = match accepts {
            Accepts::Launcher => None,
            Accepts::Registered { .. } => {
                self.with_registry(|_| ())?;
                Some(Rc::clone(&self.registry))
            }
        };
        Ok(Guard::new(Rc::clone(&self.authority), registry, service, accepts))
    }

    fn with_registry<R>(
        &self,
        look: impl FnOnce(&mut RegistryReader) -> R,
    ) -> Result<R, PortError> {
        let mut registry = self.registry.borrow_mut();
        if registry.is_none() {
            let kind = ServiceKind::Registry;
            let factory = self.open_service::<Registry>(kind)?;
            let mut port = self.with_room(|| IpcSource::with_capacity(&factory, 2))?;
            port.0.guard(self.guard(&kind.name(), Accepts::Launcher)?);
            *registry = Some(RegistryReader::new(Box::new(port)));
        }
        match registry.as_mut() {
            Some(registry) => Ok(look(registry)),
            None => unreachable!("it was opened above"),
        }
    }

    /// Shows which process sits where, as far as it is known here now.
    ///
    /// # Errors
    /// The run has no registry.
    pub fn read_registry<R>(
        &self,
        look: impl FnOnce(&[RegistryEntry]) -> R,
    ) -> Result<R, PortError> {
        self.with_registry(|registry| {
            registry.refresh();
            look(registry.entries())
        })
    }

    /// Writers whose samples this process's readers have ignored.
    #[must_use]
    pub fn strays(&self) -> Vec<Stray> {
        self.authority.strays()
    }
}
