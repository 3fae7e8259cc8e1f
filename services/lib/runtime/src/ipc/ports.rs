//! Typed publishers and subscribers behind the [`Source`] and [`Sink`] of a service.

use super::roll::{Accepts, Guard, node_id};
use super::{Bus, Crowd, FLYING_CAPACITY, Ipc, PortError, ServiceKind, TopicFactory};
use crate::clock::mono_now_ns;
use crate::input::Source;
use crate::output::Sink;
use crate::upkeep::in_transport;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::service::header::payload_header::PayloadHeader as _;
use shared_types::wire::Wire;
use shared_types::{Edge as EdgeKind, NodeId, Progress, Role, Sample, Seat, Topic};

/// A sample in shared memory, which its writer lends.
type Lent<T> = iceoryx2::sample::Sample<Ipc, T, ()>;

/// A subscriber, perhaps of those on the roll alone.
pub struct IpcSource<T: Wire + ZeroCopySend> {
    subscriber: Subscriber<Ipc, T, ()>,
    guard: Option<Guard<T>>,
}

impl<T: Wire + ZeroCopySend> core::fmt::Debug for IpcSource<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("IpcSource").field("type", &T::SCHEMA.name).finish_non_exhaustive()
    }
}

impl<T: Wire + ZeroCopySend> IpcSource<T> {
    /// A reader of a chosen depth, without history beyond it.
    ///
    /// # Errors
    /// The topic has too many readers, or is not that deep.
    pub fn with_capacity(factory: &TopicFactory<T>, capacity: usize) -> Result<Self, PortError> {
        let subscriber = factory
            .subscriber_builder()
            .buffer_size(capacity)
            .create()
            .map_err(PortError::transport(factory_name(factory), "create a reader"))?;
        Ok(Self { subscriber, guard: None })
    }

    fn guarded(self, guard: Guard<T>) -> Self {
        Self { guard: Some(guard), ..self }
    }

    /// The next sample with its writer's process: identity and process id.
    pub fn receive_from(&mut self) -> Option<(T, NodeId, u32)> {
        let sample = self.subscriber.receive().ok().flatten()?;
        let node = sample.header().node_id();
        let pid = node.pid::<Ipc>().map_or(0, |pid| pid.value().cast_unsigned());
        Some((*sample.payload(), node_id(node), pid))
    }
}

impl<T: Wire + ZeroCopySend> IpcSource<T> {
    /// The next sample, where it lies.
    fn next(&self) -> Option<Lent<T>> {
        // A failed connection to one publisher must not silence the others; it is retried at the next
        // call, and a lost sample shows as a gap in the sequence.
        self.subscriber.receive().ok().flatten()
    }

    /// True if it comes from whoever may write.
    fn passes(&self, sample: &Lent<T>) -> bool {
        let passes = |guard: &Guard<T>| guard.passes(sample.header().node_id(), sample);
        self.guard.as_ref().is_none_or(passes)
    }
}

impl<T: Wire + ZeroCopySend> Source<T> for IpcSource<T> {
    fn receive(&mut self) -> Option<T> {
        loop {
            let sample = self.next()?;
            if self.passes(&sample) {
                return Some(*sample);
            }
        }
    }

    fn drain(&mut self, take: &mut dyn FnMut(&T, u64)) {
        while let Some(sample) = self.next() {
            // Before anything of it is read: a clock lets no later look begin, and each line of a sample
            // has to come from the writer's processor.
            let receive_mono_ns = mono_now_ns();
            if self.passes(&sample) {
                take(&sample, receive_mono_ns);
            }
        }
    }
}

/// A publisher.
#[derive(Debug)]
pub struct IpcSink<T: Wire + ZeroCopySend> {
    publisher: Publisher<Ipc, T, ()>,
}

impl<T: Wire + ZeroCopySend> IpcSink<T> {
    /// A writer.
    ///
    /// # Errors
    /// The topic has too many writers, or shared memory is full.
    pub fn new(factory: &TopicFactory<T>) -> Result<Self, PortError> {
        let publisher = factory
            .publisher_builder()
            .max_loaned_samples(1)
            .create()
            .map_err(PortError::transport(factory_name(factory), "create a writer"))?;
        Ok(Self { publisher })
    }
}

impl<T: Wire + ZeroCopySend> Sink<T> for IpcSink<T> {
    fn send(&mut self, sample: &T) {
        // With overflow on, sending fails only if the segment is gone; the reader then sees a gap
        // in the sequence, which is counted there.
        in_transport(&mut || {
            if let Ok(slot) = self.publisher.loan_uninit() {
                let _ = slot.write_payload(*sample).send();
            }
        });
    }

    fn serve_late_joiners(&mut self) {
        let _ = self.publisher.update_connections();
    }
}

/// A reader that only wants the newest sample.
#[derive(Debug)]
pub struct LatestPort<T: Wire + ZeroCopySend> {
    source: IpcSource<T>,
    latest: Option<T>,
}

impl<T: Wire + ZeroCopySend> LatestPort<T> {
    /// Opens a service that is not a topic.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, kind: ServiceKind) -> Result<Self, PortError> {
        let factory = bus.open::<T>(&kind.name())?;
        Ok(Self { source: IpcSource::with_capacity(&factory, 2)?, latest: None })
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
    /// Opens the progress of a seat, as told by whoever sits there.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn progress(bus: &Bus, seat: Seat) -> Result<Self, PortError> {
        let kind = ServiceKind::Progress(seat);
        let Self { source, latest } = Self::open(bus, kind)?;
        let guard = bus.guard(&kind.name(), Accepts::from_seat(seat))?;
        Ok(Self { source: source.guarded(guard), latest })
    }
}

impl Bus {
    /// Creates a service that is not a topic (launcher only).
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_service<T: Wire + ZeroCopySend>(
        &self,
        kind: ServiceKind,
        capacity: usize,
    ) -> Result<TopicFactory<T>, PortError> {
        let crowd = match kind {
            ServiceKind::Clock | ServiceKind::Roll => Crowd::ANNOUNCED,
            _ => Crowd::ALL,
        };
        self.create::<T>(&kind.name(), capacity, 1, crowd)
    }

    /// Opens a service that is not a topic.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_service<T: Wire + ZeroCopySend>(
        &self,
        kind: ServiceKind,
    ) -> Result<TopicFactory<T>, PortError> {
        self.open::<T>(&kind.name())
    }

    /// Opens a service that is not a topic for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_writer<T: Wire + ZeroCopySend>(
        &self,
        kind: ServiceKind,
    ) -> Result<IpcSink<T>, PortError> {
        IpcSink::new(&self.open::<T>(&kind.name())?)
    }

    /// Opens a topic for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn writer<T: Sample>(&self, topic: &'static Topic<T>) -> Result<IpcSink<T>, PortError> {
        IpcSink::new(&self.open_topic(topic)?)
    }

    /// Opens a topic for reading: what the processes of role `from` publish on it, and nobody else.
    /// Topics that everybody writes about itself come from all on the roll; an owner record has one
    /// writer, the transport sees to that.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn reader_of<T: Sample>(
        &self,
        topic: &'static Topic<T>,
        from: Role,
        capacity: usize,
    ) -> Result<IpcSource<T>, PortError> {
        let source = IpcSource::with_capacity(&self.open_topic(topic)?, capacity)?;
        let accepts = match (from, topic.info.edge) {
            (Role::Supervisor, EdgeKind::RecordOnly) => Accepts::from_all(),
            (Role::Supervisor, _) => return Ok(source),
            _ => Accepts::from_role(from),
        };
        Ok(source.guarded(self.guard(topic.info.name, accepts)?))
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

fn factory_name<T: Wire + ZeroCopySend>(factory: &TopicFactory<T>) -> &str {
    use iceoryx2::service::port_factory::PortFactory as _;
    factory.name().as_str()
}
