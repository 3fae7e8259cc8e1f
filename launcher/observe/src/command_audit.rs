//! Who moved the rotors in each tick of the plant, checked against the owner records by one who only
//! watches: it shares no code with the protocol.

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

/// A record, as far as it says who may command.
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

/// What the plant said of a tick.
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
    /// By seat and sequence; whoever follows on a seat may count as the one before did.
    commands: BTreeMap<(u32, u64), Vec<Life>>,
    /// By seat and generation, sequence of the last command that has arrived.
    last_of: BTreeMap<(u32, u32), u64>,
    gaps: Vec<Gap>,
    waiting: VecDeque<Tick>,
    /// Whose commands counted in the epoch before, and in the one of the last tick.
    before: Option<(u64, u32)>,
    now: Option<(u64, u32)>,
    last_ns: Option<u64>,
    /// The last command that counted, as long as one is in effect, and until when it is valid \[ns\].
    counted: Option<((u32, u64), u64)>,
    /// The first tick, if it had a command already: a launcher that takes over has not heard that one \[ns\].
    joined_ns: Option<u64>,
    /// Newest instant at which a command that has arrived begins to count \[ns\].
    heard_ns: u64,
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
        self.heard_ns = self.heard_ns.max(from_ns);
        let key = (command.header.seat, command.header.sequence);
        self.commands.entry(key).or_default().push(Life { from_ns, until_ns });
        let Header { seat, sequence, generation, .. } = command.header;
        // Whoever takes a seat in flight may count from anywhere: of it, any before the first that arrived may be lost.
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

    /// Forgets the ticks so far, and not who may command.
    pub(super) fn anew(self) -> Self {
        Self { waiting: VecDeque::new(), tally: CommandTally::default(), ..self }
    }

    /// What is settled of a recording that was cut, whose topics end at different instants.
    pub(super) fn settled(&self) -> CommandTally {
        let newest_ns = self.waiting.back().map_or(0, |tick| tick.at_ns);
        let settled_ns = newest_ns.saturating_sub(CUT_NS).min(self.heard_ns);
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
    fn is_of_a_lost_command(&self, tick: &Tick, obeyed: u32) -> bool {
        let (seat, sequence) = tick.command;
        let is_in = |gap: &Gap| {
            gap.seat == seat
                && (gap.first..=gap.last).contains(&sequence)
                && tick.at_ns <= gap.until_ns.saturating_add(CARRIED_NS)
        };
        let is_from_before =
            || self.joined_ns.is_some_and(|ns| tick.at_ns < ns.saturating_add(CARRIED_NS));
        tick.mode == GateMode::Normal
            && !self.commands.contains_key(&tick.command)
            && (self.may_command(seat, obeyed) && self.gaps.iter().any(is_in) || is_from_before())
    }

    /// True if a seat could be obeyed in this tick, now or since before, as far as it is known who may be.
    fn may_command(&self, seat: u32, obeyed: u32) -> bool {
        let counted = self.counted.map(|((seat, _), _)| seat);
        let before = [self.now, self.before].map(|epoch| epoch.map(|(_, obeyed)| obeyed));
        [seat, NO_SEAT].contains(&obeyed) || counted == Some(seat) || before.contains(&Some(seat))
    }

    fn judge(&mut self, tick: &Tick) {
        if self.last_ns.is_none() && tick.command.1 > 0 {
            self.joined_ns = Some(tick.at_ns);
        }
        let record = self.epochs.get(&tick.epoch).copied();
        let of = |record: Epoch| if tick.failed_over { record.fallback } else { record.owner };
        let obeyed = record.map_or(NO_SEAT, of);
        let is_lost = self.is_of_a_lost_command(tick, obeyed);
        self.tally.ticks += u64::from(!is_lost);
        if self.last_ns.is_some_and(|last_ns| tick.at_ns <= last_ns) {
            self.tally.duplicated += 1;
        }
        let counted = self.counted.take();
        // A tick tells of the stretch that ends with it, within which a command may run out.
        let began_ns = self.last_ns.replace(tick.at_ns).unwrap_or(tick.at_ns);
        if self.now.is_none_or(|(epoch, _)| epoch != tick.epoch) {
            self.before = self.now;
        }
        self.now = Some((tick.epoch, obeyed));
        if tick.mode != GateMode::Normal {
            self.tally.missed += 1;
            return;
        }
        let (seat, sequence) = tick.command;
        // Before the first command the plant hovers by itself, within the gate's patience; where
        // nobody says who may command, everybody may.
        if sequence == 0 || self.epochs.is_empty() || is_lost {
            self.counted = counted;
            return;
        }
        let mut lives = self.commands.get(&tick.command).into_iter().flatten();
        let counts = lives.find(|life| {
            // What was in effect at a flip stays so while it is valid, until the new owner speaks, and beyond the next
            // flip if that comes first.
            let carried = || {
                let is_from_before = record.is_some_and(|record| life.from_ns < record.from_ns);
                is_from_before && self.before.is_some_and(|(_, obeyed)| obeyed == seat)
                    || counted.is_some_and(|(command, _)| command == tick.command)
            };
            // What a fallback said before it was made the owner counts if it was obeyed already, or nothing else did.
            let was_asked = || {
                tick.failed_over
                    || record.is_none_or(|record| life.from_ns >= record.from_ns)
                    || self.before.is_none_or(|(_, obeyed)| obeyed == seat)
                    || counted.is_none_or(|(_, until_ns)| until_ns <= tick.at_ns)
            };
            let its_own = seat == obeyed && was_asked() || carried();
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
mod tests {
    use super::*;
    use shared_types::Flag;

    const MS: u64 = 1_000_000;

    fn record(epoch: u64, at_ms: u64, owner: u32, fallback: u32) -> OwnerRecord {
        let header = Header { valid_ns: at_ms * MS, ..Header::default() };
        OwnerRecord { header, epoch, owner, fallback, slot: Role::Attitude, ..Default::default() }
    }

    fn command(seat: u32, sequence: u64, from_ms: u64) -> WrenchCommand {
        let header = Header { seat, sequence, valid_ns: from_ms * MS, ..Header::default() };
        WrenchCommand { header, validity_ns: 20 * MS, ..WrenchCommand::default() }
    }

    fn applied(at_ms: u64, epoch: u64, command: (u32, u64), failed_over: bool) -> AppliedCommand {
        AppliedCommand {
            header: Header { release_ns: at_ms * MS, ..Header::default() },
            epoch,
            command_seat: command.0,
            command_sequence: command.1,
            failed_over: Flag::from(failed_over),
            ..AppliedCommand::default()
        }
    }

    /// Seat 0 commands from 0 ms on, seat 1 from 20 ms on; both always speak. The first tick has no command, as in a
    /// flight.
    fn flip() -> CommandAudit {
        let mut audit = CommandAudit::default();
        audit.applied(&applied(0, 1, (NO_SEAT, 0), false));
        // Topics are drained one after the other, so records may come last.
        for (seat, sequence) in [(0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3)] {
            audit.command(&command(seat, sequence, 10 * (sequence - 1)));
        }
        audit.record(&record(1, 0, 0, NO_SEAT));
        audit.record(&record(2, 20, 1, 0));
        audit
    }

    fn wrong(ticks: &[AppliedCommand]) -> u64 {
        let mut audit = flip();
        for tick in ticks {
            audit.applied(tick);
        }
        assert_eq!(audit.tally().ticks, 1 + ticks.len() as u64);
        audit.tally().wrong_owner
    }

    #[test]
    fn the_owner_of_the_epoch_commands_and_its_last_word_lasts_until_the_next_ones_first() {
        let good = [applied(15, 1, (0, 2), false), applied(20, 2, (1, 3), false)];
        assert_eq!(wrong(&good), 0);
        assert_eq!(wrong(&[good[0], applied(21, 2, (0, 2), false)]), 0, "carried over");
        assert_eq!(wrong(&[good[0], applied(21, 2, (0, 3), false)]), 1, "given after the flip");
        assert_eq!(wrong(&[applied(15, 1, (1, 2), false)]), 1, "a shadow's");
        assert_eq!(wrong(&[applied(15, 1, (0, 3), false)]), 1, "before its time");
        let ends = [applied(30, 1, (0, 2), false), applied(35, 1, (0, 2), false)];
        assert_eq!(wrong(&ends), 1, "after its time");
        assert_eq!(wrong(&[applied(15, 1, (0, 9), false)]), 1, "never said");
        assert_eq!(wrong(&[applied(25, 2, (0, 3), true)]), 0, "the fallback took over");
        assert_eq!(wrong(&[applied(15, 9, (0, 2), false)]), 1, "an epoch that nobody announced");
    }

    #[test]
    fn what_a_fallback_said_before_it_became_the_owner_is_not_its_to_give() {
        let mut audit = flip();
        audit.record(&record(3, 25, 0, 1));
        audit.applied(&applied(21, 2, (1, 3), false));
        audit.applied(&applied(26, 3, (0, 3), false));
        audit.applied(&applied(27, 3, (0, 3), false));
        assert_eq!(audit.tally().wrong_owner, 2);
        let mut audit = flip();
        audit.record(&record(3, 25, 0, 1));
        audit.applied(&applied(21, 2, (0, 3), true));
        audit.applied(&applied(26, 3, (0, 3), false));
        assert_eq!(audit.tally().wrong_owner, 0, "it had been obeyed as the fallback");
    }

    #[test]
    fn what_was_in_effect_at_two_flips_before_anybody_spoke_is_still_carried() {
        let mut audit = CommandAudit::default();
        audit.applied(&applied(0, 1, (NO_SEAT, 0), false));
        for (epoch, at_ms, owner, fallback) in [(1, 0, 0, 1), (2, 15, 0, 1), (3, 20, 1, NO_SEAT)] {
            audit.record(&record(epoch, at_ms, owner, fallback));
        }
        audit.command(&command(1, 2, 10));
        for (at_ms, epoch, failed_over) in [(11, 1, true), (16, 2, false), (21, 3, false)] {
            audit.applied(&applied(at_ms, epoch, (1, 2), failed_over));
        }
        let expected = CommandTally { ticks: 4, ..CommandTally::default() };
        assert_eq!(audit.tally(), expected);
    }

    #[test]
    fn a_command_that_runs_out_within_a_tick_has_had_its_part_of_it() {
        let audit = |until_us: u64| {
            let mut audit = CommandAudit::default();
            audit.record(&record(1, 0, 0, NO_SEAT));
            let mut command = command(0, 1, 10);
            command.validity_ns = until_us * 1000 - command.header.valid_ns;
            audit.command(&command);
            audit.applied(&applied(11, 1, (0, 1), false));
            audit.applied(&applied(12, 1, (0, 1), false));
            audit.tally().wrong_owner
        };
        assert_eq!([12_000, 11_700, 11_000].map(audit), [0, 0, 1]);
    }

    #[test]
    fn a_tick_without_a_command_is_missed_and_one_with_two_is_duplicated() {
        let mut audit = flip();
        audit.applied(&applied(10, 1, (0, 2), false));
        audit.applied(&applied(10, 1, (0, 2), false));
        let mode = GateMode::Hold;
        audit.applied(&AppliedCommand { mode, ..applied(40, 1, (0, 2), false) });
        let expected = CommandTally { ticks: 4, missed: 1, duplicated: 1, wrong_owner: 0 };
        assert_eq!(audit.tally(), expected);
    }

    #[test]
    fn ticks_are_judged_as_they_settle_and_old_commands_forgotten() {
        let mut audit = CommandAudit::default();
        audit.record(&record(1, 0, 0, NO_SEAT));
        for at_ms in 0..20_000 {
            if at_ms % 10 == 0 {
                audit.command(&command(0, at_ms / 10 + 1, at_ms));
            }
            audit.applied(&applied(at_ms, 1, (0, at_ms / 10 + 1), false));
        }
        assert_eq!(audit.waiting.len(), SETTLED_TICKS);
        assert!(audit.commands.len() < 620, "{}", audit.commands.len());
        assert_eq!(audit.tally(), CommandTally { ticks: 20_000, ..CommandTally::default() });
    }

    #[test]
    fn a_recorder_that_was_kept_from_its_topics_for_two_seconds_finds_nothing_wrong() {
        let mut audit = CommandAudit::default();
        for begin_ms in [0, 2_000, 4_000, 6_000, 8_000] {
            // As the recorder takes them: the ticks, then the commands, then who may command.
            for at_ms in begin_ms..begin_ms + 2_000 {
                audit.applied(&applied(at_ms, 1, (0, at_ms / 10 + 1), false));
            }
            for at_ms in (begin_ms..begin_ms + 2_000).step_by(10) {
                audit.command(&command(0, at_ms / 10 + 1, at_ms));
            }
            audit.record(&record(1, 0, 0, NO_SEAT));
        }
        assert_eq!(audit.tally(), CommandTally { ticks: 10_000, ..CommandTally::default() });
    }

    #[test]
    fn a_tick_whose_command_the_recorder_lost_is_not_judged() {
        let mut audit = flip();
        audit.record(&record(2, 20, 1, 0));
        audit.command(&command(1, 9, 80));
        for (at_ms, sequence) in [(25, 3), (45, 5), (75, 8), (81, 9), (82, 10)] {
            audit.applied(&applied(at_ms, 2, (1, sequence), false));
        }
        let expected = CommandTally { ticks: 4, wrong_owner: 1, ..CommandTally::default() };
        assert_eq!(audit.tally(), expected);
    }

    #[test]
    fn a_tick_by_a_command_that_a_new_writer_gave_before_it_was_heard_is_not_judged() {
        let mut audit = flip();
        let mut first = command(1, 9, 80);
        first.header.generation = 1;
        audit.command(&first);
        for (at_ms, sequence) in [(75, 8), (81, 9), (82, 10)] {
            audit.applied(&applied(at_ms, 2, (1, sequence), false));
        }
        let expected = CommandTally { ticks: 3, wrong_owner: 1, ..CommandTally::default() };
        assert_eq!(audit.tally(), expected);
        // Nobody obeys a shadow, whatever of it was lost.
        let mut audit = flip();
        let mut shadow = command(2, 9, 80);
        shadow.header.generation = 1;
        audit.command(&shadow);
        audit.applied(&applied(21, 2, (1, 3), false));
        audit.applied(&applied(75, 2, (2, 8), false));
        let expected = CommandTally { ticks: 3, wrong_owner: 1, ..CommandTally::default() };
        assert_eq!(audit.tally(), expected);
    }

    #[test]
    fn a_command_from_before_the_recorder_came_is_not_judged() {
        let mut audit = CommandAudit::default();
        audit.record(&record(4, 2_900, 1, NO_SEAT));
        for at_ms in [3_264, 3_281, 4_263, 4_264] {
            audit.applied(&applied(at_ms, 4, (1, 126), false));
        }
        let expected = CommandTally { ticks: 1, wrong_owner: 1, ..CommandTally::default() };
        assert_eq!(audit.tally(), expected, "it cannot be in effect for a second");
    }

    #[test]
    fn a_tick_whose_command_was_cut_off_is_not_settled() {
        let mut audit = flip();
        for at_ms in (15..=40).chain([1_040]) {
            audit.applied(&applied(at_ms, 2, (1, 9), false));
        }
        let of = |tally: CommandTally| (tally.ticks, tally.wrong_owner);
        // The last command that has arrived begins to count at 20 ms: later ones may be what is missing.
        assert_eq!((of(audit.settled()), of(audit.tally())), ((6, 5), (28, 27)));
        audit.command(&command(0, 4, 1_040));
        assert_eq!((of(audit.settled()), of(audit.tally())), ((26, 25), (28, 27)));
    }

    #[test]
    fn a_successor_on_the_same_seat_may_count_as_the_one_before_it() {
        let mut audit = flip();
        audit.applied(&applied(15, 1, (0, 2), false));
        audit.command(&command(0, 2, 600));
        assert_eq!(audit.tally().wrong_owner, 0);
    }
}
