//! The last trip of a slot's owner: whether it still counts, and whether it has to be published again.

use shared_types::{NO_SEAT, OwnerRecord, Trip};

use crate::blame::Watched;

/// For how long after a trip or a fail-over the vehicle's place and tilt are taken for the doing of the owner that was
/// replaced \[ns\].
const RECOVERY_NS: u64 = 2_000_000_000;

/// Whether it is still the doing of an owner that was replaced at `from_ns`, 0 for never.
pub(crate) fn is_recovering(from_ns: u64, now_ns: u64) -> bool {
    from_ns > 0 && now_ns < from_ns.saturating_add(RECOVERY_NS)
}

shared_types::memory! {
    /// The last trip of one slot.
    #[derive(PartialEq)]
    pub struct LastTrip {
        /// The trip, of epoch 0 for none; its instance is [`NO_SEAT`] once another owner commands.
        pub trip: Trip,
        /// When it was published \[ns\].
        pub at_ns: u64,
        /// Seat of the fallback then, [`NO_SEAT`] for none.
        pub fallback: u32,
    }
}

impl LastTrip {
    /// Whether the owner by a record, with this fallback, has tripped: under it, or under an earlier one that named the
    /// same two, since such a record undoes no trip.
    pub(crate) fn holds(&mut self, record: &OwnerRecord, fallback: u32, now_ns: u64) -> bool {
        if record.owner != self.trip.instance {
            self.trip.instance = NO_SEAT;
        }
        let is_kept = record.owner == self.trip.instance
            && fallback != NO_SEAT
            && fallback == self.fallback
            && self.is_recent(now_ns);
        self.trip.epoch > 0 && (self.trip.epoch == record.epoch || is_kept)
    }

    /// The trip once more, if a record names its owner again that was written before the trip was known: the consumers
    /// take the owner for one that may have been started again.
    pub(crate) fn again(&self, owner: &Watched, now_ns: u64) -> Option<Trip> {
        let is_named_again = self.trip.instance == owner.instance
            && (1..owner.epoch).contains(&self.trip.epoch)
            && self.is_recent(now_ns);
        is_named_again.then_some(Trip { epoch: owner.epoch, ..self.trip })
    }

    fn is_recent(&self, now_ns: u64) -> bool {
        now_ns < self.at_ns.saturating_add(RECOVERY_NS)
    }
}
