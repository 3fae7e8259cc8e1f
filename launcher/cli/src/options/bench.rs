//! The grammar of `morphquad bench`.

use super::duration::duration;
use super::{Format, ScenarioArguments};
use bench::gate::Gate;
use bench::peer::load::Load;
use bench::place::{Policy, cpus};
use clap::{Args, Subcommand};
use core::time::Duration;
use std::path::PathBuf;

pub(super) const EXAMPLES: &str = "Examples:
  morphquad bench loops figure8-morph --rate attitude=500 --for 60s --policy fifo --html bench.html
  morphquad bench loops figure8-morph --rate attitude=500 --asap
  morphquad bench loops --save before.json
  morphquad bench loops --out machine.toml && morphquad run --timing machine.toml
  morphquad bench loops --compare before.json --gate p99:+10% --gate lateness.p99:1.2x --gate held
  morphquad bench rate --loop attitude-mpc --for 10s
  morphquad bench hop --for 5s
  morphquad bench hop --policy fifo --cpus 0,1 --max-ratio 1.25";

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Every loop and every path of a realtime flight, with the machine's floor beside it
    Loops(LoopsArguments),
    /// One sample from process to process, through our ports and through bare iceoryx2
    Hop(HopArguments),
    /// The highest rate that each loop holds: at most 0.1 % of its releases missed
    Rate(RateArguments),
}

/// Where everything that is measured runs.
#[derive(Debug, Clone, Args)]
pub struct PlaceArguments {
    /// Scheduling policy; without the right to it, other, and the result shows that
    #[arg(long, value_enum, default_value = "fifo")]
    pub policy: Policy,
    /// Priority of the slowest loops under the policy fifo; each faster rate has one more
    #[arg(long, value_name = "N", default_value = "10", value_parser = clap::value_parser!(u8).range(1..=90))]
    pub priority: u8,
    /// Processors for everything: 0,1 or 0-3; all if left out
    #[arg(long, value_name = "LIST", value_parser = Cpus::parse)]
    pub cpus: Option<Cpus>,
}

/// A list of processors.
#[derive(Debug, Clone)]
pub struct Cpus(pub Vec<usize>);

impl Cpus {
    fn parse(text: &str) -> Result<Self, String> {
        cpus(text).map(Self)
    }
}

impl PlaceArguments {
    /// The same as arguments, for a flight in a process of its own.
    #[must_use]
    pub fn arguments(&self) -> Vec<String> {
        let mut arguments = vec![format!("--policy={}", self.policy.label())];
        arguments.push(format!("--priority={}", self.priority));
        if let Some(Cpus(cpus)) = &self.cpus {
            let cpus: Vec<String> = cpus.iter().map(usize::to_string).collect();
            arguments.push(format!("--cpus={}", cpus.join(",")));
        }
        arguments
    }

    /// The processors named; none for all.
    #[must_use]
    pub fn cpus(&self) -> &[usize] {
        self.cpus.as_ref().map_or(&[], |cpus| &cpus.0)
    }
}

/// How many times as much as something else: finite, and above 0.
fn ratio(text: &str) -> Result<f64, String> {
    let ratio = text.parse().ok().filter(|ratio: &f64| ratio.is_finite() && *ratio > 0.0);
    ratio.ok_or_else(|| "it must be a number above 0, for example 1.5".to_owned())
}

/// A scenario as arguments, for a flight in a process of its own that lasts `usual` if no duration is given.
#[must_use]
pub fn scenario_arguments(scenario: &ScenarioArguments, usual: &str) -> Vec<String> {
    let for_s = scenario.duration.map(|duration| format!("{}s", duration.as_secs_f64()));
    let mut arguments = vec![scenario.scenario.clone()];
    arguments.push(format!("--for={}", for_s.as_deref().unwrap_or(usual)));
    arguments.extend(scenario.seed.map(|seed| format!("--seed={seed}")));
    let lists = [
        ("--rate", &scenario.rate),
        ("--controller", &scenario.controller),
        ("--set", &scenario.set),
        ("--swap", &scenario.swap),
        ("--standby", &scenario.standby),
        ("--fault", &scenario.fault),
        ("--goto", &scenario.goto),
        ("--morph", &scenario.morph),
        ("--timing", &scenario.timing),
    ];
    for (flag, values) in lists {
        arguments.extend(values.iter().map(|value| format!("{flag}={value}")));
    }
    arguments.extend(scenario.strict.then(|| "--strict".to_owned()));
    arguments
}

/// One sample on its way.
#[derive(Debug, Clone, Args)]
pub struct HopArguments {
    /// How long each carrier is measured with a sleeping reader
    #[arg(long = "for", value_name = "DURATION", default_value = "2s", allow_hyphen_values = true, value_parser = duration)]
    pub duration: Duration,
    /// Where.
    #[command(flatten)]
    pub place: PlaceArguments,
    /// End with 1 if the median through our ports is more than this many times the bare transport's
    #[arg(long, value_name = "RATIO", allow_hyphen_values = true, value_parser = ratio)]
    pub max_ratio: Option<f64>,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// A measured flight.
#[derive(Debug, Clone, Args)]
pub struct LoopsArguments {
    /// The scenario; it flies in realtime.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Where.
    #[command(flatten)]
    pub place: PlaceArguments,
    /// What else the machine does meanwhile, on every processor
    #[arg(long, value_enum, default_value = "none")]
    pub load: Load,
    /// Let commands and set points take effect when they are published, and not a latency after
    #[arg(long)]
    pub asap: bool,
    /// Time at the beginning that is counted apart; 1s, or a quarter of a shorter flight
    #[arg(long, value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub warm_up: Option<Duration>,
    /// Leave the machine's own noise out
    #[arg(long)]
    pub no_floor: bool,
    /// Folder for a recording of the flight
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// File for the result, to compare with later
    #[arg(long, value_name = "FILE")]
    pub save: Option<PathBuf>,
    /// File for what the machine did to the time of each loop, for `run --timing FILE`
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// An earlier result, of the same machine, version, scenario, rates and policy
    #[arg(long, value_name = "FILE")]
    pub compare: Option<PathBuf>,
    /// File for a page with tables and pictures that needs nothing else
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// Folder for a picture of each loop and path as SVG
    #[arg(long, value_name = "DIR")]
    pub svg: Option<PathBuf>,
    /// Folder for the same as PNG
    #[arg(long, value_name = "DIR")]
    pub png: Option<PathBuf>,
    /// Limits, beyond which the command ends with 1: p99:+10% from the earlier result,
    /// lateness.p99:1.2x the floor, path.p99:500us, or held for rates; growth below 1 us is none
    #[arg(long, value_name = "LIMIT", value_parser = Gate::parse)]
    pub gate: Vec<Gate>,
    /// Form of the result
    #[arg(long, value_enum, default_value = "table")]
    pub format: TableFormat,
}

/// Form of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum TableFormat {
    /// For people
    #[value(alias = "text")]
    Table,
    /// For machines
    Json,
}

/// Rates to be found out.
#[derive(Debug, Clone, Args)]
pub struct RateArguments {
    /// The scenario; each flight of it takes 5s unless --for is given.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Where.
    #[command(flatten)]
    pub place: PlaceArguments,
    /// Only this loop
    #[arg(long = "loop", value_name = "NAME")]
    pub only: Vec<String>,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}
