//! How the consumer of a slot selects a command: which seat's command counts from instant to instant.
//!
//! Once per step [`CommandArbiter::take_records`] takes the owner records. Then, instant by instant:
//! [`advance`](CommandArbiter::advance), [`trip`](CommandArbiter::trip) for each trip and
//! [`offer`](CommandArbiter::offer) for each command that takes effect, [`decide`](CommandArbiter::decide). A
//! step that ends after its last decision declares so with [`close_before`](CommandArbiter::close_before): a
//! record for an instant that is past then came too late and is refused. [`setpoints`] does all this for a
//! loop that tracks attitude set points.

pub mod setpoints;

use crate::input::Input;
use shared_types::{Header, NO_SEAT, OwnerRecord, Role, Trip};
use slot::{
    Authority, Command, CommandBuffer, CommandBufferMemory, Consumer, ConsumerMemory, Counters,
    Limiter, LimiterMemory, Record, Seat, Source, Tripped,
};

/// Time over which what the limiter takes out of a change of kind comes back \[ns\].
pub const LIMITED_FOR_NS: u64 = 100_000_000;

/// The command to apply.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Selection {
    /// The command in effect, its value as the limiter leaves it.
    pub command: Command,
    /// The seat that gave it.
    pub seat: Seat,
    /// It is another than at the decision before, or the limiter has moved on.
    pub is_new: bool,
}

shared_types::memory! {
    /// A [`CommandArbiter`] as plain numbers.
    #[derive(PartialEq)]
    pub struct ArbiterMemory {
        /// Records.
        pub consumer: ConsumerMemory,
        /// Commands.
        pub commands: CommandBufferMemory,
        /// What is still taken out of a change of kind.
        pub limiter: LimiterMemory,
        /// Last order.
        pub given: Command,
        /// Seat that gave it; [`NO_SEAT`] if none has.
        pub given_by: u32,
        /// An owner of another kind has not published yet.
        pub kind_changes: bool,
    }
}

fn command(header: &Header, value: [f64; 4], validity_ns: u64) -> Command {
    Command {
        value,
        sequence: header.sequence,
        cause_sequence: header.cause_sequence,
        effective_ns: header.valid_ns,
        valid_until_ns: header.valid_ns.saturating_add(validity_ns),
    }
}

/// The arbiter of one slot's consumer. Of fixed size; nothing here allocates or panics.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandArbiter {
    consumer: Consumer,
    commands: CommandBuffer,
    limiter: Limiter,
    given: Command,
    given_by: Option<Seat>,
    kind_changes: bool,
}

impl CommandArbiter {
    /// Knows no record and follows no seat. So long it rather follows none than an owner that has tripped \[ns\].
    #[must_use]
    pub fn new(rejected_for_ns: u64) -> Self {
        Self {
            consumer: Consumer::new(rejected_for_ns),
            commands: CommandBuffer::new(),
            limiter: Limiter::new([0.0; 4], LIMITED_FOR_NS),
            given: Command::default(),
            given_by: None,
            kind_changes: false,
        }
    }

    /// Takes the records of this step; a loop that joins a flight begins with the one in effect.
    pub fn take_records(&mut self, records: &Input<OwnerRecord>) {
        let joined = records.before_fresh().filter(|_| self.consumer.record().is_none());
        for record in joined.into_iter().chain(records.fresh()).filter_map(Record::read) {
            // A refusal is counted, and reported by `counters`.
            let _taken = self.consumer.take_record(&record);
        }
    }

    /// Puts into effect the record that is due at `now_ns`.
    pub fn advance(&mut self, now_ns: u64) {
        if let Some(turn) = self.consumer.advance(now_ns) {
            self.commands.turn(&turn);
            self.kind_changes = turn.kind_changed;
        }
    }

    /// Takes a trip that is in effect, if it is about the owner of `slot`, which this consumer follows.
    pub fn trip(&mut self, slot: Role, trip: &Trip) -> Tripped {
        match Seat::new(trip.instance) {
            Some(seat) if trip.slot == slot => {
                self.consumer.trip(trip.epoch, seat, trip.header.valid_ns)
            }
            _ => Tripped::Ignored,
        }
    }

    /// Authority of a command's writer at the command's effective instant.
    #[must_use]
    pub fn authority_of(&self, header: &Header) -> Authority {
        Seat::new(header.seat)
            .map_or(Authority::Stray, |seat| self.consumer.authority_at(seat, header.valid_ns))
    }

    /// Two control periods of a command's writer, by the record in effect \[ns\].
    #[must_use]
    pub fn two_periods_ns(&self, header: &Header) -> u64 {
        let period_ns = || Some(self.consumer.record()?.period_ns[Seat::new(header.seat)?.index()]);
        period_ns().unwrap_or(0).saturating_mul(2)
    }

    /// Takes in a command that is fit to be followed and counts for `validity_ns` from its
    /// effective instant on.
    pub fn offer(&mut self, header: &Header, value: [f64; 4], validity_ns: u64) {
        let Some(seat) = Seat::new(header.seat) else { return };
        self.commands.offer(&self.consumer, seat, &command(header, value, validity_ns));
    }

    /// Takes a command as the one in effect when this consumer joined, until the owner publishes.
    pub fn carry(&mut self, header: &Header, value: [f64; 4], validity_ns: u64) {
        let Some(seat) = Seat::new(header.seat) else { return };
        self.commands.carry(seat, &command(header, value, validity_ns));
    }

    /// What to apply at `now_ns`; `None` if no seat has a valid command. A change of kind may step by
    /// at most `limit` per axis, in the command's units.
    pub fn decide(&mut self, now_ns: u64, limit: &[f64; 4]) -> Option<Selection> {
        let choice = self.commands.decide(&mut self.consumer, now_ns)?;
        let (seat, command) = (choice.seat, choice.command);
        let by_owner = choice.source == Source::Owner
            && self.consumer.record().is_some_and(|record| record.owner == seat);
        let before = (self.given, self.given_by);
        if Some(seat) != self.given_by {
            if let Some(given_by) = self.given_by.filter(|_| by_owner && self.kind_changes) {
                let old = self.commands.command_of(given_by, now_ns);
                let old =
                    old.map_or(self.given.value, |old| self.limiter.apply(now_ns, &old.value));
                self.limiter = Limiter::new(*limit, LIMITED_FOR_NS);
                self.limiter.engage(now_ns, &old, &command.value);
            } else {
                // What was taken out was the difference between two others.
                self.limiter.restore(&LimiterMemory::default());
            }
        }
        // Until the new owner publishes, the one before is still followed, and the change is to come.
        if by_owner || choice.source == Source::Fallback {
            self.kind_changes = false;
        }
        self.given = Command { value: self.limiter.apply(now_ns, &command.value), ..command };
        self.given_by = Some(seat);
        Some(Selection { command: self.given, seat, is_new: before != (self.given, self.given_by) })
    }

    /// Declares that every instant before `now_ns` is past. Before the first record nothing was decided:
    /// one that comes late then is better than none.
    pub fn close_before(&mut self, now_ns: u64) {
        if self.consumer.record().is_some() {
            self.consumer.close_before(now_ns);
        }
    }

    /// Decides that nothing counts at `at_ns`, whatever owner and fallback publish.
    pub fn reject(&mut self, at_ns: u64) {
        self.consumer.close_before(at_ns.saturating_add(1));
        self.commands.clear();
    }

    /// Notes that the last order is no longer what is applied: nothing has to continue from it.
    pub fn forget_order(&mut self) {
        self.given_by = None;
        self.limiter.restore(&LimiterMemory::default());
    }

    /// The last order, if its end is past at `now_ns`.
    #[must_use]
    pub fn lapsed(&self, now_ns: u64) -> Option<&Command> {
        let is_over = self.given_by.is_some() && now_ns >= self.given.valid_until_ns;
        is_over.then_some(&self.given)
    }

    /// Sets what is applied in place of the last order, which has lapsed: a change of kind continues from it.
    pub fn replace_lapsed(&mut self, value: [f64; 4]) {
        self.given.value = value;
    }

    /// When the fallback takes over unless the owner publishes again \[ns\].
    #[must_use]
    pub fn lapses_ns(&self) -> Option<u64> {
        let has_fallback = self.consumer.record()?.fallback.is_some();
        (has_fallback && !self.failed_over() && self.given_by.is_some())
            .then_some(self.given.valid_until_ns)
    }

    /// True if the owner by the record in effect has not proven itself.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        self.consumer.record().is_some_and(|record| record.watched)
    }

    /// Epoch in effect; 0 before the first.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.consumer.epoch()
    }

    /// Seat whose commands count: the owner's, or after a fail-over the fallback's; [`NO_SEAT`]
    /// before the first record.
    #[must_use]
    pub fn seat(&self) -> u32 {
        self.consumer.seat_in_effect().map_or(NO_SEAT, u32::from)
    }

    /// True once the fallback commands, until the next epoch; after a trip for as long as
    /// [`tripped`](Self::tripped).
    #[must_use]
    pub fn failed_over(&self) -> bool {
        self.consumer.failed_over()
    }

    /// True once the owner has tripped, until a record names another owner or fallback, or none for one that is gone.
    #[must_use]
    pub fn tripped(&self) -> bool {
        self.consumer.tripped()
    }

    /// True if the owner has tripped and no fallback has taken over: where nothing is to be applied then, what the
    /// owner has commanded before is not to be held either.
    #[must_use]
    pub fn is_revoked(&self) -> bool {
        self.tripped() && !self.failed_over()
    }

    /// What happened since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.consumer.counters()
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> ArbiterMemory {
        ArbiterMemory {
            consumer: self.consumer.memory(),
            commands: self.commands.memory(),
            limiter: self.limiter.memory(),
            given: self.given,
            given_by: self.given_by.map_or(NO_SEAT, u32::from),
            kind_changes: self.kind_changes,
        }
    }

    /// Continues from a memory, bit for bit.
    pub fn restore(&mut self, memory: &ArbiterMemory) {
        self.consumer.restore(&memory.consumer);
        self.commands.restore(&memory.commands);
        self.limiter.restore(&memory.limiter);
        self.given = memory.given;
        self.given_by = Seat::new(memory.given_by);
        self.kind_changes = memory.kind_changes;
    }
}
