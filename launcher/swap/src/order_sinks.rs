//! Where orders to pilot and injector go out.

use runtime::Sink as _;
use runtime::ipc::{Bus, IpcSink, PortError};
use scenario::orders::Sent;
use shared_types::{DisturbanceOrder, GuidanceOrder, topics};

/// Sends orders to pilot and injector, and keeps the last one of each.
#[derive(Debug)]
pub struct OrderSinks {
    guidance: IpcSink<GuidanceOrder>,
    disturbance: IpcSink<DisturbanceOrder>,
    last: (GuidanceOrder, DisturbanceOrder),
}

impl OrderSinks {
    /// Opens the topics of the orders.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn open(bus: &Bus) -> Result<Self, PortError> {
        Ok(Self {
            guidance: bus.writer(&topics::GUIDANCE_ORDER)?,
            disturbance: bus.writer(&topics::DISTURBANCE_ORDER)?,
            last: (GuidanceOrder::default(), DisturbanceOrder::default()),
        })
    }

    /// What has been ordered last; sequence 0 if nothing has.
    #[must_use]
    pub fn last(&self) -> (&GuidanceOrder, &DisturbanceOrder) {
        (&self.last.0, &self.last.1)
    }

    /// Remembers an order that is to be sent, so that it can be noted before any process receives it.
    pub fn take(&mut self, sent: &Sent) {
        match sent {
            Sent::Guidance(order) => self.last.0 = *order,
            Sent::Disturbance(order) => self.last.1 = *order,
        }
    }

    /// Sends it.
    pub fn send(&mut self, sent: &Sent) {
        match sent {
            Sent::Guidance(order) => self.guidance.send(order),
            Sent::Disturbance(order) => self.disturbance.send(order),
        }
    }

    /// Sends again what another launcher had sent last: it went with that one.
    pub fn go_on(&mut self, guidance: &GuidanceOrder, disturbance: &DisturbanceOrder) {
        self.last = (*guidance, *disturbance);
        if guidance.header.sequence > 0 {
            self.guidance.send(guidance);
        }
        if disturbance.header.sequence > 0 {
            self.disturbance.send(disturbance);
        }
    }

    /// Sends the last orders to readers that have joined since.
    pub fn serve_late_joiners(&mut self) {
        self.guidance.serve_late_joiners();
        self.disturbance.serve_late_joiners();
    }
}
