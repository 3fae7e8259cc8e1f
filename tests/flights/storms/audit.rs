//! What a storm must not have done, by the recording alone: this shares no code with what flew, recorded or judged it.

#![expect(clippy::float_cmp, reason = "whole numbers, as they were written")]
#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use crate::common::distance;
use crate::common::recording::{Recording, Row};
use std::collections::{BTreeMap, BTreeSet};

/// From the reference \[m\], above the ground \[m\], and of the body's vertical from the world's \[°\].
const EXCURSION_MAX_M: f64 = 0.5;
const HEIGHT_MIN_M: f64 = 0.1;
const TILT_MAX_DEG: f64 = 60.0;
/// Of a time in seconds, as it comes from nanoseconds.
const EPSILON_S: f64 = 1e-9;
/// Longest that a command may be in effect \[s\].
const CARRIED_S: f64 = 1.0;
/// The gate's mode in which a command is in effect.
const NORMAL: f64 = 0.0;

/// The seats that may command from an instant on.
struct Record {
    from_s: f64,
    owner: f64,
    fallback: f64,
}

/// A command's validity \[s\].
struct Command {
    from_s: f64,
    until_s: f64,
}

/// What is needed of a recording, read once.
struct Flight {
    truth: Vec<Row>,
    reference: Vec<Row>,
    records: Vec<Row>,
    commands: Vec<Row>,
    ticks: Vec<Row>,
    set_points: Vec<Row>,
    /// The writers of the samples that other loops publish.
    others: [(&'static str, Vec<Row>); 3],
}

/// The first fields that are read of each topic: the writer and number of a sample.
const WRITER: [&str; 3] = ["header.seat", "header.generation", "header.sequence"];

/// Everything that is wrong with a recorded flight; none of it may be.
pub(super) fn findings(recording: &Recording) -> Vec<String> {
    let command = [&WRITER[..], &["validity_ns"]].concat();
    let tick = ["mode", "command_seat", "command_sequence", "failed_over", "header.release_ns"];
    let tick = [&tick[..], &["refused_epoch"]].concat();
    let tick = [&WRITER[..], &tick].concat();
    let [truth, reference, records, commands, ticks, set_points, imu, estimates, asked] = recording
        .several([
            ("truth", &["position_w_m", "q_wb"]),
            ("reference", &["spacing_ns", "count", "points"]),
            ("attitude_owner", &["epoch", "owner", "fallback"]),
            ("wrench_command", &command),
            ("applied_command", &tick),
            ("applied_setpoint", &WRITER),
            ("imu", &WRITER),
            ("state_estimate", &WRITER),
            ("attitude_setpoint", &WRITER),
        ]);
    let others = [("imu", imu), ("state_estimate", estimates), ("attitude_setpoint", asked)];
    let flight = Flight { truth, reference, records, commands, ticks, set_points, others };
    let mut findings = moved_as_it_should(&flight);
    findings.extend(commanded_by_owners(&flight));
    findings.extend(complete(&flight));
    findings
}

/// Where a reference has the vehicle be at an instant \[m\]: on a line between its points, and at the last one from then on. A
/// pilot that has died is followed by its last sample.
fn wanted_m(reference: &Row, t_s: f64) -> [f64; 3] {
    const VALUES_OF_A_POINT: usize = 7;
    let [spacing_ns, count, points @ ..] = &reference.values[..] else { panic!("{reference:?}") };
    let spacings = (t_s - reference.t_s).max(0.0) / (spacing_ns * 1e-9);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small counts")]
    let (index, last) = (spacings as usize, (*count as usize).saturating_sub(1));
    let point = |index: usize| &points[VALUES_OF_A_POINT * index.min(last)..][..3];
    let (from, to) = (point(index), point(index + 1));
    core::array::from_fn(|i| from[i] + (to[i] - from[i]) * (spacings - index as f64))
}

fn moved_as_it_should(flight: &Flight) -> Vec<String> {
    let mut references = flight.reference.iter().peekable();
    let mut wanted: Option<&Row> = None;
    let (mut farthest, mut lowest, mut tilt) = ((0.0, 0.0), (f64::INFINITY, 0.0), (0.0, 0.0));
    for row in &flight.truth {
        while let Some(next) = references.next_if(|next| next.t_s <= row.t_s) {
            wanted = Some(next);
        }
        let [x, y, z, _, qx, qy, _] = row.values[..] else { panic!("{row:?}") };
        if let Some(wanted) = wanted {
            let away_m = distance(&[x, y, z], &wanted_m(wanted, row.t_s));
            farthest = if away_m > farthest.0 { (away_m, row.t_s) } else { farthest };
        }
        lowest = if z < lowest.0 { (z, row.t_s) } else { lowest };
        let tilt_deg = (1.0 - 2.0 * (qx * qx + qy * qy)).clamp(-1.0, 1.0).acos().to_degrees();
        tilt = if tilt_deg > tilt.0 { (tilt_deg, row.t_s) } else { tilt };
    }
    let finding = |is_bad: bool, what: &str, (value, at_s): (f64, f64)| {
        is_bad.then(|| format!("{what} {value:.2} at {at_s:.3} s"))
    };
    [
        finding(farthest.0 > EXCURSION_MAX_M, "metres from the reference:", farthest),
        finding(lowest.0 < HEIGHT_MIN_M, "metres above the ground:", lowest),
        finding(tilt.0 > TILT_MAX_DEG, "degrees of tilt:", tilt),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Each tick with a command in effect had it from a writer that was the owner, or the fallback in its turn, by the record
/// in effect at the command's own instant.
fn commanded_by_owners(flight: &Flight) -> Vec<String> {
    // A record that reaches the plant after its instant has come counts for nothing: the next one is for a later instant.
    let refused = flight.ticks.iter().map(|tick| tick.values[8].to_bits()).collect::<BTreeSet<_>>();
    let mut records: Vec<(f64, Record)> = flight
        .records
        .iter()
        .filter(|row| !refused.contains(&row.values[0].to_bits()))
        .map(|row| {
            let [epoch, owner, fallback] = row.values[..] else { panic!("{row:?}") };
            (epoch, Record { from_s: row.t_s, owner, fallback })
        })
        .collect();
    records.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let known_from_s = records.first().map_or(f64::INFINITY, |(_, record)| record.from_s);
    let commands = commands_of(flight);
    let (mut wrong, mut first, mut before_s) = (0_u32, None, None);
    let joined_s = flight.ticks.first().filter(|tick| tick.values[5] > 0.0).map(|tick| tick.t_s);
    let mut failed_over_before = 0.0;
    // A seat that had the turn when its command came into effect keeps it for as long as that is valid: the command,
    // and from when until when it is.
    let mut in_effect: Option<([u64; 2], f64, f64)> = None;
    for row in &flight.ticks {
        let [_, _, _, mode, seat, sequence, failed_over, release_ns, _] = row.values[..] else {
            panic!("{row:?}")
        };
        let t_s = release_ns * 1e-9;
        let began_s = before_s.replace(t_s).unwrap_or(t_s);
        // A tick reports the stretch that ends with it, in which the move to the fallback may be over again.
        let fell_back = failed_over + core::mem::replace(&mut failed_over_before, failed_over);
        // Before the first command the plant hovers by itself.
        if mode != NORMAL || sequence == 0.0 {
            continue;
        }
        let key = [seat.to_bits(), sequence.to_bits()];
        // A launcher that took over has not received the command that was in effect then, or not the record by which it
        // was.
        let is_from_before = joined_s.is_some_and(|joined_s| t_s < joined_s + CARRIED_S);
        let mut candidates = commands.get(&key).into_iter().flatten();
        let is_known =
            |command: &Command| (known_from_s..=t_s + EPSILON_S).contains(&command.from_s);
        if is_from_before && !candidates.any(is_known) {
            continue;
        }
        let counts = commands.get(&key).into_iter().flatten().find(|command| {
            let then = records.iter().rev().find(|(_, record)| record.from_s <= command.from_s);
            let has_the_turn = then.is_some_and(|(_, record)| {
                record.owner == seat || record.fallback == seat && fell_back > 0.0
            });
            // A command that a fallback has published before it becomes the owner counts once nothing else does.
            let is_next = then.is_some_and(|(_, record)| record.fallback == seat)
                && in_effect.is_none_or(|(_, _, until_s)| until_s <= t_s + EPSILON_S);
            let is_carried = in_effect
                .is_some_and(|(before, from_s, _)| before == key && from_s == command.from_s);
            let is_valid = command.from_s <= t_s + EPSILON_S
                && (t_s <= command.until_s + EPSILON_S || began_s < command.until_s);
            (has_the_turn || is_next || is_carried) && is_valid
        });
        in_effect = counts.map(|command| (key, command.from_s, command.until_s)).or(in_effect);
        if counts.is_none() {
            wrong += 1;
            first.get_or_insert((t_s, seat, sequence));
        }
    }
    let finding = first.map(|(t_s, seat, sequence)| {
        format!(
            "{wrong} ticks by who did not own the slot, first {sequence} of {seat} at {t_s:.3} s"
        )
    });
    finding.into_iter().collect()
}

/// The commands by seat and sequence, to which a process that takes a seat later may come again.
fn commands_of(flight: &Flight) -> BTreeMap<[u64; 2], Vec<Command>> {
    let mut commands: BTreeMap<[u64; 2], Vec<Command>> = BTreeMap::new();
    for row in &flight.commands {
        let [seat, _, sequence, validity_ns] = row.values[..] else { panic!("{row:?}") };
        let key = [seat.to_bits(), sequence.to_bits()];
        let until_s = row.t_s + validity_ns * 1e-9;
        commands.entry(key).or_default().push(Command { from_s: row.t_s, until_s });
    }
    commands
}

/// Nothing is missing between the first and the last sample of a process, and what an attitude controller publishes in one
/// step is there as a whole, but for the step in which it was killed.
fn complete(flight: &Flight) -> Vec<String> {
    let mut findings = Vec::new();
    let (commands, set_points) = (numbers(&flight.commands), numbers(&flight.set_points));
    let own = [
        ("wrench_command", commands.clone()),
        ("applied_setpoint", set_points.clone()),
        ("applied_command", numbers(&flight.ticks)),
    ];
    let others = flight.others.iter().map(|(topic, rows)| (*topic, numbers(rows)));
    for (topic, by_process) in others.chain(own) {
        for ([seat, generation], numbers) in by_process {
            let [first, last] = [numbers.first(), numbers.last()].map(|n| n.copied().unwrap_or(0));
            let missing = last - first + 1 - numbers.len() as u64;
            if missing > 0 {
                let publisher = format!("seat {seat}, process {generation}");
                findings.push(format!("{missing} samples of {topic} are missing ({publisher})"));
            }
        }
    }
    for (process, commands) in commands {
        let last = commands.last().copied().unwrap_or(0);
        let published = set_points.get(&process).cloned().unwrap_or_default();
        // A launcher that takes over gets more of the past of one topic than of another.
        let first = published.first().copied().unwrap_or(0);
        let missing = commands.range(first..last).filter(|n| !published.contains(n)).count();
        if missing > 0 {
            findings.push(format!("{missing} applied set points of {process:?} are missing"));
        }
    }
    findings
}

/// Sequences of samples, by seat and generation.
fn numbers(rows: &[Row]) -> BTreeMap<[u64; 2], BTreeSet<u64>> {
    let mut numbers: BTreeMap<[u64; 2], BTreeSet<u64>> = BTreeMap::new();
    for row in rows {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small counts")]
        let [seat, generation, sequence] = [0, 1, 2].map(|field| row.values[field] as u64);
        numbers.entry([seat, generation]).or_default().insert(sequence);
    }
    numbers
}
