//! How fast lockstep is, beside what this machine can do at best, and where the time goes.
//!
//! `cargo bench --bench lockstep` prints, all from one run and in turns: a bare ring of five
//! processes (the floor under any network of processes that wait for one another), whole flights of
//! the executable, flights in one process, and the budget of a control period. Figures are medians
//! with the range in which all rounds lie.

mod budget;
mod flights;
mod floor;
#[path = "../flown/mod.rs"]
mod flown;
#[path = "../registry/mod.rs"]
mod registry;
mod report;
mod ring;

use clap::{Parser, ValueEnum};
use floor::{Floor, Ground};
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// The speed of lockstep flights, and the machine's floor under it.
#[derive(Debug, Parser)]
struct Options {
    /// Rounds; every figure is a median over them.
    #[arg(long, default_value_t = 7, value_name = "N")]
    rounds: usize,
    /// Logical time of each flight [s].
    #[arg(long, default_value_t = 20, value_name = "S")]
    seconds: u64,
    /// How to print.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// A process of the bare ring: place, run, kind, laps, processor.
    #[arg(long, hide = true, num_args = 5)]
    ring_node: Vec<String>,
    /// What cargo passes to every bench.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Everything that can go wrong is for people to read.
type Result<T> = core::result::Result<T, Box<dyn core::error::Error>>;

/// What is flown: the shipped figure, as shipped and with the fastest controllers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Plan {
    /// As shipped.
    Default,
    /// Attitude control at 500 Hz with 60 samples and 6 moves ahead, position control at 100 Hz
    /// with 50 and 5.
    Fast,
}

impl Plan {
    const ALL: [Self; 2] = [Self::Default, Self::Fast];

    fn name(self) -> &'static str {
        match self {
            Self::Default => "as shipped",
            Self::Fast => "500 Hz {60,6}, 100 Hz {50,5}",
        }
    }

    /// Keys that differ from the shipped scenario.
    fn keys(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Default => &[],
            Self::Fast => &[
                ("attitude_mpc.rate_hz", "500"),
                ("attitude_mpc.prediction_horizon", "60"),
                ("attitude_mpc.control_horizon", "6"),
                ("position_mpc.rate_hz", "100"),
                ("position_mpc.prediction_horizon", "50"),
                ("position_mpc.control_horizon", "5"),
            ],
        }
    }
}

/// Figures of several rounds.
#[derive(Debug, Clone, Default)]
struct Rounds(Vec<f64>);

impl Rounds {
    fn add(&mut self, figure: f64) {
        self.0.push(figure);
        self.0.sort_unstable_by(f64::total_cmp);
    }

    fn median(&self) -> f64 {
        self.0.get(self.0.len() / 2).copied().unwrap_or(f64::NAN)
    }

    fn range(&self) -> [f64; 2] {
        [self.0.first(), self.0.last()].map(|end| end.copied().unwrap_or(f64::NAN))
    }
}

fn run(options: &Options) -> Result<()> {
    if let [place, folder, kind, laps, cpu] = options.ring_node.as_slice() {
        return ring::be_a_node(place.parse()?, &PathBuf::from(folder), kind, laps.parse()?, cpu);
    }
    let ground = Ground::lay()?;
    let mut floors = Floor::all();
    let mut flown = flights::Flown::all();
    let mut in_process = flights::InProcess::all();
    // In turns, so that a busy minute of the machine falls on all of them.
    for _ in 0..options.rounds.max(1) {
        floors.iter_mut().try_for_each(|f| f.measure(&ground))?;
        flown.iter_mut().try_for_each(|f| f.measure(options.seconds))?;
        in_process.iter_mut().try_for_each(|f| f.measure(options.seconds))?;
    }
    let sample_us = budget::sample_us(&ground.bus)?;
    let budgets = Plan::ALL
        .into_iter()
        .map(|plan| budget::Budget::of(plan, sample_us))
        .collect::<Result<Vec<_>>>()?;
    let report = report::Report { floors, flown, in_process, budgets };
    let text = match options.format {
        Format::Text => report.text()?,
        Format::Json => report.json(),
    };
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}

fn main() -> ExitCode {
    if let Some(code) = flown::run_if_flown() {
        return code;
    }
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "{error}");
            ExitCode::FAILURE
        }
    }
}
