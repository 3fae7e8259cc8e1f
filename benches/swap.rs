//! What a live swap costs a realtime flight: swaps and no swaps by turns in one flight.
//!
//! `cargo bench --bench swap` flies hover with the attitude loop at 500 Hz by the wall clock. Each half
//! second begins with a null swap of the attitude slot; its first half is the window with a swap, its
//! second the one without. It prints the deadlines missed in either, and how long a flip takes after the
//! shadow window. `--speed 0.5` is for machines that cannot keep up, and is said.

use clap::Parser;
use launcher::record::read::RecordedFlight;
use serde_json::Value;
use shared_types::{AppliedCommand, Deviation, DeviationKind, Role, topics};
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};

/// Swaps in realtime.
#[derive(Debug, Parser)]
struct Options {
    /// How many.
    #[arg(long, default_value_t = 200, value_name = "N")]
    swaps: u32,
    /// Rate of the attitude loop [Hz].
    #[arg(long, default_value_t = 500.0, value_name = "HZ")]
    rate: f64,
    /// Logical seconds per wall second.
    #[arg(long, default_value_t = 1.0, value_name = "N")]
    speed: f64,
    /// Who takes over.
    #[arg(long, default_value = "attitude-mpc", value_name = "NAME")]
    to: String,
    /// What cargo passes to every bench.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Everything that can go wrong is for people to read.
type Result<T> = core::result::Result<T, Box<dyn core::error::Error>>;

/// From one swap to the next [s].
const EVERY_S: f64 = 0.5;
/// Before the first [s].
const LEAD_IN_S: f64 = 1.0;
/// Shadow window [s]; a hundred times the shortest period that a loop may have.
const SHADOW_S: f64 = 0.1;
const ROLLBACK_S: f64 = 0.03;

fn main() -> ExitCode {
    match measure(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "swap: {error}");
            ExitCode::FAILURE
        }
    }
}

fn measure(options: &Options) -> Result<()> {
    let folder = tempfile::TempDir::new()?;
    let summary = fly(options, folder.path())?;
    let path = summary["recording"].as_str().ok_or("no recording")?;
    let recorded = RecordedFlight::open(path.as_ref())?;
    let owners = owners(&recorded)?;
    // Deadlines missed by who flies and by who shadows, with a swap and without.
    let mut missed = [[0_u64; 2]; 2];
    for deviation in recorded.samples(&topics::DEVIATION)? {
        let at_s = deviation.header.release_ns as f64 * 1e-9 - LEAD_IN_S;
        if at_s < 0.0 || at_s >= EVERY_S * f64::from(options.swaps) {
            continue;
        }
        let without = usize::from(at_s.rem_euclid(EVERY_S) >= 0.5 * EVERY_S);
        let shadows = deviation.role == Role::Attitude
            // Of the number that tells lives apart: role, then seat.
            && deviation.header.seat / 8 % 4 != owner_at(&owners, deviation.header.release_ns);
        missed[usize::from(shadows)][without] += count(&deviation);
    }
    print(options, &summary, &missed)
}

fn fly(options: &Options, folder: &Path) -> Result<Value> {
    let seconds = LEAD_IN_S + EVERY_S * f64::from(options.swaps) + 1.0;
    let mut command = Command::new(env!("CARGO_BIN_EXE_morphquad"));
    command.args(["run", "hover", "--clock", "realtime", "--format", "json"]);
    command.args(["--rate", &format!("attitude-mpc={}", options.rate)]);
    command.args(["--speed", &options.speed.to_string(), "--for", &format!("{seconds}s")]);
    command.arg("--record").arg(folder);
    for k in 0..options.swaps {
        let at_s = LEAD_IN_S + EVERY_S * f64::from(k);
        let Options { to, .. } = options;
        let swap = format!("attitude={to}@{at_s}s,shadow={SHADOW_S}s,rollback={ROLLBACK_S}s");
        command.args(["--swap", &swap]);
    }
    let output = command.stdin(Stdio::null()).stderr(Stdio::inherit()).output()?;
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// Instants [ns] from which seats commanded the attitude slot.
fn owners(recorded: &RecordedFlight) -> Result<Vec<(u64, u32)>> {
    let mut owners: Vec<(u64, u32)> = Vec::new();
    for AppliedCommand { header, seat, .. } in recorded.samples(&topics::APPLIED_COMMAND)? {
        if owners.last().is_none_or(|(_, last)| *last != seat) {
            owners.push((header.release_ns, seat));
        }
    }
    Ok(owners)
}

fn owner_at(owners: &[(u64, u32)], at_ns: u64) -> u32 {
    let known = owners.iter().rev().find(|(since_ns, _)| *since_ns <= at_ns);
    known.or(owners.first()).map_or(0, |(_, seat)| *seat)
}

/// Steps without final inputs, left out or late.
fn count(deviation: &Deviation) -> u64 {
    match deviation.kind {
        DeviationKind::MissedDeadline | DeviationKind::CaughtUp => deviation.first,
        DeviationKind::SkippedReleases => deviation.last - deviation.first + 1,
        _ => 0,
    }
}

fn print(options: &Options, summary: &Value, missed: &[[u64; 2]; 2]) -> Result<()> {
    let out = &mut std::io::stdout().lock();
    let reports = summary["swaps"].as_array().ok_or("no swaps")?;
    let done: Vec<&Value> = reports.iter().filter(|report| report["done"] == true).collect();
    let half_s = 0.5 * EVERY_S * f64::from(options.swaps);
    let Options { rate, speed, .. } = options;
    writeln!(
        out,
        "attitude loop at {rate} Hz, {speed} logical seconds per wall second; {} of {} swaps done",
        done.len(),
        options.swaps
    )?;
    for report in reports.iter().filter(|report| report["done"] != true) {
        writeln!(out, "  not done: {}", report["outcome"])?;
    }
    for (who, [with, without]) in ["who flies", "the shadow"].iter().zip(missed) {
        writeln!(
            out,
            "deadlines missed per second by {who}: {:.2} in windows with a swap, {:.2} without ({with} and {without})",
            *with as f64 / half_s,
            *without as f64 / half_s,
        )?;
    }
    let number = |report: &Value, key: &str| report[key].as_f64().unwrap_or(f64::NAN);
    let periods = done.iter().map(|report| {
        let window_s = number(report, "flipped_s") - number(report, "joined_s") - SHADOW_S;
        (window_s * rate * 1e3).round() / 1e3
    });
    let mut periods: Vec<f64> = periods.collect();
    periods.sort_by(f64::total_cmp);
    let last = periods.len().saturating_sub(1);
    if let (Some(median), Some(most)) = (periods.get(last / 2), periods.last()) {
        let within = periods.iter().filter(|periods| **periods <= 3.0).count();
        writeln!(
            out,
            "from the end of the shadow window to the flip: median {median:.2}, at most {most:.2} control periods; {within} of {} within 3",
            periods.len()
        )?;
    }
    let bump = done.iter().map(|report| number(report, "bump")).fold(0.0, f64::max);
    writeln!(out, "bump at most {:.4} % of the largest command", 100.0 * bump)?;
    Ok(())
}
