//! The transport as it comes, without stamps, order, roll or marks: what measurements of the ports are
//! compared with.

use super::{Bus, Crowd, Ipc, PortError, RECORDER_CAPACITY, service_name};
use crate::graph::READER_CAPACITY;
use core::time::Duration;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use shared_types::wire::Wire;

/// Keeps a service of samples there.
pub type BareService<T> = publish_subscribe::PortFactory<Ipc, T, ()>;

/// A publisher.
#[derive(Debug)]
pub struct BareWriter<T: Wire + ZeroCopySend>(Publisher<Ipc, T, ()>);

impl<T: Wire + ZeroCopySend> BareWriter<T> {
    /// Sends one sample; false if the transport refuses.
    pub fn send(&self, sample: T) -> bool {
        self.0.loan_uninit().is_ok_and(|slot| slot.write_payload(sample).send().is_ok())
    }
}

/// A subscriber.
#[derive(Debug)]
pub struct BareReader<T: Wire + ZeroCopySend>(Subscriber<Ipc, T, ()>);

impl<T: Wire + ZeroCopySend> BareReader<T> {
    /// Shows the next sample where it lies, if one has arrived.
    pub fn receive<R>(&self, look: impl FnOnce(&T) -> R) -> Option<R> {
        let sample = self.0.receive().ok().flatten()?;
        Some(look(sample.payload()))
    }
}

/// The transport's own way of waking somebody.
#[derive(Debug)]
pub struct BareNotifier(Notifier<Ipc>);

impl BareNotifier {
    /// Wakes whoever listens.
    pub fn notify(&self) {
        // Nobody listening is fine.
        let _ = self.0.notify();
    }
}

/// The transport's own way of being woken.
#[derive(Debug)]
pub struct BareListener(Listener<Ipc>);

impl BareListener {
    /// Waits until somebody notifies, at most this long; true if somebody did.
    #[must_use]
    pub fn wait(&self, limit: Duration) -> bool {
        let mut woken = false;
        let waited = self.0.timed_wait(|_| woken = true, limit);
        waited.is_ok() && woken
    }
}

/// Keeps an event service there.
pub type BareEvents = event::PortFactory<Ipc>;

impl Bus {
    /// Creates a service of samples as deep as a topic's, which keeps so many for a reader that comes
    /// late.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_bare<T: Wire + ZeroCopySend>(
        &self,
        name: &str,
        history: usize,
    ) -> Result<BareService<T>, PortError> {
        self.create_payload::<T>(name, RECORDER_CAPACITY, history, Crowd::ALL)
    }

    /// Opens such a service for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_writer<T: Wire + ZeroCopySend>(
        &self,
        name: &str,
    ) -> Result<BareWriter<T>, PortError> {
        self.check_layout(name, &T::SCHEMA)?;
        let factory = self.open_payload::<T>(name)?;
        let publisher = factory.publisher_builder().max_loaned_samples(1).create();
        Ok(BareWriter(publisher.map_err(PortError::transport(name, "create a writer"))?))
    }

    /// Opens such a service for reading.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_reader<T: Wire + ZeroCopySend>(
        &self,
        name: &str,
    ) -> Result<BareReader<T>, PortError> {
        self.check_layout(name, &T::SCHEMA)?;
        let factory = self.open_payload::<T>(name)?;
        let subscriber = factory.subscriber_builder().buffer_size(READER_CAPACITY).create();
        Ok(BareReader(subscriber.map_err(PortError::transport(name, "create a reader"))?))
    }

    /// Creates an event service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_bare_events(&self, name: &str) -> Result<BareEvents, PortError> {
        let builder = self.node.service_builder(&service_name(name)?).event();
        builder.create().map_err(PortError::transport(name, "create the events"))
    }

    /// Opens the waking end of an event service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_notifier(&self, name: &str) -> Result<BareNotifier, PortError> {
        let notifier = self.open_bare_events(name)?.notifier_builder().create();
        Ok(BareNotifier(notifier.map_err(PortError::transport(name, "create a notifier"))?))
    }

    /// Opens the waiting end of an event service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_listener(&self, name: &str) -> Result<BareListener, PortError> {
        let listener = self.open_bare_events(name)?.listener_builder().create();
        Ok(BareListener(listener.map_err(PortError::transport(name, "create a listener"))?))
    }

    fn open_bare_events(&self, name: &str) -> Result<BareEvents, PortError> {
        let builder = self.node.service_builder(&service_name(name)?).event();
        builder.open().map_err(PortError::transport(name, "open the events"))
    }
}
