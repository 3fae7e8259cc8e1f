//! The events that the slots take: hellos and deaths of processes, reports of consumers, and silence.

use super::facts::{command_latency_ns, millihertz};
use super::trip_reason::TripReason;
use super::watch::{Followed, Seen};
use super::{Expected, SlotContext, Slots};
use crate::{FlightError, PostEvent};
use shared_types::{Role, Seat as Place, Slot, Trip};
use slot::Seat;
use slot::gate::Refusal;
use slot::supervisor::{Event, Fault, Instance};

/// How long the monitor has for its next step, and its trip to arrive, before what a watched attitude controller says
/// against the position slot's owner counts \[ns\].
const CLAIM_NS: u64 = 50_000_000;
/// For how many of that controller's periods as well: the false reports after which it trips, and one before the first is
/// seen.
const FALSE_REPORTS: u64 = 4;

impl Slots {
    pub(super) fn take_event(
        &mut self,
        event: &PostEvent,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let place = event.place();
        let (Some(slot), Some(seat)) = (self.slot_of(place.role), Seat::new(place.index)) else {
            return Ok(());
        };
        if let Some(state) = self.states.get_mut(&slot) {
            state.expected.retain(|(expected, ..)| *expected != seat);
        }
        match event {
            PostEvent::Joined { layout, period_ns, .. } => {
                let instance = Instance {
                    layout: *layout,
                    millihertz: millihertz(context.graph, place.role, *period_ns),
                    latency_ns: command_latency_ns(context.graph, place.role),
                };
                self.feed(slot, Event::Ready(seat, instance), context)
            }
            PostEvent::Gone { .. } if context.is_over => Ok(()),
            PostEvent::Gone { exit_reason, .. } => {
                if let Some(exit_reason) = exit_reason {
                    self.lost(slot, seat, context);
                    self.add_news(exit_reason.clone(), true);
                    self.orders.explain(slot, seat, exit_reason);
                }
                self.feed(slot, Event::Died(seat), context)
            }
        }
    }

    pub(super) fn see(
        &mut self,
        seen: &Seen,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let role = match seen {
            Seen::Angle { at_ns, angle_rad } => return self.see_angle(*at_ns, *angle_rad, context),
            Seen::Trip(trip) => return self.see_trip(trip, context),
            Seen::Command(command) => command.slot,
            Seen::HasSetpoint { .. } => Role::Attitude,
            Seen::Follows { slot, .. }
            | Seen::Missed { slot, .. }
            | Seen::Unguided { slot, .. } => *slot,
        };
        let mut seen = *seen;
        if let Seen::Follows { slot: Role::Position, by_seat, followed } = &mut seen {
            *followed = self.consumers.take(*by_seat, *followed);
        }
        let Some(slot) = self.slot_of(role) else { return Ok(()) };
        if let Seen::Follows { followed, .. } = &seen {
            // A claim that was due before this instant counts, whatever follows.
            self.take_claim(followed.at_ns, context)?;
        }
        let decides = self.consumers.flying().or_else(|| self.owner_seat(Role::Attitude));
        let Some(state) = self.states.get_mut(&slot) else { return Ok(()) };
        match seen {
            Seen::Angle { .. } | Seen::Trip(_) => Ok(()),
            Seen::Command(command) => {
                let judged = state.gate.as_mut().map(|gate| gate.take(&command));
                self.refuse(slot, judged, context)
            }
            Seen::HasSetpoint { seat, at_ns, something } => {
                let judged =
                    state.gate.as_mut().map(|gate| gate.take_setpoint(seat, at_ns, something));
                self.refuse(slot, judged, context)
            }
            Seen::Missed { seat, steps, at_ns, .. } => {
                if let Some(gate) = &mut state.gate {
                    gate.missed(seat, steps, at_ns);
                }
                Ok(())
            }
            Seen::Follows { by_seat, .. } | Seen::Unguided { by_seat, .. }
                if role == Role::Position && decides != Some(by_seat) =>
            {
                Ok(())
            }
            Seen::Follows { followed, by_seat, .. } if role == Role::Position => {
                self.attitude_follows(slot, by_seat, followed, context)
            }
            Seen::Follows { followed, .. } => {
                self.consumer_follows(slot, &followed, context)?;
                let kept = self.consumers.take_plant(&followed);
                match (kept, self.slot_of(Role::Position)) {
                    (Some(kept), Some(slot)) => {
                        self.attitude_follows(slot, followed.seat, kept, context)
                    }
                    _ => Ok(()),
                }
            }
            Seen::Unguided { epoch, since_ns, at_ns, .. } => {
                self.feed(slot, Event::Unguided { epoch, since_ns, at_ns }, context)
            }
        }
    }

    fn see_trip(&mut self, trip: &Trip, context: &mut SlotContext<'_>) -> Result<(), FlightError> {
        self.take_claim(trip.header.release_ns, context)?;
        self.report_trip(trip);
        match trip.slot {
            // An attitude controller may have said so already.
            Role::Position => self.take_claim(u64::MAX, context),
            _ => Ok(()),
        }
    }

    /// The monitor has tripped an owner: why, and what follows.
    fn report_trip(&mut self, trip: &Trip) {
        let (Some(slot), Some(seat)) = (self.slot_of(trip.slot), Seat::new(trip.instance)) else {
            return;
        };
        let record = self.machines.get(&slot).and_then(slot::SlotMachine::record);
        // The consumer may have reported the change first, so that the newest record names the successor.
        let successor = record.and_then(|record| {
            if record.owner == seat { record.fallback } else { Some(record.owner) }
        });
        let then = match successor {
            Some(successor) => format!("{} is to take over", self.orders.name(slot, successor)),
            None => {
                "there is no fallback: the vehicle is held without one, and the initial controller started"
                    .to_owned()
            }
        };
        let at_s = trip.header.valid_ns as f64 * 1e-9;
        let name = self.orders.name(slot, seat);
        let text = format!(
            "{} slot: the monitor trips {name} at {at_s:.3} s: {}; {then}",
            slot.label(),
            TripReason(trip)
        );
        self.orders.explain(slot, seat, &TripReason(trip).to_string());
        if let Some(state) = self.states.get_mut(&slot) {
            state.tripped_owner = Some((seat, trip.epoch));
        }
        self.add_news(text, true);
    }

    /// The seat of an owner that the monitor has tripped by the newest record, so that no successor is known yet.
    pub(super) fn unconfirmed_trip(&self, slot: Slot) -> Option<Seat> {
        let record = self.machines.get(&slot)?.record()?;
        let tripped = self.states.get(&slot)?.tripped_owner;
        tripped.filter(|it| *it == (record.owner, record.epoch)).map(|(seat, _)| seat)
    }

    fn see_angle(
        &mut self,
        at_ns: u64,
        angle_rad: f64,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        for slot in Slot::ALL {
            let gate = self.states.get_mut(&slot).and_then(|state| state.gate.as_mut());
            let judged = gate.map(|gate| gate.morphs(at_ns, angle_rad));
            self.refuse(slot, judged, context)?;
        }
        Ok(())
    }

    /// Passes on that a candidate did what no controller may do.
    fn refuse(
        &mut self,
        slot: Slot,
        judged: Option<Result<(), Refusal>>,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let candidate = self.machines.get(&slot).and_then(slot::SlotMachine::candidate);
        match (judged, candidate) {
            (Some(Err(refusal)), Some(seat)) => {
                self.feed(slot, Event::Verdict(seat, Err(refusal)), context)
            }
            _ => Ok(()),
        }
    }

    /// The attitude controller that flies reports which seat of the position slot it follows. What one that is watched
    /// says against the owner counts at once if the monitor has said the same, else only after the monitor has had time to
    /// find it false.
    fn attitude_follows(
        &mut self,
        slot: Slot,
        by_seat: u32,
        followed: Followed,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let newest = |slot: Slot| self.machines.get(&slot).and_then(slot::SlotMachine::record);
        let watched = newest(Slot::Attitude).filter(|r| r.watched && u32::from(r.owner) == by_seat);
        let (Some(attitude), Some(position)) = (watched, newest(slot)) else {
            return self.consumer_follows(slot, &followed, context);
        };
        if followed.epoch > position.epoch {
            // No record of it has been written.
            return Ok(());
        }
        let tripped = self.states.get(&slot).and_then(|state| state.tripped_owner);
        if tripped == Some((position.owner, followed.epoch)) {
            return self.consumer_follows(slot, &followed, context);
        }
        let period_ns = attitude.period_ns[attitude.owner.index()];
        let within_ns = CLAIM_NS.saturating_add(period_ns.saturating_mul(FALSE_REPORTS));
        let due_ns = followed.at_ns.saturating_add(within_ns);
        let followed = self.consumers.keep_claim(by_seat, followed, due_ns);
        self.consumer_follows(slot, &followed, context)
    }

    /// What an attitude controller has said against the position slot's owner counts if it was due by `until_ns`, and the
    /// controller has not tripped before.
    pub(super) fn take_claim(
        &mut self,
        until_ns: u64,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let Some(slot) = self.slot_of(Role::Position) else { return Ok(()) };
        let Some((by_seat, followed)) = self.consumers.take_due(until_ns) else { return Ok(()) };
        let commands = self.owner_seat(Role::Attitude) == Some(by_seat);
        if commands && self.unconfirmed_trip(Slot::Attitude).is_none() {
            return self.consumer_follows(slot, &followed, context);
        }
        Ok(())
    }

    fn consumer_follows(
        &mut self,
        slot: Slot,
        followed: &Followed,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let Followed { at_ns, epoch, seat, failed_over, tripped, refused_epoch } = *followed;
        let Some(state) = self.states.get_mut(&slot) else { return Ok(()) };
        let mut events = Vec::new();
        if refused_epoch > state.refused_epoch {
            state.refused_epoch = refused_epoch;
            events.push(Event::RecordRefused { epoch: refused_epoch });
        }
        if let Some(seat) = Seat::new(seat).filter(|_| epoch > state.acknowledged) {
            state.acknowledged = epoch;
            events.push(Event::Acknowledged { epoch, seat, at_ns });
        }
        if tripped && epoch > state.tripped {
            state.tripped = epoch;
            events.push(Event::Tripped { epoch, at_ns });
        }
        if failed_over && epoch > state.failed_over {
            state.failed_over = epoch;
            events.push(Event::FailedOver { epoch, at_ns });
        }
        events.into_iter().try_for_each(|event| self.feed(slot, event, context))
    }

    /// A process that takes too long to come or to go is dealt with.
    pub(super) fn check_timeouts(
        &mut self,
        slot: Slot,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let now_mono_ns = context.now_mono_ns;
        let late = |(_, _, by_ns): &(Seat, Expected, u64)| *by_ns < now_mono_ns;
        while let Some(state) = self.states.get_mut(&slot)
            && let Some(at) = state.expected.iter().position(late)
        {
            let (seat, what, _) = state.expected.swap_remove(at);
            let fault = if what == Expected::Hello { Fault::NeverReady } else { Fault::Stalled };
            let place = Place { role: slot.role(), index: seat.into() };
            let stderr = context.posts.stderr_so_far(place);
            if !stderr.is_empty() {
                let name = self.orders.name(slot, seat);
                self.orders.explain(slot, seat, &format!("{name} is killed{stderr}"));
            }
            self.feed(slot, Event::Misbehaved(seat, fault), context)?;
        }
        Ok(())
    }
}
