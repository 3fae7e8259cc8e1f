//! Instructions per tick, counted by valgrind's callgrind: a number that no other load changes.
//!
//! The bench runs itself once more under callgrind, which counts only inside [`counted_run`] and
//! writes out what it has whenever [`counted_until_here`] is entered. Callgrind emulates vectors
//! of up to 256 bits, so a wider path is not what is counted.

use core::hint::black_box;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::contenders::{Contender, Entry, Verdict};
use crate::series::{Group, Series, Tick};

/// A group with more ticks is counted on its leading series.
const MAX_TICKS: usize = 500;

#[inline(never)]
fn counted_run(contender: &mut dyn Contender, tick: &Tick) -> Verdict {
    contender.run(tick)
}

#[inline(never)]
fn counted_until_here(number: usize) -> usize {
    black_box(number)
}

/// The series that are counted, at least one.
fn sample(group: &Group) -> &[Series] {
    let mut ticks = 0;
    let beyond = group.series.iter().position(|series| {
        ticks += series.ticks.len();
        ticks > MAX_TICKS
    });
    &group.series[..beyond.unwrap_or(group.series.len()).max(1)]
}

/// The part of the child: one replay by each solver on each group.
pub(crate) fn replay(groups: &[Group], entries: &[Entry]) {
    let mut number = 0;
    for group in groups {
        for (_, make) in entries {
            for series in sample(group) {
                let mut contender = make(series);
                contender.rewind(series);
                for (k, tick) in series.ticks.iter().enumerate() {
                    contender.load(series, k);
                    black_box(counted_run(contender.as_mut(), tick));
                }
            }
            number = counted_until_here(number + 1);
        }
    }
}

/// Instructions per tick by group and solver, or why there are none.
pub(crate) fn instructions(
    groups: &[Group],
    entries: &[Entry],
    arguments: &[String],
) -> Result<Vec<Vec<u64>>, String> {
    let folder = tempfile::tempdir().map_err(|error| format!("no folder for counts: {error}"))?;
    let bench =
        std::env::current_exe().map_err(|error| format!("no path to this bench: {error}"))?;
    let out = folder.path().join("count");
    let status = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no", "--toggle-collect=*counted_run*"])
        .arg("--dump-before=*counted_until_here*")
        .arg(format!("--callgrind-out-file={}", out.display()))
        .arg(bench)
        .args(arguments)
        .arg("--counted")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .map_err(|error| format!("valgrind does not start ({error}); install it for counts"))?;
    if !status.success() {
        return Err(format!("the counted run ended with {status}"));
    }
    let mut dump = 0;
    let mut counts = Vec::new();
    for group in groups {
        let ticks: usize = sample(group).iter().map(|series| series.ticks.len()).sum();
        let mut row = Vec::new();
        for _ in entries {
            dump += 1;
            row.push(total(&out.with_extension(dump.to_string()))? / ticks as u64);
        }
        counts.push(row);
    }
    Ok(counts)
}

/// The total of one dump.
fn total(path: &Path) -> Result<u64, String> {
    let text =
        std::fs::read_to_string(path).map_err(|error| format!("a count is missing: {error}"))?;
    let totals = text.lines().find_map(|line| line.strip_prefix("totals:"));
    let number = totals.and_then(|totals| totals.split_whitespace().next()?.parse().ok());
    number.ok_or_else(|| "a dump of callgrind has no totals".to_owned())
}
