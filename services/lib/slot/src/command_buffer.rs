//! The commands that a consumer holds: the last one of each writer, and which of them counts now.
//!
//! A command is judged once, at its own effective instant. Until the new owner's first command the
//! old owner's last one stays in effect, as far as it is valid; the fallback has its newest command
//! ready.

use crate::consumer::{Consumer, Source, Turn};
use crate::record::{Authority, SEATS, Seat};

shared_types::memory! {
    /// A command that was its writer's to give.
    #[derive(PartialEq)]
    pub struct Command {
        /// What is commanded: T \[N\] and τ \[N m\] for attitude, T \[N\] and φ, θ, ψ \[rad\] for
        /// position.
        pub value: [f64; 4],
        /// Its sequence, for whatever asks which command was followed.
        pub sequence: u64,
        /// Sequence of the sensor sample it descends from.
        pub cause_sequence: u64,
        /// Instant from which it counts \[ns\].
        pub effective_ns: u64,
        /// Instant from which it counts no longer \[ns\].
        pub valid_until_ns: u64,
    }
}

impl Command {
    /// Itself, if it counts at `now_ns`; the default never does.
    fn valid(&self, now_ns: u64) -> Option<Self> {
        (self.effective_ns <= now_ns && now_ns < self.valid_until_ns).then_some(*self)
    }
}

/// What counts at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// The command in effect.
    pub command: Command,
    /// Owner or fallback.
    pub source: Source,
    /// Its writer. Around a flip that can be the owner before.
    pub seat: Seat,
}

shared_types::memory! {
    /// A command and the seat that gave it; one that is never valid for none.
    #[derive(PartialEq)]
    struct Given {
        command: Command,
        seat: u8,
    }
}

impl Given {
    fn new((seat, command): (Seat, Command)) -> Self {
        Self { command, seat: seat.into() }
    }

    fn valid(&self, now_ns: u64) -> Option<(Seat, Command)> {
        Some((Seat::new(self.seat.into())?, self.command.valid(now_ns)?))
    }
}

shared_types::memory! {
    /// A [`CommandBuffer`] as plain numbers.
    #[derive(PartialEq)]
    pub struct CommandBufferMemory {
        held: [Command; SEATS],
        carried: Given,
        last: Given,
    }
}

/// What each writer commanded last. Of fixed size; nothing here allocates or panics.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandBuffer {
    /// By seat, the newest command of owner and fallback.
    held: [Command; SEATS],
    /// In effect at the last turn.
    carried: Given,
    /// In effect at the last decision.
    last: Given,
}

impl Default for CommandBuffer {
    fn default() -> Self {
        Self::new()
    }
}

impl CommandBuffer {
    /// An empty buffer.
    #[must_use]
    pub fn new() -> Self {
        Self {
            held: [Command::default(); SEATS],
            carried: Given::default(),
            last: Given::default(),
        }
    }

    /// Keeps what was in effect until the new owner publishes; call it when [`Consumer::advance`]
    /// returns that a record came into effect.
    pub fn turn(&mut self, turn: &Turn) {
        self.carried = self.last;
        for (held, seat) in self.held.iter_mut().zip(Seat::ALL) {
            if !turn.record.is_taken(seat) {
                *held = Command::default();
            }
        }
    }

    /// Judges a command of `seat`'s at its effective instant and keeps it if it is the owner's or the
    /// fallback's. A command that is not fit to be followed should not be offered: its writer is then
    /// silent.
    pub fn offer(&mut self, consumer: &Consumer, seat: Seat, command: &Command) -> Authority {
        let authority = consumer.authority_at(seat, command.effective_ns);
        let is_seated = consumer.record().is_some_and(|record| record.is_taken(seat));
        let held = &mut self.held[seat.index()];
        if matches!(authority, Authority::Owner | Authority::Fallback)
            && is_seated
            && held.effective_ns <= command.effective_ns
        {
            *held = *command;
        }
        authority
    }

    /// Keeps a command in effect until the owner publishes, whichever seat gave it: a consumer that
    /// joins has missed earlier commands of the owner and must not take it for silent.
    pub fn carry(&mut self, seat: Seat, command: &Command) {
        self.carried = Given::new((seat, *command));
    }

    /// What counts at `now_ns`, if anything does.
    pub fn decide(&mut self, consumer: &mut Consumer, now_ns: u64) -> Option<Choice> {
        let record = consumer.record()?;
        let of = |seat: Seat| Some((seat, self.held[seat.index()].valid(now_ns)?));
        let (held, carried) = (of(record.owner), self.carried.valid(now_ns));
        // What the new owner published while it was still the fallback counts only once nothing else does.
        let is_from_before = held.is_some_and(|(_, held)| held.effective_ns < record.effective_ns);
        let is_anothers = carried.is_some_and(|(seat, _)| seat != record.owner);
        let owner = if is_from_before && is_anothers { carried } else { held.or(carried) };
        let fallback = record.fallback.and_then(of);
        let source = consumer.decide(now_ns, owner.is_some(), fallback.is_some());
        let given = match source {
            Source::Owner => owner,
            Source::Fallback => fallback,
            Source::Neither => None,
        };
        self.last = given.map_or_else(Given::default, Given::new);
        given.map(|(seat, command)| Choice { command, source, seat })
    }

    /// Notes that nothing is in effect: what was is not carried over to another owner.
    pub fn clear(&mut self) {
        self.last = Given::default();
    }

    /// What `seat` commands at `now_ns`, whether it counts or not.
    #[must_use]
    pub fn command_of(&self, seat: Seat, now_ns: u64) -> Option<Command> {
        self.held[seat.index()].valid(now_ns)
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> CommandBufferMemory {
        CommandBufferMemory { held: self.held, carried: self.carried, last: self.last }
    }

    /// Continues from a memory.
    pub fn restore(&mut self, memory: &CommandBufferMemory) {
        let CommandBufferMemory { held, carried, last } = *memory;
        *self = Self { held, carried, last };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consumer::Taken;
    use crate::record::Record;

    const A: Seat = Seat::ALL[0];
    const B: Seat = Seat::ALL[1];
    const C: Seat = Seat::ALL[2];
    const D: Seat = Seat::ALL[3];
    const PERIOD_NS: u64 = 10;

    fn record(epoch: u64, effective_ns: u64, owner: usize, fallback: Option<usize>) -> Record {
        Record {
            epoch,
            owner: Seat::ALL[owner],
            fallback: fallback.map(|seat| Seat::ALL[seat]),
            effective_ns,
            period_ns: [PERIOD_NS, PERIOD_NS, 0, 0],
            kind_changed: false,
            watched: true,
        }
    }

    struct Receiver {
        consumer: Consumer,
        commands: CommandBuffer,
    }

    impl Receiver {
        fn new(records: &[Record]) -> Self {
            let mut consumer = Consumer::new(crate::REJECTED_AFTER_TRIP_NS);
            for record in records {
                assert_eq!(consumer.take_record(record), Taken::Accepted);
            }
            Self { consumer, commands: CommandBuffer::new() }
        }

        /// One instant: commands of these writers, then the choice.
        fn at(&mut self, now_ns: u64, writers: &[Seat]) -> Option<(Seat, u64)> {
            if let Some(turn) = self.consumer.advance(now_ns) {
                self.commands.turn(&turn);
            }
            for seat in writers {
                let command = Command {
                    effective_ns: now_ns,
                    valid_until_ns: now_ns + 2 * PERIOD_NS,
                    ..Command::default()
                };
                self.commands.offer(&self.consumer, *seat, &command);
            }
            let choice = self.commands.decide(&mut self.consumer, now_ns);
            choice.map(|choice| (choice.seat, choice.command.effective_ns))
        }
    }

    #[test]
    fn at_a_flip_the_new_owners_command_counts_from_its_instant() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, None), record(2, 20, 1, Some(0))]);
        assert_eq!(receiver.at(0, &[A, B]), Some((A, 0)));
        assert_eq!(receiver.at(10, &[A, B]), Some((A, 10)));
        assert_eq!(receiver.at(20, &[A, B]), Some((B, 20)));
    }

    #[test]
    fn until_the_new_owner_publishes_the_old_ones_last_command_stays_in_effect() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, None), record(2, 20, 1, None)]);
        assert_eq!(receiver.at(10, &[A]), Some((A, 10)));
        assert_eq!(receiver.at(20, &[]), Some((A, 10)));
        assert_eq!(receiver.at(25, &[B]), Some((B, 25)));
    }

    #[test]
    fn after_a_flip_the_old_owner_is_not_followed_again_but_for_a_fail_over() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, None), record(2, 20, 1, Some(0))]);
        assert_eq!(receiver.at(10, &[A]), Some((A, 10)));
        assert_eq!(
            receiver.at(20, &[A]),
            Some((A, 10)),
            "valid, and given while it was the owner's"
        );
        assert_eq!(receiver.at(29, &[]), Some((A, 10)));
        assert_eq!(receiver.consumer.counters().fail_overs, 0);
        assert_eq!(receiver.at(30, &[A]), Some((A, 30)), "the new owner never spoke");
        assert_eq!(receiver.consumer.counters().fail_overs, 1);
        assert_eq!(receiver.at(40, &[A, B]), Some((A, 40)), "latched for the epoch");
    }

    #[test]
    fn a_rollback_follows_the_old_owners_commands_only_if_nothing_else_counts() {
        let back = record(3, 37, 0, Some(1));
        let mut receiver = Receiver::new(&[record(1, 0, 0, None), record(2, 20, 1, Some(0)), back]);
        assert_eq!(receiver.at(10, &[A]), Some((A, 10)));
        assert_eq!(receiver.at(20, &[A, B]), Some((B, 20)));
        assert_eq!(receiver.at(30, &[A, B]), Some((B, 30)));
        assert_eq!(receiver.at(37, &[]), Some((B, 30)), "not what A said at 30");
        assert_eq!(receiver.at(40, &[A, B]), Some((A, 40)));
        // The owner died at 20, and the old one commands again at 37.
        let mut receiver = Receiver::new(&[record(1, 0, 0, None), record(2, 20, 1, Some(0)), back]);
        for (now_ns, writers) in [(10, &[A][..]), (20, &[A, B]), (35, &[A])] {
            receiver.at(now_ns, writers);
        }
        assert_eq!(receiver.at(37, &[]), Some((B, 20)));
        assert_eq!(receiver.at(41, &[]), Some((A, 35)), "what was carried has run out");
        assert_eq!(receiver.consumer.counters().missed, 0);
    }

    #[test]
    fn a_rollback_after_a_fail_over_goes_on_with_the_fallbacks_last_command() {
        let back = record(2, 37, 1, Some(0));
        let mut receiver = Receiver::new(&[record(1, 0, 0, Some(1)), back]);
        assert_eq!(receiver.at(0, &[A, B]), Some((A, 0)));
        assert_eq!(receiver.at(30, &[B]), Some((B, 30)), "the owner is silent");
        assert_eq!(receiver.at(37, &[]), Some((B, 30)));
    }

    #[test]
    fn a_silent_owner_is_replaced_at_the_end_of_its_last_commands_validity() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, Some(1))]);
        assert_eq!(receiver.at(10, &[A, B]), Some((A, 10)));
        assert_eq!(receiver.at(20, &[B]), Some((A, 10)));
        assert_eq!(receiver.at(30, &[B]), Some((B, 30)), "within two periods");
        assert_eq!(receiver.at(40, &[A]), Some((B, 30)));
        assert_eq!(receiver.at(50, &[A]), None, "the owner is not asked again in this epoch");
    }

    #[test]
    fn for_a_joiner_the_owner_is_silent_only_once_what_was_in_effect_has_run_out() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, Some(1))]);
        receiver.consumer.advance(10);
        let last = Command { effective_ns: 10, valid_until_ns: 30, ..Command::default() };
        receiver.commands.carry(B, &last);
        assert_eq!(receiver.at(15, &[]), Some((B, 10)));
        assert_eq!(receiver.at(20, &[A, B]), Some((A, 20)));
        assert!(!receiver.consumer.failed_over());
        let mut other = Receiver::new(&[record(1, 0, 0, Some(1))]);
        other.consumer.advance(10);
        other.commands.carry(B, &last);
        assert_eq!(other.at(20, &[B]), Some((B, 10)));
        assert_eq!(other.at(30, &[B]), Some((B, 30)));
        assert!(other.consumer.failed_over(), "an owner that never speaks");
    }

    #[test]
    fn no_other_seat_is_ever_followed() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, None)]);
        assert_eq!(receiver.at(0, &[B, C, D]), None);
        assert_eq!(receiver.at(10, &[B]), None);
    }

    #[test]
    fn an_older_command_does_not_replace_a_newer_one() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, None)]);
        assert_eq!(receiver.at(30, &[A]), Some((A, 30)));
        let late = Command { effective_ns: 20, valid_until_ns: 90, ..Command::default() };
        assert_eq!(receiver.commands.offer(&receiver.consumer, A, &late), Authority::Owner);
        assert_eq!(receiver.at(40, &[]), Some((A, 30)));
    }

    #[test]
    fn a_successor_on_the_same_seat_inherits_no_commands() {
        let alone = |record: Record| Record { period_ns: [0, PERIOD_NS, 0, 0], ..record };
        let mut receiver = Receiver::new(&[
            record(1, 0, 0, Some(1)),
            alone(record(2, 20, 1, None)),
            record(3, 22, 0, Some(1)),
        ]);
        assert_eq!(receiver.at(10, &[A, B]), Some((A, 10)));
        assert_eq!(receiver.at(20, &[B]), Some((B, 20)));
        assert_eq!(receiver.at(22, &[]), Some((B, 20)), "not what A said before it left");
        assert_eq!(receiver.at(30, &[A]), Some((A, 30)));
    }

    #[test]
    fn a_restored_buffer_is_the_same_buffer() {
        let mut receiver = Receiver::new(&[record(1, 0, 0, Some(1)), record(2, 20, 1, Some(0))]);
        receiver.at(10, &[A, B]);
        receiver.at(20, &[A]);
        let mut other = CommandBuffer::new();
        other.restore(&receiver.commands.memory());
        assert_eq!(other, receiver.commands);
    }
}
