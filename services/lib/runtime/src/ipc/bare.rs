//! The transport as it comes, without stamps, order, registry or marks: what measurements of the ports are
//! compared with.

use super::payload::{Reader, Writer, sample};
use super::{Bus, Crowd, Ipc, PortError, RECORDER_CAPACITY, TopicFactory, service_name};
use crate::graph::READER_CAPACITY;
use core::any::Any;
use core::marker::PhantomData;
use core::time::Duration;
use iceoryx2::service::port_factory::event;
use shared_types::wire::Shared;

/// A publisher.
pub struct BareWriter<T>(Box<dyn Writer>, PhantomData<fn(T)>);

impl<T: Shared> core::fmt::Debug for BareWriter<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("BareWriter").field("type", &T::SCHEMA.name).finish_non_exhaustive()
    }
}

impl<T: Shared> BareWriter<T> {
    /// Sends one sample; false if the transport refuses.
    pub fn send(&self, sample: &T) -> bool {
        self.0.try_send(bytemuck::bytes_of(sample))
    }
}

/// A subscriber.
pub struct BareReader<T>(Box<dyn Reader>, PhantomData<fn() -> T>);

impl<T: Shared> core::fmt::Debug for BareReader<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("BareReader").field("type", &T::SCHEMA.name).finish_non_exhaustive()
    }
}

impl<T: Shared> BareReader<T> {
    /// Shows the next sample where it lies, if one has arrived.
    pub fn receive<R>(&self, look: impl Fn(&T) -> R) -> Option<R> {
        let mut seen = None;
        self.0.show_next(&mut |_, bytes| seen = sample(bytes).map(&look));
        seen
    }
}

/// The transport's own way of waking a process.
pub struct BareNotifier(Box<dyn Fn()>);

impl core::fmt::Debug for BareNotifier {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("BareNotifier").finish_non_exhaustive()
    }
}

impl BareNotifier {
    /// Wakes every process that listens.
    pub fn notify(&self) {
        (self.0)();
    }
}

/// The transport's own way of being woken.
pub struct BareListener(Box<dyn Fn(Duration) -> bool>);

impl core::fmt::Debug for BareListener {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("BareListener").finish_non_exhaustive()
    }
}

impl BareListener {
    /// Waits for a notification, at most this long; true if there was one.
    #[must_use]
    pub fn wait(&self, limit: Duration) -> bool {
        (self.0)(limit)
    }
}

/// Keeps an event service there.
#[derive(Debug)]
pub struct BareEvents(#[expect(dead_code, reason = "held until it is dropped")] Box<dyn Any>);

impl Bus {
    /// Creates a service of samples as deep as a topic's, which keeps so many for a reader that comes
    /// late.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_bare<T: Shared>(
        &self,
        name: &str,
        history: usize,
    ) -> Result<TopicFactory<T>, PortError> {
        let depth = (RECORDER_CAPACITY, history);
        self.create(name, &T::SCHEMA, depth, Crowd::ALL).map(TopicFactory::new)
    }

    /// Opens such a service for writing.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_writer<T: Shared>(&self, name: &str) -> Result<BareWriter<T>, PortError> {
        let writer = self.open(name, &T::SCHEMA)?.writer(size_of::<T>())?;
        Ok(BareWriter(writer, PhantomData))
    }

    /// Opens such a service for reading.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_reader<T: Shared>(&self, name: &str) -> Result<BareReader<T>, PortError> {
        let reader = self.open(name, &T::SCHEMA)?.reader(Some(READER_CAPACITY))?;
        Ok(BareReader(reader, PhantomData))
    }

    /// Creates an event service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_bare_events(&self, name: &str) -> Result<BareEvents, PortError> {
        let builder = self.node().service_builder(&service_name(name)?).event();
        let events = builder.create().map_err(PortError::transport(name, "create the events"))?;
        Ok(BareEvents(Box::new(events)))
    }

    /// Opens the waking end of an event service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_notifier(&self, name: &str) -> Result<BareNotifier, PortError> {
        let notifier = self.open_bare_events(name)?.notifier_builder().create();
        let notifier = notifier.map_err(PortError::transport(name, "create a notifier"))?;
        Ok(BareNotifier(Box::new(move || {
            // Without a listener this is fine too.
            let _ = notifier.notify();
        })))
    }

    /// Opens the waiting end of an event service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn bare_listener(&self, name: &str) -> Result<BareListener, PortError> {
        let listener = self.open_bare_events(name)?.listener_builder().create();
        let listener = listener.map_err(PortError::transport(name, "create a listener"))?;
        Ok(BareListener(Box::new(move |limit| {
            let mut woken = false;
            let waited = listener.timed_wait(|_| woken = true, limit);
            waited.is_ok() && woken
        })))
    }

    fn open_bare_events(&self, name: &str) -> Result<event::PortFactory<Ipc>, PortError> {
        let builder = self.node().service_builder(&service_name(name)?).event();
        builder.open().map_err(PortError::transport(name, "open the events"))
    }
}
