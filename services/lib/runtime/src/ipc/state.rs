//! Published states: packed bytes of one service kind, with the header of the step. As with the ports of the topics, the
//! transport's own objects stay in this crate, so that no other one compiles their code again.

use super::registry::{Accepts, Guard};
use super::{Bus, Ipc, PortError, ServiceKind, service_name};
use crate::executor::StateSink;
use crate::upkeep::in_transport;
use core::any::Any;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::service::header::payload_header::PayloadHeader as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::{Header, Seat};

type States = PortFactory<Ipc, [u8], Header>;

/// A state or hand-over service, which is there for as long as it is held.
#[derive(Debug)]
pub struct StateService(#[expect(dead_code, reason = "held until it is dropped")] Box<dyn Any>);

impl Bus {
    /// Creates a state or hand-over service whose readers keep `depth` states (launcher only).
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_state_service(
        &self,
        kind: ServiceKind,
        depth: usize,
    ) -> Result<StateService, PortError> {
        let service = kind.name();
        let states = self
            .node()
            .service_builder(&service_name(&service)?)
            .publish_subscribe::<[u8]>()
            .user_header::<Header>()
            .max_publishers(8)
            .max_subscribers(4)
            .max_nodes(super::MAX_NODES)
            .subscriber_max_buffer_size(depth)
            .history_size(1)
            .enable_safe_overflow(true)
            .create()
            .map_err(PortError::transport(&service, "create the service"))?;
        Ok(StateService(Box::new(states)))
    }

    /// Opens a state or hand-over service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_state_service(&self, kind: ServiceKind) -> Result<StateService, PortError> {
        Ok(StateService(Box::new(self.open_states(kind)?)))
    }

    fn open_states(&self, kind: ServiceKind) -> Result<States, PortError> {
        let service = kind.name();
        self.node()
            .service_builder(&service_name(&service)?)
            .publish_subscribe::<[u8]>()
            .user_header::<Header>()
            .open()
            .map_err(PortError::transport(&service, "open the service"))
    }
}

/// Writes states.
pub struct StatePublisher(Box<dyn StateSink>);

impl core::fmt::Debug for StatePublisher {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("StatePublisher").finish_non_exhaustive()
    }
}

impl StatePublisher {
    /// Opens the service for states of up to `capacity` bytes.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, kind: ServiceKind, capacity: usize) -> Result<Self, PortError> {
        let states = bus.open_states(kind)?;
        let publisher = bus.with_room(|| {
            states
                .publisher_builder()
                .max_loaned_samples(1)
                .initial_max_slice_len(capacity)
                .create()
                .map_err(|error| PortError::no_writer(&kind.name(), error))
        })?;
        Ok(Self(Box::new(publisher)))
    }
}

impl StateSink for Publisher<Ipc, [u8], Header> {
    fn send(&mut self, header: &Header, state: &[u8]) {
        // See `IpcSink::send`: a failure shows as a gap to the reader.
        in_transport(&mut || {
            if let Ok(mut slot) = self.loan_slice_uninit(state.len()) {
                *slot.user_header_mut() = *header;
                let _ = slot.write_from_slice(state).send();
            }
        });
    }

    fn serve_late_joiners(&mut self) {
        let _ = self.update_connections();
    }
}

impl StateSink for StatePublisher {
    fn send(&mut self, header: &Header, state: &[u8]) {
        self.0.send(header, state);
    }

    fn serve_late_joiners(&mut self) {
        self.0.serve_late_joiners();
    }
}

/// Reads states from processes that may write them.
pub struct StateSubscriber(Box<dyn StateSource>);

/// What is done with a state and the header of its step.
type Show<'a> = &'a mut dyn FnMut(&Header, &[u8]);

trait StateSource {
    /// Shows the next state, if one has arrived; false if none has.
    fn receive(&mut self, show: Show<'_>) -> bool;
}

struct GuardedStates {
    subscriber: Subscriber<Ipc, [u8], Header>,
    guard: Guard<Header>,
}

impl core::fmt::Debug for StateSubscriber {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("StateSubscriber").finish_non_exhaustive()
    }
}

impl StateSubscriber {
    /// Opens the states of a seat, as published by the process that sits there.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn of_seat(bus: &Bus, seat: Seat) -> Result<Self, PortError> {
        Self::open(bus, ServiceKind::State(seat), Accepts::states_of(seat))
    }

    /// Opens what the launcher hands to the process that takes a seat.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn handovers(bus: &Bus, seat: Seat) -> Result<Self, PortError> {
        Self::open(bus, ServiceKind::Handover(seat), Accepts::Launcher)
    }

    fn open(bus: &Bus, kind: ServiceKind, accepts: Accepts<Header>) -> Result<Self, PortError> {
        let guard = bus.guard(&kind.name(), accepts)?;
        let states = bus.open_states(kind)?;
        let subscriber = bus.with_room(|| {
            let subscriber = states.subscriber_builder().create();
            subscriber.map_err(|error| PortError::no_reader(&kind.name(), error))
        })?;
        Ok(Self(Box::new(GuardedStates { subscriber, guard })))
    }

    /// Shows the next state, if one has arrived; false if none has.
    pub fn receive(&mut self, mut show: impl FnMut(&Header, &[u8])) -> bool {
        self.0.receive(&mut show)
    }
}

impl StateSource for GuardedStates {
    fn receive(&mut self, show: Show<'_>) -> bool {
        while let Ok(Some(sample)) = self.subscriber.receive() {
            if self.guard.passes(sample.header().node_id(), sample.user_header()) {
                show(sample.user_header(), sample.payload());
                return true;
            }
        }
        false
    }
}
