//! Ports by the type of their payload, each compiled once, in this crate.
//!
//! The transport's ports are much generic code, which every crate that opens a topic would compile again for each type.
//! So nothing outside of this file names them: [`Service`], [`Reader`] and [`Sink`] are objects, and
//! [`maker`] finds what makes them by the type of the payload.

use super::registry::{Guard, node_id};
use super::{Bus, Crowd, Ipc, PortError};
use crate::clock::mono_now_ns;
use crate::input::Source;
use crate::output::Sink;
use crate::upkeep::in_transport;
use core::any::{Any, TypeId};
use core::convert::Infallible;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::service::header::payload_header::PayloadHeader as _;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::wire::Wire;
use shared_types::{
    ClockRecord, Hello, NodeId, Progress, Registry, Sample, Topic, TopicVisitor, topics,
};

/// A service of the transport.
pub(super) trait Service<T> {
    fn name(&self) -> &str;
    fn readers(&self) -> usize;
    fn writers(&self) -> usize;
    /// A reader of a chosen depth, without history beyond it.
    fn reader(&self, capacity: usize) -> Result<Box<dyn Reader<T>>, PortError>;
    fn writer(&self) -> Result<Box<dyn Writer<T>>, PortError>;
}

/// A subscriber, perhaps of those in the registry alone.
pub(super) trait Reader<T>: Source<T> {
    /// From now on lets only samples pass that come from the seat that they claim.
    fn guard(&mut self, guard: Guard<T>);
    /// The next sample with its writer's process: identity and process id.
    fn receive_from(&mut self) -> Option<(T, NodeId, u32)>;
    /// Shows the next sample where it lies, whichever process wrote it; false if none has arrived.
    fn show_next(&self, show: &mut dyn FnMut(&T)) -> bool;
}

/// A publisher.
pub(super) trait Writer<T>: Sink<T> {
    /// Sends one sample, whose allocations nothing counts; false if the transport refuses.
    fn try_send(&self, sample: &T) -> bool;
}

impl<T: Wire + ZeroCopySend> Service<T> for PortFactory<Ipc, T, ()> {
    fn name(&self) -> &str {
        iceoryx2::service::port_factory::PortFactory::name(self).as_str()
    }

    fn readers(&self) -> usize {
        self.dynamic_config().number_of_subscribers()
    }

    fn writers(&self) -> usize {
        self.dynamic_config().number_of_publishers()
    }

    fn reader(&self, capacity: usize) -> Result<Box<dyn Reader<T>>, PortError> {
        let subscriber = self
            .subscriber_builder()
            .buffer_size(capacity)
            .create()
            .map_err(|error| PortError::no_reader(Service::name(self), error))?;
        Ok(Box::new(PayloadReader { subscriber, guard: None }))
    }

    fn writer(&self) -> Result<Box<dyn Writer<T>>, PortError> {
        let publisher = self
            .publisher_builder()
            .max_loaned_samples(1)
            .create()
            .map_err(|error| PortError::no_writer(Service::name(self), error))?;
        Ok(Box::new(PayloadWriter { publisher }))
    }
}

/// A sample in shared memory, which its writer lends.
type Lent<T> = iceoryx2::sample::Sample<Ipc, T, ()>;

struct PayloadReader<T: Wire + ZeroCopySend> {
    subscriber: Subscriber<Ipc, T, ()>,
    guard: Option<Guard<T>>,
}

impl<T: Wire + ZeroCopySend> PayloadReader<T> {
    /// The next sample, where it lies.
    fn next(&self) -> Option<Lent<T>> {
        // A failed connection to one publisher must not silence the others; it is retried at the next
        // call, and a lost sample shows as a gap in the sequence.
        self.subscriber.receive().ok().flatten()
    }

    /// True if it comes from a process that may write.
    fn passes(&self, sample: &Lent<T>) -> bool {
        let passes = |guard: &Guard<T>| guard.passes(sample.header().node_id(), sample);
        self.guard.as_ref().is_none_or(passes)
    }
}

impl<T: Wire + ZeroCopySend> Source<T> for PayloadReader<T> {
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

impl<T: Wire + ZeroCopySend> Reader<T> for PayloadReader<T> {
    fn guard(&mut self, guard: Guard<T>) {
        self.guard = Some(guard);
    }

    fn receive_from(&mut self) -> Option<(T, NodeId, u32)> {
        let sample = self.next()?;
        let node = sample.header().node_id();
        let pid = node.pid::<Ipc>().map_or(0, |pid| pid.value().cast_unsigned());
        Some((*sample.payload(), node_id(node), pid))
    }

    fn show_next(&self, show: &mut dyn FnMut(&T)) -> bool {
        let sample = self.next();
        if let Some(sample) = &sample {
            show(sample.payload());
        }
        sample.is_some()
    }
}

struct PayloadWriter<T: Wire + ZeroCopySend> {
    publisher: Publisher<Ipc, T, ()>,
}

impl<T: Wire + ZeroCopySend> Sink<T> for PayloadWriter<T> {
    fn send(&mut self, sample: &T) {
        // With overflow on, sending fails only if the segment is gone; the reader then sees a gap
        // in the sequence, which is counted there.
        in_transport(&mut || {
            self.try_send(sample);
        });
    }

    fn serve_late_joiners(&mut self) {
        let _ = self.publisher.update_connections();
    }
}

impl<T: Wire + ZeroCopySend> Writer<T> for PayloadWriter<T> {
    fn try_send(&self, sample: &T) -> bool {
        let slot = self.publisher.loan_uninit();
        slot.is_ok_and(|slot| slot.write_payload(*sample).send().is_ok())
    }
}

/// A service of one type, or why there is none.
type Made<T> = Result<Box<dyn Service<T>>, PortError>;

/// Makes and finds the services of one type.
pub(super) struct Maker<T> {
    pub(super) create: fn(&Bus, &str, usize, usize, Crowd) -> Made<T>,
    pub(super) open: fn(&Bus, &str) -> Made<T>,
}

impl<T: Wire + ZeroCopySend + 'static> Maker<T> {
    const OF_TYPE: Self = Self {
        create: |bus, name, capacity, history, crowd| {
            Ok(Box::new(bus.create_payload::<T>(name, capacity, history, crowd)?))
        },
        open: |bus, name| Ok(Box::new(bus.open_payload::<T>(name)?)),
    };
}

/// What makes the services of a type, which must be that of a topic or of a service beside the topics.
pub(super) fn maker<T: Wire + 'static>(service: &str) -> Result<&'static Maker<T>, PortError> {
    let maker = maker_of(TypeId::of::<T>()).and_then(|maker| maker.downcast_ref());
    maker.ok_or_else(|| PortError::Transport {
        service: service.to_owned(),
        action: "make ports",
        reason: format!("{} is not the type of a topic", T::SCHEMA.name),
    })
}

/// The maker for a type that is only known by its identity.
fn maker_of(id: TypeId) -> Option<&'static dyn Any> {
    if id == TypeId::of::<ClockRecord>() {
        Some(&Maker::<ClockRecord>::OF_TYPE)
    } else if id == TypeId::of::<Hello>() {
        Some(&Maker::<Hello>::OF_TYPE)
    } else if id == TypeId::of::<Progress>() {
        Some(&Maker::<Progress>::OF_TYPE)
    } else if id == TypeId::of::<Registry>() {
        Some(&Maker::<Registry>::OF_TYPE)
    } else {
        let mut search = Search { id, found: None };
        let Ok(()) = topics::visit_all(&mut search);
        search.found
    }
}

/// Looks for the maker of a type among those of the topics.
struct Search {
    id: TypeId,
    found: Option<&'static dyn Any>,
}

impl TopicVisitor for Search {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, _topic: &'static Topic<T>) -> Result<(), Infallible> {
        if self.id == TypeId::of::<T>() {
            self.found = Some(&Maker::<T>::OF_TYPE);
        }
        Ok(())
    }
}
