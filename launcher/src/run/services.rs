//! Every service of a run, created and held by the launcher for as long as it lives.

use runtime::ipc::{Bus, HANDOVER_DEPTH, PortError, STATE_DEPTH, ServiceKind, WakeNotifier};
use shared_types::{
    ClockRecord, Hello, Progress, Role, Roll, Sample, Seat, Topic, TopicVisitor, topics,
};
use std::any::Any;

/// Keeps the services alive; children only open what is held here.
pub(super) struct HeldServices {
    _factories: Vec<Box<dyn Any>>,
}

struct Creator<'a> {
    bus: &'a Bus,
    factories: Vec<Box<dyn Any>>,
}

impl TopicVisitor for Creator<'_> {
    type Error = PortError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), PortError> {
        self.factories.push(Box::new(self.bus.create_topic(topic)?));
        Ok(())
    }
}

impl HeldServices {
    /// Creates the topics of the floor plan and the services beside them.
    pub(super) fn create(bus: &Bus) -> Result<Self, PortError> {
        let mut creator = Creator { bus, factories: Vec::new() };
        topics::visit_all(&mut creator)?;
        let mut factories = creator.factories;
        for seat in Role::STEPPING.into_iter().flat_map(Seat::all) {
            let progress = bus.create_service::<Progress>(ServiceKind::Progress(seat), 4)?;
            factories.push(Box::new(progress));
            bus.create_wake(seat)?;
            factories
                .push(Box::new(bus.create_state_service(ServiceKind::State(seat), STATE_DEPTH)?));
            let handover = bus.create_state_service(ServiceKind::Handover(seat), HANDOVER_DEPTH)?;
            factories.push(Box::new(handover));
        }
        factories.push(Box::new(bus.create_service::<Roll>(ServiceKind::Roll, 2)?));
        factories.push(Box::new(bus.create_service::<ClockRecord>(ServiceKind::Clock, 4)?));
        factories.push(Box::new(bus.create_service::<Hello>(ServiceKind::Hello, 64)?));
        Ok(Self { _factories: factories })
    }
}

/// Wakes whoever sits anywhere.
pub(super) struct Wakers {
    wakers: Vec<WakeNotifier>,
}

impl Wakers {
    pub(super) fn open(bus: &Bus, roles: &[Role]) -> Result<Self, PortError> {
        let seats = roles.iter().flat_map(|&role| Seat::all(role));
        let wakers = seats.map(|seat| WakeNotifier::open(bus, seat)).collect::<Result<_, _>>()?;
        Ok(Self { wakers })
    }

    pub(super) fn wake_all(&self) {
        for waker in &self.wakers {
            waker.wake();
        }
    }
}
