//! What was measured, by row and column, and how it is printed: medians, with the range in which all rounds lie.

use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// A realtime flight.
#[derive(Debug)]
pub struct Realtime {
    /// From reading the sensor to the command's arrival at the motor \[µs\].
    pub p50_us: f64,
    pub p99_us: f64,
    /// Processor time of all nodes per flight second, user and system \[ms\].
    pub cpu_ms: f64,
    /// Commands that never arrived.
    pub lost: u64,
    /// Ticks at which the plant was more than half a tick late, where the runtime reports it.
    pub late: Option<u64>,
}

/// Figures of all rounds.
#[derive(Debug, Default, Serialize)]
struct Rounds(Vec<f64>);

impl Rounds {
    fn sorted(&self) -> Vec<f64> {
        let mut sorted = self.0.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted
    }

    fn median(&self) -> Option<f64> {
        let sorted = self.sorted();
        sorted.get(sorted.len() / 2).copied()
    }

    fn text(&self, digits: usize) -> String {
        let sorted = self.sorted();
        match (self.median(), sorted.first(), sorted.last()) {
            (Some(median), Some(least), Some(most)) if sorted.len() > 1 => {
                format!("{median:.digits$} ({least:.digits$} to {most:.digits$})")
            }
            (Some(median), ..) => format!("{median:.digits$}"),
            _ => String::new(),
        }
    }
}

/// What can be measured of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
enum Column {
    P50Fifo,
    P99Fifo,
    CpuFifo,
    P50Other,
    P99Other,
    CpuOther,
    Speed,
    SpeedRecorded,
    Bytes,
    Lost,
    Late,
}

impl Column {
    const ALL: [Self; 11] = [
        Self::P50Fifo,
        Self::P99Fifo,
        Self::CpuFifo,
        Self::P50Other,
        Self::P99Other,
        Self::CpuOther,
        Self::Speed,
        Self::SpeedRecorded,
        Self::Bytes,
        Self::Lost,
        Self::Late,
    ];

    fn title(self) -> &'static str {
        match self {
            Self::P50Fifo => "sensor to motor, SCHED_FIFO, p50 [us]",
            Self::P99Fifo => "sensor to motor, SCHED_FIFO, p99 [us]",
            Self::CpuFifo => "processor time per flight second, SCHED_FIFO [ms]",
            Self::P50Other => "sensor to motor, SCHED_OTHER, p50 [us]",
            Self::P99Other => "sensor to motor, SCHED_OTHER, p99 [us]",
            Self::CpuOther => "processor time per flight second, SCHED_OTHER [ms]",
            Self::Speed => "lockstep, simulated s per s",
            Self::SpeedRecorded => "the same, everything recorded",
            Self::Bytes => "recorded per flight second [MB]",
            Self::Lost => "commands that never arrived",
            Self::Late => "ticks late by more than half of one",
        }
    }

    fn digits(self) -> usize {
        match self {
            Self::Bytes => 2,
            Self::CpuFifo | Self::CpuOther | Self::Lost | Self::Late => 0,
            Self::P50Fifo | Self::P99Fifo | Self::P50Other | Self::P99Other => 1,
            Self::Speed | Self::SpeedRecorded => 1,
        }
    }
}

/// Everything that was measured.
#[derive(Debug, Serialize)]
pub struct Table {
    machine: String,
    rows: Vec<String>,
    figures: BTreeMap<String, BTreeMap<Column, Rounds>>,
    /// Hashes of flights in lockstep, which have one scenario and one seed.
    hashes: Vec<String>,
    /// Of each flight with a swap: commands missed or doubled, and all.
    swaps: Vec<[u64; 2]>,
}

impl Table {
    pub const PROCESSES: &str = "morphquad, eight processes";
    pub const ONE_PROCESS: &str = "morphquad, one process";

    pub fn new(with_flights: bool) -> Self {
        let flights = [Self::PROCESSES, Self::ONE_PROCESS].map(str::to_owned);
        let mut rows: Vec<String> = flights.into_iter().filter(|_| with_flights).collect();
        rows.extend(crate::node::Peer::ALL.map(|peer| peer.name().to_owned()));
        Self {
            machine: machine(),
            rows,
            figures: BTreeMap::new(),
            hashes: Vec::new(),
            swaps: Vec::new(),
        }
    }

    fn add(&mut self, row: &str, column: Column, figure: f64) {
        let row = self.figures.entry(row.to_owned()).or_default();
        row.entry(column).or_default().0.push(figure);
    }

    pub fn add_realtime(&mut self, row: &str, fifo: bool, flown: &Realtime) {
        let columns = if fifo {
            [Column::P50Fifo, Column::P99Fifo, Column::CpuFifo]
        } else {
            [Column::P50Other, Column::P99Other, Column::CpuOther]
        };
        for (column, figure) in columns.into_iter().zip([flown.p50_us, flown.p99_us, flown.cpu_ms])
        {
            self.add(row, column, figure);
        }
        if fifo {
            self.add(row, Column::Lost, flown.lost as f64);
            if let Some(late) = flown.late {
                self.add(row, Column::Late, late as f64);
            }
        }
    }

    /// A flight in lockstep, with the bytes per simulated second if it was recorded.
    pub fn add_lockstep(&mut self, row: &str, speed: f64, bytes_per_s: Option<f64>) {
        match bytes_per_s {
            None => self.add(row, Column::Speed, speed),
            Some(bytes) => {
                self.add(row, Column::SpeedRecorded, speed);
                self.add(row, Column::Bytes, bytes * 1e-6);
            }
        }
    }

    pub fn note_hashes(&mut self, hashes: [String; 2]) {
        self.hashes.extend(hashes);
    }

    pub fn note_swap(&mut self, missed: [u64; 2]) {
        self.swaps.push(missed);
    }

    fn cell(&self, row: &str, column: Column) -> String {
        let figures = self.figures.get(row).and_then(|row| row.get(&column));
        figures.map_or_else(String::new, |figures| figures.text(column.digits()))
    }

    /// How two runs and a replaced task come out, in a sentence each.
    fn findings(&self) -> Vec<String> {
        let mut findings = Vec::new();
        if let Some(first) = self.hashes.first() {
            let same = self.hashes.iter().filter(|hash| *hash == first).count();
            let all = self.hashes.len();
            findings.push(format!(
                "Two runs, the same bits: morphquad {same} of {all} flights, in processes and in one, recorded and not. The \
                 bare chains only if their user makes them so, as here. copper-rs: a recorded run can be replayed exactly."
            ));
            let missed: u64 = self.swaps.iter().map(|[missed, _]| missed).sum();
            let all: u64 = self.swaps.iter().map(|[_, all]| all).sum();
            findings.push(format!(
                "A controller replaced in a realtime flight: morphquad {missed} commands missed or doubled of {all} in {} \
                 flights; what is missed without a swap stands above. copper-rs compiles its task graph in; a bare chain \
                 has what its user builds.",
                self.swaps.len()
            ));
        }
        findings
    }

    pub fn markdown(&self) -> String {
        let mut text = format!("{}\n\n|", self.machine);
        let rows: Vec<&String> =
            self.rows.iter().filter(|row| self.figures.contains_key(*row)).collect();
        rows.iter().for_each(|row| _ = write!(text, " | {row}"));
        text.push_str(" |\n|---");
        rows.iter().for_each(|_| text.push_str("|---"));
        text.push_str("|\n");
        for column in Column::ALL {
            let _ = write!(text, "| {}", column.title());
            rows.iter().for_each(|row| _ = write!(text, " | {}", self.cell(row, column)));
            text.push_str(" |\n");
        }
        for finding in self.findings() {
            let _ = write!(text, "\n{finding}\n");
        }
        text
    }

    pub fn text(&self) -> String {
        let mut text = format!("{}\n", self.machine);
        for row in self.rows.iter().filter(|row| self.figures.contains_key(*row)) {
            let _ = write!(text, "\n{row}\n");
            for column in Column::ALL {
                let cell = self.cell(row, column);
                if !cell.is_empty() {
                    let _ = writeln!(text, "  {:<52} {cell}", column.title());
                }
            }
        }
        for finding in self.findings() {
            let _ = write!(text, "\n{finding}\n");
        }
        text
    }
}

/// The machine, as far as figures depend on it.
fn machine() -> String {
    let of = |file: &str| std::fs::read_to_string(file).unwrap_or_default();
    let cpuinfo = of("/proc/cpuinfo");
    let named = |key: &str| {
        let line = cpuinfo.lines().find(|line| line.starts_with(key))?;
        line.split_once(':').map(|(_, value)| value.trim().to_owned())
    };
    let processors = cpuinfo.lines().filter(|line| line.starts_with("processor")).count();
    let load = of("/proc/loadavg");
    format!(
        "{}, {processors} processors, Linux {}, load {} at the beginning",
        named("model name").unwrap_or_else(|| "an unknown processor".to_owned()),
        of("/proc/sys/kernel/osrelease").trim(),
        load.split(' ').next().unwrap_or("unknown")
    )
}
