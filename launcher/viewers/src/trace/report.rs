//! What the chains of a recording add up to.

use super::{Broken, Chain, Ended, SEGMENTS, Traced};
use core::fmt;
use hdrhistogram::Histogram;
use serde_json::{Value, json};
use shared_types::Header;

/// The slowest chains, which are listed one by one.
const SLOWEST: usize = 5;
/// Commands without a chain that are listed one by one.
const MAX_UNTRACED: usize = 10;

/// Length of one span over all chains that have it \[ns\].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Figures {
    /// Chains.
    pub n: u64,
    /// Half take at most this.
    pub p50_ns: u64,
    /// Nine in ten.
    pub p90_ns: u64,
    /// 99 in 100.
    pub p99_ns: u64,
    /// 999 in 1000.
    pub p999_ns: u64,
    /// All.
    pub max_ns: u64,
}

/// One of the slowest commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slowest {
    /// Seat of the attitude loop.
    pub seat: u32,
    /// Sequence of the command.
    pub sequence: u64,
    /// Instant of its step \[ns\].
    pub release_ns: u64,
    /// From the intended release of its IMU sample to its publication \[ns\].
    pub sensor_to_command_ns: u64,
    /// The longest span within, and its length \[ns\].
    pub longest: (&'static str, u64),
}

/// All chains of a recording.
#[derive(Debug)]
pub struct Report {
    /// Wrench commands in the file.
    pub commands: usize,
    /// Those with a chain.
    pub traced: usize,
    /// Those of them that moved the rotors.
    pub applied: usize,
    /// Age of the IMU sample at the command's effect, in logical time.
    pub age: Figures,
    /// By segment, in order.
    pub segments: Vec<Figures>,
    /// The slowest first.
    pub slowest: Vec<Slowest>,
    /// Everything that has no chain.
    pub untraced: Vec<(Header, Broken)>,
    /// Where a file that is cut ends \[ns\].
    pub cut_at_ns: Option<u64>,
}

/// Lengths from below a microsecond to a minute, with three digits.
fn histogram() -> Histogram<u64> {
    match Histogram::new_with_max(60_000_000_000, 3) {
        Ok(histogram) => histogram,
        Err(_) => unreachable!("these bounds are allowed"),
    }
}

impl Figures {
    fn of(histogram: &Histogram<u64>) -> Self {
        let at = |share: f64| histogram.value_at_quantile(share).min(histogram.max());
        Self {
            n: histogram.len(),
            p50_ns: at(0.5),
            p90_ns: at(0.9),
            p99_ns: at(0.99),
            p999_ns: at(0.999),
            max_ns: histogram.max(),
        }
    }

    fn to_json(self) -> Value {
        let Self { n, p50_ns, p90_ns, p99_ns, p999_ns, max_ns } = self;
        json!({
            "n": n, "p50_ns": p50_ns, "p90_ns": p90_ns, "p99_ns": p99_ns, "p999_ns": p999_ns,
            "max_ns": max_ns,
        })
    }
}

impl Slowest {
    fn of(chain: &Chain) -> Option<Self> {
        let length = |key: &str| SEGMENTS.iter().find(|s| s.key == key)?.of(chain);
        let parts = SEGMENTS.iter().take_while(|segment| segment.key != "command_hop");
        let longest =
            parts.filter_map(|s| Some((s.text, s.of(chain)?))).max_by_key(|(_, ns)| *ns)?;
        let Header { seat, sequence, release_ns, .. } = chain.command;
        let sensor_to_command_ns = length("sensor_to_command")?;
        Some(Self { seat, sequence, release_ns, sensor_to_command_ns, longest })
    }
}

/// Adds commands up.
#[derive(Debug)]
pub struct Sum {
    commands: usize,
    applied: usize,
    age: Histogram<u64>,
    /// By segment, in order.
    segments: Vec<Histogram<u64>>,
    slowest: Vec<Slowest>,
    untraced: Vec<(Header, Broken)>,
}

impl Default for Sum {
    fn default() -> Self {
        Self {
            commands: 0,
            applied: 0,
            age: histogram(),
            segments: SEGMENTS.iter().map(|_| histogram()).collect(),
            slowest: Vec::new(),
            untraced: Vec::new(),
        }
    }
}

impl Sum {
    /// Takes another one.
    pub fn add(&mut self, traced: &Traced) {
        self.commands += 1;
        let chain = match &traced.chain {
            Ok(chain) => chain,
            Err(broken) => return self.untraced.push((traced.command, *broken)),
        };
        self.applied += usize::from(chain.tick.is_some());
        self.age.saturating_record(chain.age_ns());
        for (segment, lengths) in SEGMENTS.iter().zip(&mut self.segments) {
            if let Some(length_ns) = segment.of(chain) {
                lengths.saturating_record(length_ns);
            }
        }
        if let Some(slow) = Slowest::of(chain) {
            let slower = |one: &Slowest| one.sensor_to_command_ns >= slow.sensor_to_command_ns;
            let place = self.slowest.partition_point(slower);
            self.slowest.insert(place, slow);
            self.slowest.truncate(SLOWEST);
        }
    }

    /// What it comes to.
    #[must_use]
    pub fn report(self, ended: &Ended) -> Report {
        Report {
            commands: self.commands,
            traced: self.commands - self.untraced.len(),
            applied: self.applied,
            age: Figures::of(&self.age),
            segments: self.segments.iter().map(Figures::of).collect(),
            slowest: self.slowest,
            untraced: self.untraced,
            cut_at_ns: (!ended.closing.complete).then_some(ended.end_ns),
        }
    }
}

impl Report {
    /// True if the file is whole and every command in it has a chain.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.untraced.is_empty() && self.cut_at_ns.is_none() && self.commands > 0
    }

    /// For machines.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let segments = SEGMENTS.iter().zip(&self.segments);
        let segments: serde_json::Map<_, _> =
            segments.map(|(s, figures)| (s.key.to_owned(), figures.to_json())).collect();
        let slowest = self.slowest.iter().map(|one| {
            json!({
                "seat": one.seat, "sequence": one.sequence, "release_ns": one.release_ns,
                "sensor_to_command_ns": one.sensor_to_command_ns,
                "longest": one.longest.0, "longest_ns": one.longest.1,
            })
        });
        let untraced = self.untraced.iter().map(|(command, broken)| {
            json!({
                "seat": command.seat, "sequence": command.sequence,
                "release_ns": command.release_ns, "reason": broken.to_string(),
            })
        });
        json!({
            "commands": self.commands,
            "traced": self.traced,
            "applied": self.applied,
            "age": self.age.to_json(),
            "segments": segments,
            "slowest": slowest.collect::<Vec<_>>(),
            "untraced": untraced.collect::<Vec<_>>(),
            "cut_at_ns": self.cut_at_ns,
        })
    }
}

/// Microseconds with one digit.
pub(super) fn us(ns: u64) -> String {
    format!("{:.1}", ns as f64 * 1e-3)
}

fn row(f: &mut fmt::Formatter<'_>, text: &str, figures: &Figures) -> fmt::Result {
    let Figures { n, p50_ns, p90_ns, p99_ns, p999_ns, max_ns } = *figures;
    write!(f, "{text:<31}{n:>7}")?;
    for ns in [p50_ns, p90_ns, p99_ns, p999_ns, max_ns] {
        if n == 0 { write!(f, "{:>8}", "-")? } else { write!(f, "{:>8}", short(ns))? }
    }
    writeln!(f)
}

/// Microseconds in seven characters.
fn short(ns: u64) -> String {
    let digits = usize::from(ns < 100_000_000);
    format!("{:.digits$}", ns as f64 * 1e-3)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { commands, traced, applied, .. } = self;
        let share = 100.0 * *traced as f64 / (*commands).max(1) as f64;
        writeln!(
            f,
            "{traced} of {commands} wrench commands trace to their imu sample ({share:.2} %); {applied} moved the rotors\n"
        )?;
        writeln!(
            f,
            "{:<31}{:>7}{:>8}{:>8}{:>8}{:>8}{:>8}",
            "MICROSECONDS", "N", "P50", "P90", "P99", "P99.9", "MAX"
        )?;
        for (segment, figures) in SEGMENTS.iter().zip(&self.segments) {
            row(f, segment.text, figures)?;
        }
        row(f, "logical age of imu at effect", &self.age)?;
        if !self.slowest.is_empty() {
            writeln!(f, "\nslowest from imu due to command sent:")?;
        }
        for one in &self.slowest {
            writeln!(
                f,
                "  command {:>7} of seat {} at {:>9.4} s: {:>8} us, of which {} {} us",
                one.sequence,
                one.seat,
                one.release_ns as f64 * 1e-9,
                us(one.sensor_to_command_ns),
                one.longest.0,
                us(one.longest.1),
            )?;
        }
        for (command, broken) in self.untraced.iter().take(MAX_UNTRACED) {
            let Header { sequence, seat, release_ns, .. } = *command;
            let at_s = release_ns as f64 * 1e-9;
            writeln!(f, "not traced: command {sequence} of seat {seat} at {at_s:.4} s {broken}")?;
        }
        if let Some(more) = self.untraced.len().checked_sub(MAX_UNTRACED).filter(|n| *n > 0) {
            writeln!(f, "not traced: {more} further ones; --format json names them all")?;
        }
        if let Some(end_ns) = self.cut_at_ns {
            let at_s = end_ns as f64 * 1e-9;
            writeln!(f, "the file is cut at {at_s:.4} s: what was commanded later is not in it")?;
        }
        if *commands == 0 {
            writeln!(f, "there is no wrench command in the file")?;
        }
        Ok(())
    }
}
