//! The owner record, and what it makes of each writer.

use shared_types::{Flag, Header, NO_SEAT, OwnerRecord, Role};

pub use shared_types::SEATS;

/// A writer as the transport tells: whoever sits on a seat, see [`author_on`].
pub type Author = [u64; 2];

/// Author of a seat on which nobody sits.
pub const NO_AUTHOR: Author = [0; 2];

/// A seat of a slot.
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

/// Who may command a slot from an instant on. Epochs only grow; only the supervisor writes.
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
    /// Who sits where, as the transport tells; [`NO_AUTHOR`] where nobody does.
    pub members: [Author; SEATS],
    /// Control period of each member \[ns\]; 0 where nobody sits.
    pub period_ns: [u64; SEATS],
    /// The new owner is a controller of another kind than the one before it.
    pub kind_changed: bool,
}

/// What a record says about a writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Standing {
    /// Its commands count.
    Owner,
    /// Its commands count once the consumer has failed over.
    Fallback,
    /// It may publish, but nobody obeys: a shadow, or one that is leaving.
    Member,
    /// It has no seat here: to be counted and named.
    Stray,
}

impl Record {
    /// Who sits on `seat`.
    #[must_use]
    pub fn author(&self, seat: Seat) -> Option<Author> {
        Some(self.members[seat.index()]).filter(|author| *author != NO_AUTHOR)
    }

    /// Where `author` sits.
    #[must_use]
    pub fn seat(&self, author: Author) -> Option<Seat> {
        Seat::ALL.into_iter().find(|seat| self.author(*seat) == Some(author))
    }

    /// Standing of `author` under this record.
    #[must_use]
    pub fn standing(&self, author: Author) -> Standing {
        match self.seat(author) {
            Some(seat) if seat == self.owner => Standing::Owner,
            Some(seat) if Some(seat) == self.fallback => Standing::Fallback,
            Some(_) => Standing::Member,
            None => Standing::Stray,
        }
    }

    /// True if the same two writers would be obeyed, in the same order.
    #[must_use]
    pub fn same_hands(&self, other: &Self) -> bool {
        self.author(self.owner) == other.author(other.owner)
            && self.fallback.and_then(|seat| self.author(seat))
                == other.fallback.and_then(|seat| other.author(seat))
    }
}

/// Who sits on a seat. The transport lets nobody else speak for it, so the seat tells the writer.
#[must_use]
pub fn author_on(seat: u32) -> Author {
    [u64::from(seat) + 1, 0]
}

impl From<&OwnerRecord> for Record {
    fn from(sample: &OwnerRecord) -> Self {
        let mut members = [NO_AUTHOR; SEATS];
        for ((member, period_ns), seat) in members.iter_mut().zip(sample.period_ns).zip(0..) {
            if period_ns > 0 {
                *member = author_on(seat);
            }
        }
        Self {
            epoch: sample.epoch,
            owner: Seat::new(sample.owner).unwrap_or(Seat::ALL[0]),
            fallback: Seat::new(sample.fallback),
            effective_ns: sample.header.valid_ns,
            members,
            period_ns: sample.period_ns,
            kind_changed: sample.kind_changed.is_set(),
        }
    }
}

impl Record {
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
        /// Who sits where.
        pub members: [[u64; 2]; SEATS],
        /// Control periods \[ns\].
        pub period_ns: [u64; SEATS],
        /// Owner's seat.
        pub owner: u32,
        /// Fallback's seat, or a number that is no seat.
        pub fallback: u32,
        /// Whether the owner is of another kind than before.
        pub kind_changed: bool,
    }
}

impl From<Option<Record>> for RecordMemory {
    fn from(record: Option<Record>) -> Self {
        record.map_or_else(Self::default, |record| Self {
            epoch: record.epoch,
            effective_ns: record.effective_ns,
            members: record.members,
            period_ns: record.period_ns,
            owner: record.owner.into(),
            fallback: record.fallback.map_or(u32::MAX, u32::from),
            kind_changed: record.kind_changed,
        })
    }
}

impl From<RecordMemory> for Option<Record> {
    fn from(memory: RecordMemory) -> Self {
        // A damaged memory names no seat, and then there is no record.
        let owner = Seat::new(memory.owner).filter(|_| memory.epoch > 0)?;
        Some(Record {
            epoch: memory.epoch,
            owner,
            fallback: Seat::new(memory.fallback),
            effective_ns: memory.effective_ns,
            members: memory.members,
            period_ns: memory.period_ns,
            kind_changed: memory.kind_changed,
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
            members: [[1, 0], [2, 0], [3, 0], NO_AUTHOR],
            period_ns: [10, 10, 20, 0],
            kind_changed: true,
        }
    }

    #[test]
    fn standing_follows_from_the_seat_and_nothing_else() {
        let record = record();
        assert_eq!(record.standing([2, 0]), Standing::Owner);
        assert_eq!(record.standing([1, 0]), Standing::Fallback);
        assert_eq!(record.standing([3, 0]), Standing::Member);
        assert_eq!(record.standing([4, 0]), Standing::Stray);
        assert_eq!(record.standing(NO_AUTHOR), Standing::Stray, "an empty seat is nobody's");
    }

    #[test]
    fn an_owner_that_falls_back_on_itself_is_just_the_owner() {
        let record = Record { fallback: Some(Seat(1)), ..record() };
        assert_eq!(record.standing([2, 0]), Standing::Owner);
    }

    #[test]
    fn hands_are_the_same_if_the_people_are_wherever_they_sit() {
        let moved = Record {
            owner: Seat(0),
            fallback: Some(Seat(1)),
            members: [[2, 0], [1, 0], NO_AUTHOR, NO_AUTHOR],
            ..record()
        };
        assert!(record().same_hands(&moved));
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
    fn there_are_exactly_as_many_seats_as_indices() {
        assert_eq!(Seat::new(3), Some(Seat(3)));
        assert_eq!(Seat::new(4), None);
        assert_eq!(Seat::ALL.map(Seat::index), [0, 1, 2, 3]);
    }
}
