//! What the recording keeps of which process sits where, so that every life of a process can be flown again.

use super::{Executable, SlotContext, Slots};
use runtime::StateHeader;
use runtime::life_number;
use scenario::candidate::Candidate;
use shared_types::{Flag, Handover, Header, Seat as Place, Seating, SeatingKind, Slot};
use slot::Seat;

/// How a process begins that goes on from a state, if there is one, of the process on a seat.
pub(super) fn joined(
    order: &Handover,
    state: Option<(Place, &(u32, Vec<u8>))>,
    join_ns: u64,
) -> Seating {
    let Handover { track_until_ns, has_state, catches_up, .. } = *order;
    let mut seating = Seating {
        header: Header { release_ns: join_ns, ..Header::default() },
        kind: SeatingKind::Joined,
        join_ns: order.join_ns,
        track_until_ns,
        has_state,
        catches_up,
        ..Seating::default()
    };
    if let Some((from, (generation, bytes))) = state {
        let head = StateHeader::of(bytes);
        seating.state_release = head.map_or(0, |head| head.release_index);
        seating.state_seat = from.index;
        seating.state_generation = *generation;
    }
    seating
}

impl Slots {
    /// Completes a seating and has it recorded.
    pub(super) fn record_seating(
        &self,
        slot: Slot,
        seat: Seat,
        seating: Seating,
        context: &mut SlotContext<'_>,
    ) {
        let place = Place { role: slot.role(), index: seat.into() };
        let Some(generation) = context.posts.generation(place) else { return };
        let executable = self.orders.seated_on(slot, seat);
        let built_in = executable.is_some_and(|e| matches!(e.candidate, Candidate::Service(_)));
        let name = executable.map_or("", |executable| executable.candidate.name());
        let config = executable.and_then(|Executable { config, .. }| config.clone());
        let config = config.filter(|_| seating.kind == SeatingKind::Joined);
        let complete = Seating {
            header: Header {
                sequence: u64::from(seating.kind.0) + 1,
                valid_ns: seating.header.release_ns,
                publish_mono_ns: context.now_mono_ns,
                seat: life_number(place, generation),
                generation,
                ..seating.header
            },
            controller: Seating::controller_from(name),
            role: place.role,
            seat: place.index,
            generation,
            built_in: Flag::from(built_in),
            configured: Flag::from(config.is_some()),
            ..seating
        };
        context.posts.record_seating(&complete, config.as_deref());
    }

    /// No process waits any more for the one that sits there, which did not leave in order.
    pub(super) fn lost(&self, slot: Slot, seat: Seat, context: &mut SlotContext<'_>) {
        let release_ns = context.now.logical_ns;
        let header = Header { release_ns, ..Header::default() };
        let seating = Seating { header, kind: SeatingKind::Lost, ..Seating::default() };
        self.record_seating(slot, seat, seating, context);
    }

    /// As [`lost`](Self::lost), of a process that is killed on purpose.
    pub(super) fn killed(&self, place: Place, context: &mut SlotContext<'_>) {
        if let (Some(slot), Some(seat)) = (self.slot_of(place.role), Seat::new(place.index)) {
            self.lost(slot, seat, context);
        }
    }
}
