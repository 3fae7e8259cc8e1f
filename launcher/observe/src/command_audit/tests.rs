//! The audit against flights written by hand.

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

/// Seat 0 commands from 0 ms on, seat 1 from 20 ms on; both always publish. The first tick has no command, as in a
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
fn the_owner_of_the_epoch_commands_until_the_next_owners_first_command() {
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
    assert_eq!(wrong(&[applied(15, 9, (0, 2), false)]), 1, "an epoch that was never announced");
}

#[test]
fn what_a_fallback_published_before_it_became_the_owner_is_not_its_to_give() {
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
    assert_eq!(audit.tally().wrong_owner, 0, "it had been followed as the fallback");
}

#[test]
fn what_was_in_effect_at_two_flips_before_any_command_is_still_carried() {
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
        // As the recorder takes them: the ticks, then the commands, then which seats may command.
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
fn a_tick_by_a_command_that_a_new_writer_gave_before_it_was_read_is_not_judged() {
    let mut audit = flip();
    let mut first = command(1, 9, 80);
    first.header.generation = 1;
    audit.command(&first);
    for (at_ms, sequence) in [(75, 8), (81, 9), (82, 10)] {
        audit.applied(&applied(at_ms, 2, (1, sequence), false));
    }
    let expected = CommandTally { ticks: 3, wrong_owner: 1, ..CommandTally::default() };
    assert_eq!(audit.tally(), expected);
    // The plant follows no shadow, whatever of it was lost.
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
fn a_tick_of_an_epoch_that_was_over_when_the_recorder_came_is_not_judged() {
    let mut audit = CommandAudit::default();
    for (seat, sequence, from_ms) in [(1, 5, 0), (0, 7, 20), (1, 6, 20)] {
        audit.command(&command(seat, sequence, from_ms));
    }
    audit.record(&record(4, 10, 0, NO_SEAT));
    audit.applied(&applied(5, 3, (1, 5), false));
    audit.applied(&applied(12, 4, (1, 5), false));
    audit.applied(&applied(25, 4, (0, 7), false));
    let good = CommandTally { ticks: 2, ..CommandTally::default() };
    assert_eq!(audit.tally(), good, "the first is left out, the next carried over from it");
    audit.applied(&applied(26, 4, (1, 6), false));
    assert_eq!(audit.tally().wrong_owner, 1);
}

#[test]
fn a_command_from_before_the_recorder_came_is_no_later_one_of_its_number() {
    let mut audit = CommandAudit::default();
    audit.record(&record(4, 2_900, 1, NO_SEAT));
    for at_ms in [3_264, 3_281] {
        audit.applied(&applied(at_ms, 4, (1, 126), false));
    }
    // Another process on the same seat has counted as far.
    audit.command(&command(1, 126, 5_000));
    audit.applied(&applied(5_001, 4, (1, 126), false));
    let expected = CommandTally { ticks: 1, ..CommandTally::default() };
    assert_eq!(audit.tally(), expected);
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
