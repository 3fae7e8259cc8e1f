//! Every service of a run, held by its launcher for as long as that lives.

use runtime::ipc::{Bus, HANDOVER_DEPTH, PortError, STATE_DEPTH, ServiceKind, WakeNotifier};
use shared_types::ZeroCopySend;
use shared_types::wire::Wire;
use shared_types::{
    ClockRecord, Hello, Progress, Role, Roll, Sample, Seat, Topic, TopicVisitor, topics,
};
use std::any::Any;

/// Keeps the services alive; children only open what is held here.
pub(super) struct HeldServices {
    _factories: Vec<Box<dyn Any>>,
}

/// Makes services, or finds those of a launcher that has died.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Create,
    Open,
}

struct Holder<'a> {
    bus: &'a Bus,
    way: Way,
    factories: Vec<Box<dyn Any>>,
}

impl TopicVisitor for Holder<'_> {
    type Error = PortError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), PortError> {
        let factory = match self.way {
            Way::Create => self.bus.create_topic(topic)?,
            Way::Open => self.bus.open_topic(topic)?,
        };
        self.factories.push(Box::new(factory));
        Ok(())
    }
}

impl Holder<'_> {
    fn service<T: Wire + ZeroCopySend + 'static>(
        &mut self,
        kind: ServiceKind,
        capacity: usize,
    ) -> Result<(), PortError> {
        let factory = match self.way {
            Way::Create => self.bus.create_service::<T>(kind, capacity)?,
            Way::Open => self.bus.open_service::<T>(kind)?,
        };
        self.factories.push(Box::new(factory));
        Ok(())
    }

    fn states(&mut self, kind: ServiceKind, depth: usize) -> Result<(), PortError> {
        let factory = match self.way {
            Way::Create => self.bus.create_state_service(kind, depth)?,
            Way::Open => self.bus.open_state_service(kind)?,
        };
        self.factories.push(Box::new(factory));
        Ok(())
    }
}

impl HeldServices {
    /// Creates the topics of the floor plan and the services beside them.
    pub(super) fn create(bus: &Bus) -> Result<Self, PortError> {
        for seat in Role::STEPPING.into_iter().flat_map(Seat::all) {
            bus.create_wake(seat)?;
        }
        Self::hold(bus, Way::Create)
    }

    /// Holds what a launcher has left that has died. Without anybody who holds them, services would
    /// vanish with what it left behind; so this comes before the dead are swept.
    pub(super) fn take_over(bus: &Bus) -> Result<Self, PortError> {
        Self::hold(bus, Way::Open)
    }

    fn hold(bus: &Bus, way: Way) -> Result<Self, PortError> {
        let mut holder = Holder { bus, way, factories: Vec::new() };
        topics::visit_all(&mut holder)?;
        for seat in Role::STEPPING.into_iter().flat_map(Seat::all) {
            holder.service::<Progress>(ServiceKind::Progress(seat), 4)?;
            holder.states(ServiceKind::State(seat), STATE_DEPTH)?;
            holder.states(ServiceKind::Handover(seat), HANDOVER_DEPTH)?;
        }
        holder.service::<Roll>(ServiceKind::Roll, 2)?;
        holder.service::<ClockRecord>(ServiceKind::Clock, 4)?;
        holder.service::<Hello>(ServiceKind::Hello, 64)?;
        Ok(Self { _factories: holder.factories })
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
