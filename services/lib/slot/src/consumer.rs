//! Which record is in effect at the one who obeys it, and its own move from owner to fallback.
//!
//! ```text
//!              owner's command missing, fallback's there
//!   on owner ─────────────────────────────────────────────▶ on fallback
//!      ▲                                                        │
//!      └───────────────── a record of a new epoch ──────────────┘
//! ```
//!
//! At each instant, in this order: [`Consumer::take_record`] for records that have arrived,
//! [`Consumer::advance`], [`Consumer::standing_at`] for each command effective now,
//! [`Consumer::decide`]. [`crate::desk::Desk`] does the last two.

use crate::record::{Author, Record, RecordMemory, Seat, Standing};

/// Records that may wait for their instant.
pub const PENDING: usize = 4;

/// What became of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Taken {
    /// It counts from its instant on.
    Accepted,
    /// It is no newer than what is known: a repetition, ignored.
    Known,
    /// Its instant is past and it would have changed who commands. The supervisor must try again.
    Late,
    /// Too many records wait for their instants. The supervisor must try again.
    Full,
}

/// Whose command counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Source {
    /// The owner's.
    Owner,
    /// The fallback's, until the next epoch.
    Fallback,
    /// Nobody's: the consumer is on its own.
    Nobody,
}

/// A record came into effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Turn {
    /// The record now in effect.
    pub record: Record,
    /// Author whose commands counted before; `None` at the start.
    pub from: Option<Author>,
    /// Another author commands now, and it is a controller of another kind: what the limiter is for.
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
        /// Whether the fallback commands, in this epoch.
        pub failed_over: bool,
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
    failed_over: bool,
}

impl Consumer {
    /// A consumer that knows no record and obeys nobody.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
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
        // The newest word on an instant counts: records for it or for a later one are void.
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
        let from = self.author_in_effect();
        let mut turned = false;
        while let Some(due) = self.pending[0].filter(|next| next.effective_ns <= now_ns) {
            self.previous = self.current.replace(due);
            self.failed_over = false;
            self.pending.rotate_left(1);
            self.pending[PENDING - 1] = None;
            turned = true;
        }
        let record = self.current.filter(|_| turned)?;
        let kind_changed = record.kind_changed && record.author(record.owner) != from;
        Some(Turn { record, from, kind_changed })
    }

    /// Standing of a command's writer at the command's effective instant.
    ///
    /// A stray is one that no known record seats: one that has just left, or is about to join, is
    /// only a member.
    #[must_use]
    pub fn standing_at(&self, author: Author, effective_ns: u64) -> Standing {
        let known =
            || self.previous.iter().chain(&self.current).chain(self.pending.iter().flatten());
        let judge = known().rfind(|record| record.effective_ns <= effective_ns);
        match judge.map_or(Standing::Stray, |record| record.standing(author)) {
            Standing::Stray if known().any(|r| r.standing(author) != Standing::Stray) => {
                Standing::Member
            }
            standing => standing,
        }
    }

    /// Whose command counts at `now_ns`, given who has a usable one. Moves to the fallback, for the
    /// rest of the epoch, if only it has one.
    pub fn decide(&mut self, now_ns: u64, owner_valid: bool, fallback_valid: bool) -> Source {
        self.open_ns = self.open_ns.max(now_ns.saturating_add(1));
        let fallback_valid = fallback_valid && self.current.is_some_and(|r| r.fallback.is_some());
        if owner_valid && !self.failed_over {
            return Source::Owner;
        }
        if !fallback_valid {
            self.counters.missed += 1;
            return Source::Nobody;
        }
        if !self.failed_over {
            self.failed_over = true;
            self.counters.fail_overs += 1;
            self.counters.fail_over_ns = now_ns;
        }
        Source::Fallback
    }

    /// Says that every instant before `now_ns` has been decided, also those at which nobody asked:
    /// what was decided last was in effect until then.
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

    /// True once the fallback commands, until the next epoch.
    #[must_use]
    pub fn failed_over(&self) -> bool {
        self.failed_over
    }

    /// Seat whose commands count: the owner's, or after a fail-over the fallback's.
    #[must_use]
    pub fn seat_in_effect(&self) -> Option<Seat> {
        let record = self.current?;
        if self.failed_over { record.fallback } else { Some(record.owner) }
    }

    /// Who sits there.
    #[must_use]
    pub fn author_in_effect(&self) -> Option<Author> {
        self.current?.author(self.seat_in_effect()?)
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
            failed_over: self.failed_over,
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
            failed_over: memory.failed_over,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{NO_AUTHOR, SEATS};
    use shared_types::wire::Value;

    const A: Author = [1, 0];
    const B: Author = [2, 0];
    const C: Author = [3, 0];

    fn record(epoch: u64, effective_ns: u64, owner: usize, fallback: Option<usize>) -> Record {
        Record {
            epoch,
            owner: Seat::ALL[owner],
            fallback: fallback.map(|seat| Seat::ALL[seat]),
            effective_ns,
            members: [A, B, C, NO_AUTHOR],
            period_ns: [10; SEATS],
            kind_changed: false,
        }
    }

    fn consumer(records: &[Record]) -> Consumer {
        let mut consumer = Consumer::new();
        for record in records {
            assert_eq!(consumer.take_record(record), Taken::Accepted);
        }
        consumer
    }

    #[test]
    fn a_record_counts_from_its_instant_on_and_not_before() {
        let mut consumer = consumer(&[record(1, 0, 0, None), record(2, 50, 1, Some(0))]);
        assert_eq!(consumer.standing_at(A, 49), Standing::Owner);
        assert_eq!(consumer.standing_at(B, 49), Standing::Member);
        assert_eq!(consumer.standing_at(A, 50), Standing::Fallback);
        assert_eq!(consumer.standing_at(B, 50), Standing::Owner);
        assert!(consumer.advance(49).is_some());
        assert_eq!(consumer.epoch(), 1);
        let turn = consumer.advance(50).unwrap();
        assert_eq!((turn.from, turn.record.epoch), (Some(A), 2));
        assert_eq!(consumer.advance(51), None);
        // A command that comes late is still judged by the owner of its own instant.
        assert_eq!(consumer.standing_at(A, 49), Standing::Owner);
    }

    #[test]
    fn a_record_for_an_instant_already_decided_is_refused_and_counted() {
        let mut consumer = consumer(&[record(1, 0, 0, None)]);
        consumer.advance(20);
        assert_eq!(consumer.decide(20, true, false), Source::Owner);
        assert_eq!(consumer.take_record(&record(2, 20, 1, None)), Taken::Late);
        assert_eq!(consumer.counters().refused_records, 1);
        assert_eq!(consumer.counters().refused_epoch, 2);
        assert_eq!(consumer.take_record(&record(3, 21, 1, None)), Taken::Accepted);
        assert_eq!(consumer.counters().refused_records, 1);
    }

    #[test]
    fn an_instant_at_which_nobody_asked_is_decided_all_the_same_once_it_is_past() {
        let mut consumer = consumer(&[record(1, 0, 0, None)]);
        consumer.advance(20);
        consumer.decide(20, true, false);
        consumer.close_before(30);
        assert_eq!(consumer.take_record(&record(2, 29, 1, None)), Taken::Late);
        assert_eq!(consumer.take_record(&record(3, 30, 1, None)), Taken::Accepted);
    }

    #[test]
    fn a_late_record_that_changes_no_hands_is_taken_from_now_on() {
        let mut consumer = consumer(&[record(1, 0, 0, None)]);
        consumer.advance(20);
        consumer.decide(20, true, false);
        let mut joined = record(2, 20, 0, None);
        joined.members[3] = [4, 0];
        assert_eq!(consumer.take_record(&joined), Taken::Accepted);
        assert_eq!(consumer.advance(21).map(|turn| turn.record.effective_ns), Some(21));
    }

    #[test]
    fn a_late_record_does_not_undo_a_fail_over() {
        let mut consumer = consumer(&[record(1, 0, 0, Some(1))]);
        consumer.advance(20);
        assert_eq!(consumer.decide(20, false, true), Source::Fallback);
        assert_eq!(consumer.take_record(&record(2, 20, 0, Some(1))), Taken::Late);
        assert!(consumer.failed_over());
    }

    #[test]
    fn epochs_only_grow() {
        let mut consumer = consumer(&[record(5, 0, 0, None)]);
        assert_eq!(consumer.take_record(&record(5, 40, 1, None)), Taken::Known);
        assert_eq!(consumer.take_record(&record(4, 40, 1, None)), Taken::Known);
        assert_eq!(consumer.take_record(&record(6, 40, 1, None)), Taken::Accepted);
        assert_eq!(consumer.take_record(&record(6, 50, 2, None)), Taken::Known);
        consumer.advance(100);
        assert_eq!(consumer.epoch(), 6);
        assert_eq!(consumer.counters().refused_records, 0, "a repetition is no refusal");
    }

    #[test]
    fn a_newer_record_for_an_earlier_instant_voids_those_that_wait_beyond_it() {
        let mut consumer = consumer(&[record(1, 0, 0, None), record(2, 80, 1, None)]);
        consumer.advance(10);
        assert_eq!(consumer.take_record(&record(3, 40, 2, None)), Taken::Accepted);
        consumer.advance(200);
        assert_eq!(consumer.seat_in_effect(), Some(Seat::ALL[2]));
        assert_eq!(consumer.epoch(), 3);
    }

    #[test]
    fn more_records_than_there_is_room_for_are_refused_and_counted() {
        let mut consumer = Consumer::new();
        for epoch in 1..=PENDING as u64 {
            assert_eq!(consumer.take_record(&record(epoch, epoch * 10, 0, None)), Taken::Accepted);
        }
        assert_eq!(consumer.take_record(&record(9, 90, 0, None)), Taken::Full);
        assert_eq!(consumer.counters().refused_epoch, 9);
        consumer.advance(10);
        assert_eq!(consumer.take_record(&record(10, 90, 1, None)), Taken::Accepted);
    }

    #[test]
    fn a_fail_over_lasts_for_its_epoch_and_no_longer() {
        let mut consumer = consumer(&[record(1, 0, 0, Some(1))]);
        consumer.advance(0);
        assert_eq!(consumer.decide(0, true, true), Source::Owner);
        assert_eq!(consumer.decide(10, false, true), Source::Fallback);
        assert_eq!(consumer.decide(20, true, true), Source::Fallback, "the owner is back too late");
        assert_eq!(consumer.decide(30, true, false), Source::Nobody, "and is not asked again");
        assert_eq!(consumer.seat_in_effect(), Some(Seat::ALL[1]));
        assert_eq!(consumer.take_record(&record(2, 40, 0, Some(1))), Taken::Accepted);
        let turn = consumer.advance(40).unwrap();
        assert_eq!(turn.from, Some(B));
        assert_eq!(consumer.decide(40, true, true), Source::Owner);
        let counters = consumer.counters();
        assert_eq!((counters.fail_overs, counters.fail_over_ns, counters.missed), (1, 10, 1));
    }

    #[test]
    fn without_a_fallback_nobody_commands_when_the_owner_is_silent() {
        let mut consumer = consumer(&[record(1, 0, 0, None)]);
        consumer.advance(0);
        assert_eq!(consumer.decide(0, false, true), Source::Nobody);
        assert_eq!(
            consumer.decide(10, true, false),
            Source::Owner,
            "silence alone latches nothing"
        );
        assert_eq!(consumer.counters().missed, 1);
    }

    #[test]
    fn the_answer_to_a_fail_over_changes_nothing_for_the_limiter() {
        let mut consumer = consumer(&[record(1, 0, 0, Some(1))]);
        consumer.advance(0);
        consumer.decide(0, false, true);
        let answer = Record { kind_changed: true, ..record(2, 10, 1, None) };
        assert_eq!(consumer.take_record(&answer), Taken::Accepted);
        assert!(!consumer.advance(10).unwrap().kind_changed, "it already obeys that author");
        let other = Record { kind_changed: true, ..record(3, 20, 2, None) };
        assert_eq!(consumer.take_record(&other), Taken::Accepted);
        assert!(consumer.advance(20).unwrap().kind_changed);
    }

    #[test]
    fn only_a_writer_that_no_known_record_seats_is_a_stray() {
        let mut gone = record(2, 50, 1, None);
        gone.members[0] = NO_AUTHOR;
        let mut consumer = consumer(&[record(1, 0, 0, None), gone]);
        consumer.advance(60);
        assert_eq!(consumer.standing_at(A, 60), Standing::Member, "it has just left");
        assert_eq!(consumer.standing_at([9, 9], 60), Standing::Stray);
        assert_eq!(
            consumer.take_record(&Record { epoch: 3, effective_ns: 70, ..gone }),
            Taken::Accepted
        );
        consumer.advance(70);
        assert_eq!(consumer.standing_at(A, 70), Standing::Stray);
    }

    #[test]
    fn a_consumer_that_joins_late_believes_the_history() {
        let mut consumer = consumer(&[
            record(1, 0, 0, None),
            record(2, 50, 1, Some(0)),
            record(3, 70, 2, Some(1)),
        ]);
        consumer.advance(500);
        assert_eq!((consumer.epoch(), consumer.seat_in_effect()), (3, Some(Seat::ALL[2])));
    }

    #[test]
    fn a_restored_consumer_goes_on_as_the_first_would_have() {
        let mut consumer = consumer(&[record(1, 0, 0, Some(1)), record(2, 50, 1, Some(0))]);
        consumer.advance(10);
        consumer.decide(10, false, true);
        let mut packed = vec![0; ConsumerMemory::PACKED_SIZE];
        consumer.memory().pack(&mut packed);
        let mut other = Consumer::new();
        other.restore(&ConsumerMemory::unpack(&packed));
        assert_eq!(other, consumer);
    }
}
