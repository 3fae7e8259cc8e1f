//! Which record is in effect at a consumer of commands, and its own move from owner to fallback.
//!
//! ```text
//!        owner's command missing, or owner tripped; fallback's there
//!   on owner ─────────────────────────────────────────────▶ on fallback
//!      ▲                                                        │
//!      └───────────────── a record of a new epoch ──────────────┘
//! ```
//!
//! A trip outlasts an epoch whose record leaves owner and fallback in place, for example because a
//! rollback window is over: that record may have been written before the trip and come into effect after
//! it.
//!
//! At each instant, in this order: [`Consumer::take_record`] for records that have arrived,
//! [`Consumer::advance`], [`Consumer::trip`] for each trip effective now, [`Consumer::authority_at`] for
//! each command effective now, [`Consumer::decide`]. [`crate::command_buffer::CommandBuffer`] does the last two.

use crate::record::{Authority, Record, RecordMemory, Seat};

/// Records that may wait for their instant.
pub const PENDING: usize = 4;

/// For how long a consumer that could not hold the vehicle up for ever does not follow an owner that has tripped although
/// there is no fallback. After that even a bad owner is better than none: the actuation gate would begin to descend half a
/// second later \[ns\].
pub const REJECTED_AFTER_TRIP_NS: u64 = 1_500_000_000;

/// What became of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Taken {
    /// It counts from its instant on.
    Accepted,
    /// It is no newer than what is known: a repetition, ignored.
    Known,
    /// Its instant is past and it would have changed the commanding seat. The supervisor must try again.
    Late,
    /// Too many records wait for their instants. The supervisor must try again.
    Full,
}

/// The seat whose command counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Source {
    /// The owner's.
    Owner,
    /// The fallback's, until the next epoch; after a trip until a record names another owner or fallback.
    Fallback,
    /// No seat's: the consumer is on its own.
    Neither,
}

/// What became of a trip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Tripped {
    /// The owner is not followed any more, and the fallback is as soon as it has a usable command.
    ToFallback,
    /// The record has no fallback to move to: no command counts, for as long as the consumer was
    /// made to.
    NoFallback,
    /// It is of an older epoch, of a seat that is not the owner's, of an owner that is not watched, of
    /// one that is not followed any more, or a repetition.
    Ignored,
}

/// A record came into effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Turn {
    /// The record now in effect.
    pub record: Record,
    /// Seat whose commands counted before; `None` at the start.
    pub from: Option<Seat>,
    /// Another seat commands now, and it is a controller of another kind: what the limiter is for.
    pub kind_changed: bool,
}

shared_types::memory! {
    /// What a consumer has counted since its start.
    #[derive(PartialEq, Eq, Hash)]
    pub struct Counters {
        /// Records refused: too late, or too many at once.
        pub refused_records: u64,
        /// Epoch of the last of them, for the supervisor to repeat; 0 for none.
        pub refused_epoch: u64,
        /// Moves from owner to fallback.
        pub fail_overs: u64,
        /// Instant of the last of them \[ns\].
        pub fail_over_ns: u64,
        /// Instants with neither owner's nor fallback's command.
        pub missed: u64,
        /// Trips taken, one per epoch at most.
        pub trips: u64,
        /// Instant of the last of them \[ns\].
        pub trip_ns: u64,
    }
}

shared_types::memory! {
    /// A [`Consumer`] as plain numbers.
    #[derive(PartialEq)]
    pub struct ConsumerMemory {
        /// Record in effect.
        pub current: RecordMemory,
        /// Record in effect before it.
        pub previous: RecordMemory,
        /// Records that wait for their instants, oldest first.
        pub pending: [RecordMemory; PENDING],
        /// Counts since start.
        pub counters: Counters,
        /// One more than the last instant decided; 0 before the first \[ns\].
        pub open_ns: u64,
        /// Epoch of the first of the records in a row that name the owner and the fallback of now.
        pub hands_epoch: u64,
        /// Whether the fallback commands.
        pub failed_over: bool,
        /// Whether the owner has tripped, under these records.
        pub tripped: bool,
        /// Epoch by which it was judged, once it has tripped.
        pub tripped_epoch: u64,
    }
}

/// The consumer's side of the protocol. Of fixed size; nothing here allocates or panics.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Consumer {
    current: Option<Record>,
    previous: Option<Record>,
    pending: [Option<Record>; PENDING],
    counters: Counters,
    open_ns: u64,
    hands_epoch: u64,
    failed_over: bool,
    tripped: bool,
    tripped_epoch: u64,
    rejected_for_ns: u64,
}

impl Consumer {
    /// A consumer that knows no record and follows no seat. So long it rather follows none than an owner that has tripped
    /// \[ns\].
    #[must_use]
    pub fn new(rejected_for_ns: u64) -> Self {
        Self { rejected_for_ns, ..Self::default() }
    }

    /// Takes a record as soon as it is known; it counts from its own instant on.
    ///
    /// An instant that has been decided stays decided: a record for it is refused and counted. Only
    /// one that leaves command in the same hands is taken all the same, from now on.
    pub fn take_record(&mut self, record: &Record) -> Taken {
        if record.epoch <= self.newest().map_or(0, |newest| newest.epoch) {
            return Taken::Known;
        }
        let late = record.effective_ns < self.open_ns;
        let same_hands = self.current.is_some_and(|now| now.same_hands(record));
        if late && (self.failed_over || !same_hands) {
            return self.refuse(record, Taken::Late);
        }
        let record = Record { effective_ns: record.effective_ns.max(self.open_ns), ..*record };
        // The newest record on an instant counts: records for it or for a later one are void.
        for place in &mut self.pending {
            *place = place.filter(|older| older.effective_ns < record.effective_ns);
        }
        match self.pending.iter_mut().find(|place| place.is_none()) {
            Some(place) => {
                *place = Some(record);
                Taken::Accepted
            }
            None => self.refuse(&record, Taken::Full),
        }
    }

    fn refuse(&mut self, record: &Record, why: Taken) -> Taken {
        self.counters.refused_records += 1;
        self.counters.refused_epoch = record.epoch;
        why
    }

    fn newest(&self) -> Option<&Record> {
        self.pending.iter().rev().flatten().next().or(self.current.as_ref())
    }

    /// Puts into effect what is due at `now_ns`; the last of several.
    pub fn advance(&mut self, now_ns: u64) -> Option<Turn> {
        let from = self.followed();
        let mut turned = false;
        while let Some(due) = self.pending[0].filter(|next| next.effective_ns <= now_ns) {
            self.previous = self.current.replace(due);
            let same_hands = self.previous.is_some_and(|before| before.same_hands(&due));
            if !same_hands {
                self.hands_epoch = due.epoch;
            }
            // Without a fallback the owner that tripped may have been started again since, unless it was judged by this
            // record already, which has come late.
            let same_owner = self.previous.is_some_and(|before| before.owner == due.owner);
            let is_meant = same_owner && self.tripped_epoch >= due.epoch;
            self.tripped &= is_meant || same_hands && Self::has_fallback(&due);
            self.failed_over &= self.tripped && same_hands;
            self.pending.rotate_left(1);
            self.pending[PENDING - 1] = None;
            turned = true;
        }
        let record = self.current.filter(|_| turned)?;
        let kind_changed = record.kind_changed && self.seat_in_effect() != from;
        Some(Turn { record, from, kind_changed })
    }

    /// Takes the monitor's trip, in effect at `at_ns`, that the owner on `seat` by the record of `epoch`
    /// is not to be followed any more. A record that has left owner and fallback in place since does not
    /// outdate it; and the epoch may be one that this consumer has refused or not received yet, while the owner is the
    /// same.
    ///
    /// One that came late counts from the next decision on, like a late command: what has been decided
    /// stays decided, and an owner that has to go had better go late than not at all.
    pub fn trip(&mut self, epoch: u64, seat: Seat, at_ns: u64) -> Tripped {
        let judged = |record: &Record| {
            let is_of_these = epoch >= self.hands_epoch;
            record.watched && is_of_these && record.owner == seat && !self.failed_over
        };
        let Some(record) = self.current.filter(|record| judged(record) && !self.tripped) else {
            return Tripped::Ignored;
        };
        self.tripped = true;
        self.tripped_epoch = epoch;
        self.counters.trips += 1;
        self.counters.trip_ns = at_ns.max(self.open_ns);
        if Self::has_fallback(&record) { Tripped::ToFallback } else { Tripped::NoFallback }
    }

    fn has_fallback(record: &Record) -> bool {
        record.fallback.is_some_and(|fallback| record.is_taken(fallback))
    }

    /// Authority of `seat`'s writer at the effective instant of a command of its.
    ///
    /// A stray is one that no known record seats: one that has just left, or is about to join, is
    /// only a member.
    #[must_use]
    pub fn authority_at(&self, seat: Seat, effective_ns: u64) -> Authority {
        let known =
            || self.previous.iter().chain(&self.current).chain(self.pending.iter().flatten());
        let judge = known().rfind(|record| record.effective_ns <= effective_ns);
        match judge.map_or(Authority::Stray, |record| record.authority(seat)) {
            Authority::Stray if known().any(|r| r.authority(seat) != Authority::Stray) => {
                Authority::Member
            }
            authority => authority,
        }
    }

    /// Decides which command counts at `now_ns`, given which seats have a usable one. Moves to the fallback, until the
    /// next epoch, if only it has one; and until a record names another owner or fallback, if it has one
    /// and the owner has tripped. For the time that the consumer was made with, an owner that has tripped is
    /// not followed even if there is no fallback.
    pub fn decide(&mut self, now_ns: u64, owner_valid: bool, fallback_valid: bool) -> Source {
        self.open_ns = self.open_ns.max(now_ns.saturating_add(1));
        let fallback_valid = fallback_valid && self.current.is_some_and(|r| r.fallback.is_some());
        let rejected_until_ns = self.counters.trip_ns.saturating_add(self.rejected_for_ns);
        let owner_counts = !self.tripped || now_ns >= rejected_until_ns && !fallback_valid;
        if owner_valid && !self.failed_over && owner_counts {
            return Source::Owner;
        }
        if !fallback_valid {
            self.counters.missed += 1;
            return Source::Neither;
        }
        if !self.failed_over {
            self.failed_over = true;
            self.counters.fail_overs += 1;
            self.counters.fail_over_ns = now_ns;
        }
        Source::Fallback
    }

    /// Declares that every instant before `now_ns` has been decided, also those at which no decision was asked
    /// for: what was decided last was in effect until then.
    pub fn close_before(&mut self, now_ns: u64) {
        self.open_ns = self.open_ns.max(now_ns);
    }

    /// First instant not decided yet \[ns\].
    #[must_use]
    pub fn open_ns(&self) -> u64 {
        self.open_ns
    }

    /// The record in effect.
    #[must_use]
    pub fn record(&self) -> Option<&Record> {
        self.current.as_ref()
    }

    /// Epoch in effect; 0 before the first.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.current.map_or(0, |record| record.epoch)
    }

    /// True once the fallback commands, until the next epoch; after a trip for as long as
    /// [`tripped`](Self::tripped).
    #[must_use]
    pub fn failed_over(&self) -> bool {
        self.failed_over
    }

    /// True once the owner has tripped, until a record names another owner or fallback, or none for one that is gone.
    #[must_use]
    pub fn tripped(&self) -> bool {
        self.tripped
    }

    /// Seat whose commands count: the owner's, or after a fail-over the fallback's.
    #[must_use]
    pub fn seat_in_effect(&self) -> Option<Seat> {
        let record = self.current?;
        if self.failed_over { record.fallback } else { Some(record.owner) }
    }

    /// That seat, if a process sits there.
    #[must_use]
    pub fn followed(&self) -> Option<Seat> {
        self.seat_in_effect().filter(|seat| self.current.is_some_and(|r| r.is_taken(*seat)))
    }

    /// What happened since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> ConsumerMemory {
        ConsumerMemory {
            current: self.current.into(),
            previous: self.previous.into(),
            pending: self.pending.map(RecordMemory::from),
            counters: self.counters,
            open_ns: self.open_ns,
            hands_epoch: self.hands_epoch,
            failed_over: self.failed_over,
            tripped: self.tripped,
            tripped_epoch: self.tripped_epoch,
        }
    }

    /// Continues from a memory.
    pub fn restore(&mut self, memory: &ConsumerMemory) {
        *self = Self {
            current: memory.current.into(),
            previous: memory.previous.into(),
            pending: memory.pending.map(Option::<Record>::from),
            counters: memory.counters,
            open_ns: memory.open_ns,
            hands_epoch: memory.hands_epoch,
            failed_over: memory.failed_over,
            tripped: memory.tripped,
            tripped_epoch: memory.tripped_epoch,
            rejected_for_ns: self.rejected_for_ns,
        };
    }
}

#[cfg(test)]
mod tests;
