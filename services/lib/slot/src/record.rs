//! The owner record, and what it makes of each writer.

use shared_types::{Flag, Header, NO_SEAT, OwnerRecord, Role};

pub use shared_types::SEATS;

/// A seat of a slot. The transport lets only its holder publish for a seat, so it also identifies which process
/// wrote a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Seat(u8);

impl Seat {
    /// Every seat.
    pub const ALL: [Self; SEATS] = [Self(0), Self(1), Self(2), Self(3)];

    /// The seat with this index; `None` from [`SEATS`] on.
    #[must_use]
    pub fn new(index: u32) -> Option<Self> {
        Self::ALL.get(usize::try_from(index).ok()?).copied()
    }

    /// Index, 0 to [`SEATS`] - 1.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl From<Seat> for u8 {
    fn from(seat: Seat) -> Self {
        seat.0
    }
}

impl From<Seat> for u32 {
    fn from(seat: Seat) -> Self {
        Self::from(seat.0)
    }
}

impl core::fmt::Display for Seat {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "seat {}", self.0)
    }
}

/// Which seats may command a slot from an instant on. Epochs only grow; only the supervisor writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Record {
    /// Counted from 1.
    pub epoch: u64,
    /// Seat whose commands count.
    pub owner: Seat,
    /// Seat that takes over when the owner falls silent.
    pub fallback: Option<Seat>,
    /// Logical instant T from which the record counts, for commands effective at T or later \[ns\].
    pub effective_ns: u64,
    /// Control period of the process that sits there, by seat \[ns\]; 0 where none does.
    pub period_ns: [u64; SEATS],
    /// The new owner is a controller of another kind than the one before it.
    pub kind_changed: bool,
    /// The owner has not proven itself: the monitor judges it.
    pub watched: bool,
}

/// What a record means for a writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Authority {
    /// Its commands count.
    Owner,
    /// Its commands count once the consumer has failed over.
    Fallback,
    /// It may publish, but is not followed: a shadow, or one that is leaving.
    Member,
    /// It has no seat here: to be counted and named.
    Stray,
}

impl Record {
    /// True if a process sits on `seat`.
    #[must_use]
    pub fn is_taken(&self, seat: Seat) -> bool {
        self.period_ns[seat.index()] > 0
    }

    /// Authority of `seat`'s writer under this record.
    #[must_use]
    pub fn authority(&self, seat: Seat) -> Authority {
        if !self.is_taken(seat) {
            Authority::Stray
        } else if seat == self.owner {
            Authority::Owner
        } else if Some(seat) == self.fallback {
            Authority::Fallback
        } else {
            Authority::Member
        }
    }

    /// True if the same two writers would be followed, in the same order.
    #[must_use]
    pub fn same_hands(&self, other: &Self) -> bool {
        let hands = |record: &Self| {
            let fallback = record.fallback.filter(|seat| record.is_taken(*seat));
            (record.is_taken(record.owner).then_some(record.owner), fallback)
        };
        hands(self) == hands(other)
    }
}

impl Record {
    /// The record that a sample carries; `None` if it names an owner's seat that no slot has.
    #[must_use]
    pub fn read(sample: &OwnerRecord) -> Option<Self> {
        Some(Self {
            epoch: sample.epoch,
            owner: Seat::new(sample.owner)?,
            fallback: Seat::new(sample.fallback),
            effective_ns: sample.header.valid_ns,
            period_ns: sample.period_ns,
            kind_changed: sample.kind_changed.is_set(),
            watched: sample.watched.is_set(),
        })
    }

    /// As a sample about `slot`.
    #[must_use]
    pub fn to_sample(&self, slot: Role) -> OwnerRecord {
        OwnerRecord {
            header: Header {
                sequence: self.epoch,
                release_ns: self.effective_ns,
                valid_ns: self.effective_ns,
                ..Header::default()
            },
            epoch: self.epoch,
            period_ns: self.period_ns,
            owner: self.owner.into(),
            fallback: self.fallback.map_or(NO_SEAT, u32::from),
            slot,
            kind_changed: Flag::from(self.kind_changed),
            watched: Flag::from(self.watched),
            reserved: 0,
        }
    }
}

shared_types::memory! {
    /// A [`Record`] as plain numbers; epoch 0 for none.
    #[derive(PartialEq)]
    pub struct RecordMemory {
        /// Epoch.
        pub epoch: u64,
        /// Instant from which it counts \[ns\].
        pub effective_ns: u64,
        /// Control periods \[ns\]; 0 where no process sits.
        pub period_ns: [u64; SEATS],
        /// Owner's seat.
        pub owner: u8,
        /// Fallback's seat, or a number that is no seat.
        pub fallback: u8,
        /// Whether the owner is of another kind than before.
        pub kind_changed: bool,
        /// Whether the monitor judges the owner.
        pub watched: bool,
    }
}

impl From<Option<Record>> for RecordMemory {
    fn from(record: Option<Record>) -> Self {
        record.map_or_else(Self::default, |record| Self {
            epoch: record.epoch,
            effective_ns: record.effective_ns,
            period_ns: record.period_ns,
            owner: record.owner.0,
            fallback: record.fallback.map_or(u8::MAX, |seat| seat.0),
            kind_changed: record.kind_changed,
            watched: record.watched,
        })
    }
}

impl From<RecordMemory> for Option<Record> {
    fn from(memory: RecordMemory) -> Self {
        // A damaged memory names no seat, and then there is no record.
        let owner = Seat::new(memory.owner.into()).filter(|_| memory.epoch > 0)?;
        Some(Record {
            epoch: memory.epoch,
            owner,
            fallback: Seat::new(memory.fallback.into()),
            effective_ns: memory.effective_ns,
            period_ns: memory.period_ns,
            kind_changed: memory.kind_changed,
            watched: memory.watched,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> Record {
        Record {
            epoch: 3,
            owner: Seat(1),
            fallback: Some(Seat(0)),
            effective_ns: 7,
            period_ns: [10, 10, 20, 0],
            kind_changed: true,
            watched: true,
        }
    }

    #[test]
    fn standing_follows_from_the_seat_and_nothing_else() {
        let record = record();
        let authorities = Seat::ALL.map(|seat| record.authority(seat));
        let expected = [Authority::Fallback, Authority::Owner, Authority::Member, Authority::Stray];
        assert_eq!(authorities, expected, "an empty seat has no member");
        let gone = Record { period_ns: [10, 0, 20, 0], ..record };
        assert_eq!(gone.authority(Seat(1)), Authority::Stray, "named or not");
    }

    #[test]
    fn an_owner_that_falls_back_on_itself_is_just_the_owner() {
        let record = Record { fallback: Some(Seat(1)), ..record() };
        assert_eq!(record.authority(Seat(1)), Authority::Owner);
    }

    #[test]
    fn same_owner_and_fallback_are_the_same_hands_whichever_others_sit_there() {
        let joined = Record { epoch: 4, period_ns: [10, 10, 20, 30], ..record() };
        assert!(record().same_hands(&joined));
        let empty = Record { period_ns: [0, 10, 20, 0], ..record() };
        assert!(empty.same_hands(&Record { fallback: None, ..empty }), "a fallback that is gone");
        assert!(!record().same_hands(&Record { owner: Seat(0), ..record() }));
        assert!(!record().same_hands(&Record { fallback: None, ..record() }));
    }

    #[test]
    fn a_record_survives_its_plain_form_and_a_damaged_one_is_none() {
        let back = |memory: RecordMemory| Option::<Record>::from(memory);
        assert_eq!(back(Some(record()).into()), Some(record()));
        assert_eq!(back(None.into()), None);
        let damaged = RecordMemory { owner: 9, ..Some(record()).into() };
        assert_eq!(back(damaged), None);
    }

    #[test]
    fn a_record_survives_being_a_sample_and_one_of_a_seat_that_no_slot_has_is_none() {
        let sample = record().to_sample(Role::Attitude);
        assert_eq!(Record::read(&sample), Some(record()));
        assert_eq!(Record::read(&OwnerRecord { owner: 4, ..sample }), None);
    }

    #[test]
    fn there_are_exactly_as_many_seats_as_indices() {
        assert_eq!(Seat::new(3), Some(Seat(3)));
        assert_eq!(Seat::new(4), None);
        assert_eq!(Seat::ALL.map(Seat::index), [0, 1, 2, 3]);
    }
}
