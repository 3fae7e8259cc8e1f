//! What the slots hear: hellos and deaths of processes, what consumers say, and silence.

use super::facts::{command_latency_ns, millihertz};
use super::watch::{Obeyed, Seen};
use super::{Expected, Means, Slots};
use crate::candidate::Slot;
use crate::run::supervisor::{FlightError, PostEvent};
use shared_types::Role;
use slot::Seat;
use slot::gate::Refusal;
use slot::supervisor::{Event, Fault, Instance};

impl Slots {
    pub(super) fn hear(
        &mut self,
        event: &PostEvent,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let place = event.place();
        let (Some(slot), Some(seat)) = (self.slot_of(place.role), Seat::new(place.index)) else {
            return Ok(());
        };
        if let Some(around) = self.around.get_mut(&slot) {
            around.expected.retain(|(expected, ..)| *expected != seat);
        }
        match event {
            PostEvent::Joined { layout, period_ns, .. } => {
                let instance = Instance {
                    layout: *layout,
                    millihertz: millihertz(means.graph, place.role, *period_ns),
                    latency_ns: command_latency_ns(means.graph, place.role),
                };
                self.tell(slot, Event::Ready(seat, instance), means)
            }
            PostEvent::Gone { .. } if means.is_over => Ok(()),
            PostEvent::Gone { obituary, .. } => {
                if let Some(obituary) = obituary {
                    self.lost(slot, seat, means);
                    self.say(obituary.clone(), true);
                }
                self.tell(slot, Event::Died(seat), means)
            }
        }
    }

    pub(super) fn see(&mut self, seen: &Seen, means: &mut Means<'_>) -> Result<(), FlightError> {
        let role = match seen {
            Seen::Angle { at_ns, angle_rad } => return self.see_angle(*at_ns, *angle_rad, means),
            Seen::Command(command) => command.slot,
            Seen::Hears { .. } => Role::Attitude,
            Seen::Obeys { slot, .. } | Seen::Missed { slot, .. } | Seen::Unguided { slot, .. } => {
                *slot
            }
        };
        let Some(slot) = self.slot_of(role) else { return Ok(()) };
        let Some(around) = self.around.get_mut(&slot) else { return Ok(()) };
        match *seen {
            Seen::Angle { .. } => Ok(()),
            Seen::Command(command) => {
                let judged = around.gate.as_mut().map(|gate| gate.take(&command));
                self.refuse(slot, judged, means)
            }
            Seen::Hears { seat, at_ns, something } => {
                let judged = around.gate.as_mut().map(|gate| gate.hears(seat, at_ns, something));
                self.refuse(slot, judged, means)
            }
            Seen::Missed { seat, steps, at_ns, .. } => {
                if let Some(gate) = &mut around.gate {
                    gate.missed(seat, steps, at_ns);
                }
                Ok(())
            }
            // Of several attitude controllers the one that commands decides whom it obeys.
            Seen::Obeys { by_seat, .. } | Seen::Unguided { by_seat, .. }
                if role == Role::Position && self.owner_seat(Role::Attitude) != Some(by_seat) =>
            {
                Ok(())
            }
            Seen::Obeys { obeyed, .. } => self.consumer_says(slot, &obeyed, means),
            Seen::Unguided { epoch, since_ns, at_ns, .. } => {
                self.tell(slot, Event::Unguided { epoch, since_ns, at_ns }, means)
            }
        }
    }

    fn see_angle(
        &mut self,
        at_ns: u64,
        angle_rad: f64,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        for slot in Slot::ALL {
            let gate = self.around.get_mut(&slot).and_then(|around| around.gate.as_mut());
            let judged = gate.map(|gate| gate.morphs(at_ns, angle_rad));
            self.refuse(slot, judged, means)?;
        }
        Ok(())
    }

    /// Passes on that a candidate did what no controller may do.
    fn refuse(
        &mut self,
        slot: Slot,
        judged: Option<Result<(), Refusal>>,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let candidate = self.machines.get(&slot).and_then(slot::Slot::candidate);
        match (judged, candidate) {
            (Some(Err(refusal)), Some(seat)) => {
                self.tell(slot, Event::Verdict(seat, Err(refusal)), means)
            }
            _ => Ok(()),
        }
    }

    fn consumer_says(
        &mut self,
        slot: Slot,
        obeyed: &Obeyed,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let Obeyed { at_ns, epoch, seat, failed_over, refused_epoch } = *obeyed;
        let Some(around) = self.around.get_mut(&slot) else { return Ok(()) };
        let mut events = Vec::new();
        if refused_epoch > around.refused_epoch {
            around.refused_epoch = refused_epoch;
            events.push(Event::RecordRefused { epoch: refused_epoch });
        }
        if let Some(seat) = Seat::new(seat).filter(|_| epoch > around.acknowledged) {
            around.acknowledged = epoch;
            events.push(Event::Acknowledged { epoch, seat, at_ns });
        }
        if failed_over && epoch > around.fell_over {
            around.fell_over = epoch;
            events.push(Event::FellOver { epoch, at_ns });
        }
        events.into_iter().try_for_each(|event| self.tell(slot, event, means))
    }

    /// Whoever takes too long to come or to go is dealt with.
    pub(super) fn lose_patience(
        &mut self,
        slot: Slot,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let now_mono_ns = means.now_mono_ns;
        let late = |(_, _, by_ns): &(Seat, Expected, u64)| *by_ns < now_mono_ns;
        while let Some(around) = self.around.get_mut(&slot)
            && let Some(at) = around.expected.iter().position(late)
        {
            let (seat, what, _) = around.expected.swap_remove(at);
            let fault = if what == Expected::Hello { Fault::NeverReady } else { Fault::Stalled };
            self.tell(slot, Event::Misbehaved(seat, fault), means)?;
        }
        Ok(())
    }
}
