//! What a live swap costs a realtime flight: swaps and no swaps by turns in one flight.
//!
//! `cargo bench --bench swap` flies hover with the attitude loop at 500 Hz by the wall clock. Each block of
//! half a second begins with a null swap of the attitude slot; its first half is the window with a swap, its
//! second the one without. It prints the deadlines missed in either, how long a flip takes after the
//! shadow window, and what a timer of the same rate missed meanwhile that has nothing to do with the flight.
//! With `-- --rehearse` each swap is rehearsed, and blocks are 6 s long. `--speed 0.5` is for machines that
//! cannot keep up; the output names the speed.

mod flown;

use bench::floor::{Floor, FloorPlan};
use bench::peer::be_peer;
use bench::place::{Place, Policy};
use clap::Parser;
use record::read::RecordedFlight;
use runtime::clock::mono_now_ns;
use serde_json::Value;
use shared_types::{AppliedCommand, Deviation, DeviationKind, Role, topics};
use std::io::Write;
use std::path::Path;
use std::process::{ExitCode, Stdio};

/// Swaps in realtime.
#[derive(Debug, Parser)]
struct Options {
    /// How many; 200, or 40 with a rehearsal each, unless given.
    #[arg(long, value_name = "N")]
    swaps: Option<u32>,
    /// Rehearse each.
    #[arg(long)]
    rehearse: bool,
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

/// From one swap to the next, without a rehearsal and with one [s].
const EVERY_S: [f64; 2] = [0.5, 6.0];
/// Before the first [s].
const LEAD_IN_S: f64 = 1.0;
/// Shadow window [s]; a hundred times the shortest period that a loop may have.
const SHADOW_S: f64 = 0.1;
const ROLLBACK_S: f64 = 0.03;

impl Options {
    fn every_s(&self) -> f64 {
        EVERY_S[usize::from(self.rehearse)]
    }

    fn swaps(&self) -> u32 {
        self.swaps.unwrap_or(if self.rehearse { 40 } else { 200 })
    }
}

/// Deadlines missed in a block: by all loops that fly and by the shadow, each with the swap and without.
type Block = [[u64; 2]; 2];

fn main() -> ExitCode {
    if let Some(code) = flown::run_if_flown() {
        return code;
    }
    // The floor's processes are this executable again.
    if std::env::args().nth(1).is_some_and(|argument| argument == "bench-peer") {
        return ExitCode::from(be_peer());
    }
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
    let place = Place::take(Policy::Fifo, 10, &[])?;
    let plan = FloorPlan { timers: vec![options.rate], pings: Vec::new() };
    let floor = Floor::prepare(&plan, &place)?;
    floor.starter()(mono_now_ns());
    let summary = fly(options, folder.path())?;
    let floor = floor.finish()?;
    let path = summary["recording"].as_str().ok_or("no recording")?;
    let recorded = RecordedFlight::open(path.as_ref())?;
    let owners = owners(&recorded)?;
    let mut blocks: Vec<Block> = vec![Block::default(); options.swaps() as usize];
    for deviation in recorded.samples(&topics::DEVIATION)? {
        let at_s = deviation.header.release_ns as f64 * 1e-9 - LEAD_IN_S;
        let nth = (at_s / options.every_s()).floor();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it is checked"
        )]
        let block = if nth < 0.0 { None } else { blocks.get_mut(nth as usize) };
        let Some(block) = block else { continue };
        let share = at_s / options.every_s() - nth;
        let shadows = deviation.role == Role::Attitude
            // The header's number distinguishes processes: role, then seat.
            && deviation.header.seat / 8 % 4 != owner_at(&owners, deviation.header.release_ns);
        block[usize::from(shadows)][usize::from(share >= 0.5)] += count(&deviation);
    }
    let graph = recorded.scenario().graph()?;
    let releases_hz = graph.nodes().iter().map(|node| node.rate.hz()).sum();
    print(options, &summary, &blocks, releases_hz)?;
    // The same of a timer: it woke when its next wake was due already.
    let late = floor.timers.iter().flat_map(|(_, wakes)| wakes.iter());
    let period_ns = 1e9 / options.rate;
    let missed = late.clone().filter(|(_, late_ns)| *late_ns as f64 >= period_ns).count();
    let out = &mut std::io::stdout().lock();
    writeln!(
        out,
        "floor: a timer of {} Hz ({}) woke a period late or later {missed} times in {} ({:.3} %)",
        options.rate,
        place.to_line(),
        late.clone().count(),
        100.0 * missed as f64 / late.count().max(1) as f64,
    )?;
    Ok(())
}

fn fly(options: &Options, folder: &Path) -> Result<Value> {
    let (every_s, swaps) = (options.every_s(), options.swaps());
    let seconds = LEAD_IN_S + every_s * f64::from(swaps) + 1.0;
    let mut command = flown::morphquad();
    command.args(["run", "hover", "--clock", "realtime", "--format", "json"]);
    command.args(["--rate", &format!("attitude-mpc={}", options.rate)]);
    command.args(["--speed", &options.speed.to_string(), "--for", &format!("{seconds}s")]);
    command.arg("--record").arg(folder);
    let rehearse = if options.rehearse { ",rehearse" } else { "" };
    for k in 0..swaps {
        let at_s = LEAD_IN_S + every_s * f64::from(k);
        let Options { to, .. } = options;
        let swap =
            format!("attitude={to}@{at_s}s,shadow={SHADOW_S}s,rollback={ROLLBACK_S}s{rehearse}");
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

fn print(options: &Options, summary: &Value, blocks: &[Block], releases_hz: f64) -> Result<()> {
    let out = &mut std::io::stdout().lock();
    let reports = summary["swaps"].as_array().ok_or("no swaps")?;
    let done: Vec<&Value> = reports.iter().filter(|report| report["done"] == true).collect();
    let half_s = 0.5 * options.every_s();
    let Options { rate, speed, .. } = options;
    writeln!(
        out,
        "attitude loop at {rate} Hz, {speed} logical seconds per wall second; {} of {} swaps done",
        done.len(),
        options.swaps()
    )?;
    for report in reports.iter().filter(|report| report["done"] != true) {
        writeln!(out, "  not done: {}", report["outcome"])?;
    }
    let all_s = half_s * blocks.len() as f64;
    for (row, loops) in ["all loops that fly", "the shadow"].iter().enumerate() {
        let [with, without] = [0, 1].map(|half| blocks.iter().map(|b| b[row][half]).sum::<u64>());
        writeln!(
            out,
            "deadlines missed per second by {loops}: {:.2} with a swap, {:.2} without ({with} and {without})",
            with as f64 / all_s,
            without as f64 / all_s,
        )?;
    }
    let extra = |[with, without]: [u64; 2]| (with as f64 - without as f64) / (half_s * releases_hz);
    let extras: Vec<f64> = blocks.iter().map(|block| extra(block[0])).collect();
    let (mean, limit) = upper_limit(&extras);
    writeln!(
        out,
        "of the {releases_hz:.0} releases per second of all loops that fly, missed more with a swap: \
         {:+.4} percentage points, at most {:+.4} at 95 % (one-sided, {} blocks)",
        100.0 * mean,
        100.0 * limit,
        blocks.len()
    )?;
    print_flips(out, options, &done)
}

/// When the slot changed hands in its block, and how smoothly.
fn print_flips(out: &mut impl Write, options: &Options, done: &[&Value]) -> Result<()> {
    let rate = options.rate;
    let half_s = 0.5 * options.every_s();
    let number = |report: &Value, key: &str| report[key].as_f64().unwrap_or(f64::NAN);
    let last_flip = done.iter().map(|report| {
        let begun_s = number(report, "flipped_s") - LEAD_IN_S;
        begun_s.rem_euclid(options.every_s())
    });
    let last_flip_s = last_flip.fold(0.0, f64::max);
    writeln!(
        out,
        "the latest flip came {last_flip_s:.2} s into its block's {half_s} s with a swap"
    )?;
    if !options.rehearse {
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
    }
    let bump = done.iter().map(|report| number(report, "bump")).fold(0.0, f64::max);
    writeln!(out, "bump at most {:.4} % of the largest command", 100.0 * bump)?;
    Ok(())
}

/// Mean of the values of the blocks, and its one-sided limit at 95 %: by the central limit theorem, which tens of
/// blocks are enough for.
fn upper_limit(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance =
        values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (n - 1.0);
    (mean, mean + 1.685 * (variance / n).sqrt())
}
