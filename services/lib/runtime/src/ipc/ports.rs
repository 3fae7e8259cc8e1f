//! Typed publishers and subscribers behind the [`Source`] and [`Sink`] of a service.

use super::{Bus, FLYING_CAPACITY, Ipc, PortError, ServiceKind, TopicFactory};
use crate::input::Source;
use crate::output::Sink;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::ZeroCopySend;
use shared_types::wire::Wire;
use shared_types::{Author, Sample, Stamped, Topic};

/// Splits a publisher's identity for the wire.
pub(crate) fn author(id: u128) -> Author {
    #[expect(clippy::cast_possible_truncation, reason = "both halves are kept")]
    [(id >> 64) as u64, id as u64]
}

/// A subscriber.
#[derive(Debug)]
pub struct IpcSource<T: Wire + ZeroCopySend> {
    subscriber: Subscriber<Ipc, T, ()>,
}

impl<T: Wire + ZeroCopySend> IpcSource<T> {
    /// A reader for a step: as deep as the largest batch.
    ///
    /// # Errors
    /// The topic has too many readers.
    pub fn flying(factory: &TopicFactory<T>) -> Result<Self, PortError> {
        Self::with_capacity(factory, FLYING_CAPACITY)
    }

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
        Ok(Self { subscriber })
    }
}

impl<T: Wire + ZeroCopySend> Source<T> for IpcSource<T> {
    fn receive(&mut self) -> Option<Stamped<T>> {
        // A failed connection to one publisher must not silence the others; it is retried at the
        // next call, and a lost sample shows as a gap in the sequence.
        let sample = self.subscriber.receive().ok().flatten()?;
        Some(Stamped { sample: *sample.payload(), author: author(sample.origin().value()) })
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

    /// Identity by which readers know this writer.
    #[must_use]
    pub fn author(&self) -> Author {
        author(self.publisher.id().value())
    }
}

impl<T: Wire + ZeroCopySend> Sink<T> for IpcSink<T> {
    fn send(&mut self, sample: T) {
        // With overflow on, sending fails only if the segment is gone; the reader then sees a gap
        // in the sequence, which is counted there.
        if let Ok(slot) = self.publisher.loan_uninit() {
            let _ = slot.write_payload(sample).send();
        }
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
        while let Some(stamped) = self.source.receive() {
            show(&stamped.sample);
            self.latest = Some(stamped.sample);
        }
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
        self.create::<T>(&kind.name(), capacity, 1)
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

    /// Opens a topic for reading in flight.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn reader<T: Sample>(&self, topic: &'static Topic<T>) -> Result<IpcSource<T>, PortError> {
        IpcSource::flying(&self.open_topic(topic)?)
    }
}

fn factory_name<T: Wire + ZeroCopySend>(factory: &TopicFactory<T>) -> &str {
    use iceoryx2::service::port_factory::PortFactory as _;
    factory.name().as_str()
}
