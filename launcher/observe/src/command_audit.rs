//! Which seat moved the rotors in each tick of the plant, checked against the owner records by one that
//! only watches: it shares no code with the protocol.

use runtime::ipc::RECORDER_CAPACITY;
use serde::Serialize;
use shared_types::{AppliedCommand, GateMode, Header, NO_SEAT, OwnerRecord, Role, WrenchCommand};
use std::collections::{BTreeMap, VecDeque};

/// Ticks after which everything about a tick has arrived. The recorder takes one topic after the other, the ticks
/// before the commands, and at once no more of a topic than its reader keeps.
const SETTLED_TICKS: usize = 2 * RECORDER_CAPACITY;
/// How long a command that has run out may still be asked for, around the tick in which it did \[ns\].
const CARRIED_NS: u64 = 1_000_000_000;
/// What may still be on its way to a recording that is cut off \[ns\].
const CUT_NS: u64 = 1_000_000_000;

/// What the ticks of a flight came to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct CommandTally {
    /// Ticks of the plant that were judged.
    pub ticks: u64,
    /// Ticks in which no valid command was in effect.
    pub missed: u64,
    /// Ticks in which more than one command was applied.
    pub duplicated: u64,
    /// Ticks in which a command was applied that was not its writer's to give, or not for then.
    pub wrong_owner: u64,
}

/// A record, as far as it states which seat may command.
#[derive(Debug, Clone, Copy)]
struct Epoch {
    from_ns: u64,
    owner: u32,
    fallback: u32,
}

/// When a command counts.
#[derive(Debug, Clone, Copy)]
struct Life {
    from_ns: u64,
    until_ns: u64,
}

/// What the plant published about a tick.
#[derive(Debug, Clone, Copy)]
struct Tick {
    at_ns: u64,
    mode: GateMode,
    epoch: u64,
    failed_over: bool,
    /// Writer and sequence of the command in effect.
    command: (u32, u64),
}

/// Commands that a writer has numbered and that never arrived here.
#[derive(Debug, Clone, Copy)]
struct Gap {
    seat: u32,
    first: u64,
    last: u64,
    /// When the next one that arrived begins to count \[ns\].
    until_ns: u64,
}

/// Judges every tick once everything about it is known.
#[derive(Debug, Clone, Default)]
pub(super) struct CommandAudit {
    epochs: BTreeMap<u64, Epoch>,
    /// By seat and sequence; a controller that follows on a seat may count as the one before did.
    commands: BTreeMap<(u32, u64), Vec<Life>>,
    /// By seat and generation, sequence of the last command that has arrived.
    last_of: BTreeMap<(u32, u32), u64>,
    gaps: Vec<Gap>,
    waiting: VecDeque<Tick>,
    /// The seat whose commands counted in the epoch before, and in the one of the last tick.
    before: Option<(u64, u32)>,
    now: Option<(u64, u32)>,
    last_ns: Option<u64>,
    /// The last command that counted, as long as one is in effect, and until when it is valid \[ns\].
    counted: Option<((u32, u64), u64)>,
    /// The first tick, if it had a command already: a launcher that takes over has not received that one \[ns\].
    joined_ns: Option<u64>,
    /// Newest instant at which a command that has arrived begins to count \[ns\].
    received_ns: u64,
    tally: CommandTally,
}

impl CommandAudit {
    pub(super) fn record(&mut self, record: &OwnerRecord) {
        if record.slot == Role::Attitude {
            let (owner, fallback) = (record.owner, record.fallback);
            let epoch = Epoch { from_ns: record.header.valid_ns, owner, fallback };
            self.epochs.insert(record.epoch, epoch);
        }
    }

    pub(super) fn command(&mut self, command: &WrenchCommand) {
        let from_ns = command.header.valid_ns;
        let until_ns = from_ns.saturating_add(command.validity_ns);
        self.received_ns = self.received_ns.max(from_ns);
        let key = (command.header.seat, command.header.sequence);
        self.commands.entry(key).or_default().push(Life { from_ns, until_ns });
        let Header { seat, sequence, generation, .. } = command.header;
        // A controller that takes a seat in flight may count from anywhere: of it, any before the first that arrived
        // may be lost.
        let before = self.last_of.insert((seat, generation), sequence);
        let first = before.map_or(0, |last| last.saturating_add(1));
        if first < sequence {
            self.gaps.push(Gap { seat, first, last: sequence - 1, until_ns: from_ns });
        }
    }

    pub(super) fn applied(&mut self, applied: &AppliedCommand) {
        self.waiting.push_back(Tick {
            at_ns: applied.header.release_ns,
            mode: applied.mode,
            epoch: applied.epoch,
            failed_over: applied.failed_over.is_set(),
            command: (applied.command_seat, applied.command_sequence),
        });
        while self.waiting.len() > SETTLED_TICKS {
            let Some(tick) = self.waiting.pop_front() else { return };
            self.judge(&tick);
            if self.tally.ticks.is_multiple_of(1024) {
                self.forget(tick.at_ns);
            }
        }
    }

    /// Forgets the ticks so far, and not which seats may command.
    pub(super) fn anew(self) -> Self {
        Self { waiting: VecDeque::new(), tally: CommandTally::default(), ..self }
    }

    /// What is settled of a recording that was cut, whose topics end at different instants.
    pub(super) fn settled(&self) -> CommandTally {
        let newest_ns = self.waiting.back().map_or(0, |tick| tick.at_ns);
        let settled_ns = newest_ns.saturating_sub(CUT_NS).min(self.received_ns);
        let mut rest = self.clone();
        while let Some(tick) = rest.waiting.pop_front().filter(|tick| tick.at_ns < settled_ns) {
            rest.judge(&tick);
        }
        rest.tally
    }

    /// Everything judged so far and, at the end of a flight, what was still waiting.
    pub(super) fn tally(&self) -> CommandTally {
        let mut rest = self.clone();
        while let Some(tick) = rest.waiting.pop_front() {
            rest.judge(&tick);
        }
        rest.tally
    }

    /// True if the recorder, which was kept from its topics for too long or has just come, never had the command in
    /// effect.
    fn is_of_a_lost_command(&self, tick: &Tick, followed: u32) -> bool {
        let (seat, sequence) = tick.command;
        let is_in = |gap: &Gap| {
            gap.seat == seat
                && (gap.first..=gap.last).contains(&sequence)
                && tick.at_ns <= gap.until_ns.saturating_add(CARRIED_NS)
        };
        let is_from_before =
            || self.joined_ns.is_some_and(|ns| tick.at_ns < ns.saturating_add(CARRIED_NS));
        tick.mode == GateMode::Normal
            && !self.has_received(tick)
            && (self.may_command(seat, followed) && self.gaps.iter().any(is_in) || is_from_before())
    }

    /// True of a tick from before a launcher took over, in an epoch that was over by then: of its records that one has
    /// received the last alone.
    fn is_of_an_epoch_before(&self, tick: &Tick) -> bool {
        let first_known = self.epochs.keys().next();
        self.joined_ns.is_some()
            && tick.mode == GateMode::Normal
            && tick.epoch > 0
            && first_known.is_some_and(|first| tick.epoch < *first)
    }

    /// True if a command of that writer and sequence could be in effect in this tick. A process that takes the seat later
    /// comes to the same numbers, and ticks are judged when it may have.
    fn has_received(&self, tick: &Tick) -> bool {
        let mut lives = self.commands.get(&tick.command).into_iter().flatten();
        lives.any(|life| life.from_ns <= tick.at_ns)
    }

    /// True if a seat could be followed in this tick, now or since before, as far as it is known which may be.
    fn may_command(&self, seat: u32, followed: u32) -> bool {
        let counted = self.counted.map(|((seat, _), _)| seat);
        let before = [self.now, self.before].map(|epoch| epoch.map(|(_, followed)| followed));
        [seat, NO_SEAT].contains(&followed) || counted == Some(seat) || before.contains(&Some(seat))
    }

    fn judge(&mut self, tick: &Tick) {
        if self.last_ns.is_none() && tick.command.1 > 0 {
            self.joined_ns = Some(tick.at_ns);
        }
        let record = self.epochs.get(&tick.epoch).copied();
        let of = |record: Epoch| if tick.failed_over { record.fallback } else { record.owner };
        let is_unknown = self.is_of_an_epoch_before(tick);
        let followed = record.map_or(if is_unknown { tick.command.0 } else { NO_SEAT }, of);
        let is_lost = is_unknown || self.is_of_a_lost_command(tick, followed);
        self.tally.ticks += u64::from(!is_lost);
        if self.last_ns.is_some_and(|last_ns| tick.at_ns <= last_ns) {
            self.tally.duplicated += 1;
        }
        let counted = self.counted.take();
        // A tick is about the stretch that ends with it, within which a command may run out.
        let began_ns = self.last_ns.replace(tick.at_ns).unwrap_or(tick.at_ns);
        if self.now.is_none_or(|(epoch, _)| epoch != tick.epoch) {
            self.before = self.now;
        }
        self.now = Some((tick.epoch, followed));
        if tick.mode != GateMode::Normal {
            self.tally.missed += 1;
            return;
        }
        let (seat, sequence) = tick.command;
        // Before the first command the plant hovers by itself, within the gate's patience; where no
        // record states which seat may command, every seat may.
        if sequence == 0 || self.epochs.is_empty() || is_lost {
            self.counted = counted;
            return;
        }
        let mut lives = self.commands.get(&tick.command).into_iter().flatten();
        let counts = lives.find(|life| {
            // What was in effect at a flip stays so while it is valid, until the new owner publishes, and beyond the
            // next flip if that comes first.
            let carried = || {
                let is_from_before = record.is_some_and(|record| life.from_ns < record.from_ns);
                is_from_before && self.before.is_some_and(|(_, followed)| followed == seat)
                    || counted.is_some_and(|(command, _)| command == tick.command)
            };
            // What a fallback published before it was made the owner counts if it was followed already, or nothing else
            // did.
            let was_asked = || {
                tick.failed_over
                    || record.is_none_or(|record| life.from_ns >= record.from_ns)
                    || self.before.is_none_or(|(_, followed)| followed == seat)
                    || counted.is_none_or(|(_, until_ns)| until_ns <= tick.at_ns)
            };
            let its_own = seat == followed && was_asked() || carried();
            let lasted = tick.at_ns <= life.until_ns || began_ns < life.until_ns;
            its_own && life.from_ns <= tick.at_ns && lasted
        });
        self.counted = counts.map(|life| (tick.command, life.until_ns)).or(counted);
        self.tally.wrong_owner += u64::from(counts.is_none());
    }

    /// Drops commands that nothing can descend from any more.
    fn forget(&mut self, now_ns: u64) {
        self.commands.retain(|_, lives| {
            lives.retain(|life| life.until_ns.saturating_add(CARRIED_NS) > now_ns);
            !lives.is_empty()
        });
        self.gaps.retain(|gap| gap.until_ns.saturating_add(CARRIED_NS) > now_ns);
    }
}

#[cfg(test)]
mod tests;
