//! Published states: samples of the header of a step and then the packed bytes of the state.

use super::payload::{Reader, Service, Writer, sample};
use super::registry::{Accepts, Guard};
use super::{Bus, Crowd, PortError, ServiceKind};
use crate::executor::StateSink;
use crate::upkeep::in_transport;
use shared_types::wire::Wire as _;
use shared_types::{Header, Seat};

/// A state or hand-over service, which is there for as long as it is held.
pub struct StateService(#[expect(dead_code, reason = "held until it is dropped")] Box<dyn Service>);

impl core::fmt::Debug for StateService {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("StateService").finish_non_exhaustive()
    }
}

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
        self.create(&kind.name(), &Header::SCHEMA, (depth, 1), Crowd::STATES).map(StateService)
    }

    /// Opens a state or hand-over service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open_state_service(&self, kind: ServiceKind) -> Result<StateService, PortError> {
        self.open(&kind.name(), &Header::SCHEMA).map(StateService)
    }
}

/// Writes states.
pub struct StatePublisher {
    writer: Box<dyn Writer>,
    /// The sample that is sent next.
    sample: Vec<u8>,
}

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
        let size = size_of::<Header>() + capacity;
        let writer = bus.writer_on(&kind.name(), &Header::SCHEMA, size)?;
        Ok(Self { writer, sample: Vec::with_capacity(size) })
    }
}

impl StateSink for StatePublisher {
    fn send(&mut self, header: &Header, state: &[u8]) {
        self.sample.clear();
        self.sample.extend_from_slice(bytemuck::bytes_of(header));
        self.sample.extend_from_slice(state);
        // See `IpcSink::send`: a failure shows as a gap to the reader.
        in_transport(&mut || {
            self.writer.try_send(&self.sample);
        });
    }

    fn serve_late_joiners(&mut self) {
        self.writer.serve_late_joiners();
    }
}

/// Reads states from processes that may write them.
pub struct StateSubscriber {
    reader: Box<dyn Reader>,
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
        let (service, schema) = (kind.name(), &Header::SCHEMA);
        let guard = bus.guard(&service, accepts)?;
        Ok(Self { reader: bus.reader_on(&service, schema, None)?, guard })
    }

    /// Shows the next state, if one has arrived; false if none has.
    pub fn receive(&mut self, mut show: impl FnMut(&Header, &[u8])) -> bool {
        loop {
            let mut shown = false;
            let any = self.reader.show_next(&mut |node, bytes| {
                let split = bytes.split_at_checked(size_of::<Header>());
                let header = split.and_then(|(header, _)| sample(header));
                if let (Some(header), Some((_, state))) = (self.guard.accepted(node, header), split)
                {
                    show(header, state);
                    shown = true;
                }
            });
            if shown || !any {
                return shown;
            }
        }
    }
}
