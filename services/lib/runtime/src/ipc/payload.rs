//! The transport's ports, compiled once, in this crate.
//!
//! They are much generic code, which would be compiled again for each type of sample, and in each crate that opens a
//! topic. So every service carries bytes, whose layout an attribute of the service names, and nothing outside of this file
//! names ports that carry samples: [`Service`], [`Reader`] and [`Writer`] are objects.

use super::{Bus, Crowd, Ipc, PortError, layout_attribute, service_name};
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::{AttributeSpecifier, AttributeVerifier};
use iceoryx2::service::header::payload_header::PayloadHeader as _;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::wire::{Schema, Shared};

/// How the transport aligns what follows its own header in shared memory. (It can be asked to, and then has so many bytes
/// for each byte of a slice.)
const ALIGNMENT: usize = 8;
/// Samples of a service that a reader may hold at a time.
const BORROWED: usize = 2;

/// The sample whose bytes these are; none if they are not as many as it has, or do not lie as it has to.
pub(super) fn sample<T: Shared>(bytes: &[u8]) -> Option<&T> {
    const { assert!(align_of::<T>() <= ALIGNMENT, "samples lie where this alignment suffices") };
    bytemuck::try_from_bytes(bytes).ok()
}

/// A service of the transport.
pub(super) trait Service {
    fn name(&self) -> &str;
    fn readers(&self) -> usize;
    fn writers(&self) -> usize;
    /// A reader that keeps so many samples; without a number, as many as the service allows.
    fn reader(&self, capacity: Option<usize>) -> Result<Box<dyn Reader>, PortError>;
    /// A writer of samples of up to so many bytes.
    fn writer(&self, size: usize) -> Result<Box<dyn Writer>, PortError>;
}

/// A subscriber.
pub(super) trait Reader {
    /// Shows the next sample where it lies, and which connection wrote it; false if none has arrived.
    fn show_next(&self, show: &mut dyn FnMut(UniqueNodeId, &[u8])) -> bool;
}

/// A publisher.
pub(super) trait Writer {
    /// Sends one sample; false if the transport refuses.
    fn try_send(&self, sample: &[u8]) -> bool;
    /// Lets readers that have just joined have the history.
    fn serve_late_joiners(&self);
}

type Bytes = PortFactory<Ipc, [u8], ()>;

impl Service for Bytes {
    fn name(&self) -> &str {
        iceoryx2::service::port_factory::PortFactory::name(self).as_str()
    }

    fn readers(&self) -> usize {
        self.dynamic_config().number_of_subscribers()
    }

    fn writers(&self) -> usize {
        self.dynamic_config().number_of_publishers()
    }

    fn reader(&self, capacity: Option<usize>) -> Result<Box<dyn Reader>, PortError> {
        let builder = self.subscriber_builder();
        let builder = match capacity {
            Some(capacity) => builder.buffer_size(capacity),
            None => builder,
        };
        let subscriber =
            builder.create().map_err(|error| PortError::no_reader(Service::name(self), error))?;
        Ok(Box::new(subscriber))
    }

    fn writer(&self, size: usize) -> Result<Box<dyn Writer>, PortError> {
        let publisher = self
            .publisher_builder()
            .max_loaned_samples(1)
            .initial_max_slice_len(size)
            .create()
            .map_err(|error| PortError::no_writer(Service::name(self), error))?;
        Ok(Box::new(publisher))
    }
}

impl Reader for Subscriber<Ipc, [u8], ()> {
    fn show_next(&self, show: &mut dyn FnMut(UniqueNodeId, &[u8])) -> bool {
        // A failed connection to one publisher must not silence the others; it is retried at the next
        // call, and a lost sample shows as a gap in the sequence.
        let sample = self.receive().ok().flatten();
        if let Some(sample) = &sample {
            show(sample.header().node_id(), sample.payload());
        }
        sample.is_some()
    }
}

impl Writer for Publisher<Ipc, [u8], ()> {
    fn try_send(&self, sample: &[u8]) -> bool {
        let slot = self.loan_slice_uninit(sample.len());
        slot.is_ok_and(|slot| slot.write_from_slice(sample).send().is_ok())
    }

    fn serve_late_joiners(&self) {
        let _ = self.update_connections();
    }
}

impl Bus {
    /// Creates a service that keeps up to `capacity` samples for each reader, and `history` for one that comes late.
    pub(super) fn create(
        &self,
        service: &str,
        schema: &Schema,
        (capacity, history): (usize, usize),
        crowd: Crowd,
    ) -> Result<Box<dyn Service>, PortError> {
        let (key, layout) = layout_attribute(service, schema)?;
        let attributes = AttributeSpecifier::new()
            .define(&key, &layout)
            .map_err(PortError::transport(service, "define attributes"))?;
        let created: Bytes = self
            .node()
            .service_builder(&service_name(service)?)
            .publish_subscribe::<[u8]>()
            .max_publishers(crowd.writers)
            .max_subscribers(crowd.readers)
            .max_nodes(super::MAX_NODES)
            .subscriber_max_buffer_size(capacity)
            .subscriber_max_borrowed_samples(BORROWED)
            .history_size(history)
            .enable_safe_overflow(true)
            .create_with_attributes(&attributes)
            .map_err(PortError::transport(service, "create the service"))?;
        Ok(Box::new(created))
    }

    /// Opens a service whose samples are laid out like this.
    pub(super) fn open(
        &self,
        service: &str,
        schema: &Schema,
    ) -> Result<Box<dyn Service>, PortError> {
        self.open_bytes(service, schema).or_else(|error| {
            // Looking up with what layout it was created takes as long as to open it.
            self.check_layout(service, schema)?;
            Err(error)
        })
    }

    fn open_bytes(&self, service: &str, schema: &Schema) -> Result<Box<dyn Service>, PortError> {
        let (key, layout) = layout_attribute(service, schema)?;
        let same_layout = AttributeVerifier::new()
            .require(&key, &layout)
            .map_err(PortError::transport(service, "require attributes"))?;
        let opened: Bytes = self
            .node()
            .service_builder(&service_name(service)?)
            .publish_subscribe::<[u8]>()
            .open_with_attributes(&same_layout)
            .map_err(PortError::transport(service, "open the service"))?;
        Ok(Box::new(opened))
    }
}
