//! Arguments of `study`.

use super::scenario_name::ScenarioOr;
use super::{Format, examples};
use clap::builder::StringValueParser;
use clap::{Args, Subcommand};
use experiments::campaign::values;
use scenario::TESTED_RATES_HZ;
use std::path::PathBuf;

/// Which study.
#[derive(Debug, Subcommand)]
pub(crate) enum StudyCommand {
    /// Fly every attitude controller under every position controller and compare them in one table
    #[command(after_help = examples::CONTROLLERS)]
    Controllers(StudyOutput),
    /// Fly figure8-morph at sweeps from 4 s to 0.3 s, with the law scheduled and not
    #[command(after_help = examples::MORPHING)]
    Morphing(MorphingArguments),
    /// Fly figure8-morph by vehicles and in weather that the controllers do not know, drawn by seed
    #[command(after_help = examples::RANDOM)]
    Random(RandomArguments),
    /// Map where the attitude loop is stable: rotor lag, inertia and delay over its weight
    #[command(after_help = examples::STABILITY)]
    Stability(StabilityArguments),
    /// Make loops late and find how long the steps of each may take, and how late it may begin
    #[command(after_help = examples::TIMING)]
    Timing(TimingArguments),
    /// Draw sets of numbers for the position MPC and give the Pareto front of closeness and robustness
    #[command(after_help = examples::TUNING)]
    Tuning(TuningArguments),
    /// Certify how many changes of its working set one solve of the attitude law can need
    #[command(after_help = examples::WORST_CASE)]
    WorstCase(StabilityArguments),
}

/// Where results go and how much is computed.
#[derive(Debug, Clone, Args)]
pub(crate) struct StudyOutput {
    /// Folder for tables, pictures and JSON
    #[arg(long, value_name = "DIR", default_value = "study")]
    pub(crate) out: PathBuf,
    /// A small part of it, in seconds
    #[arg(long)]
    pub(crate) quick: bool,
    /// Form of the result on stdout
    #[arg(long, value_enum, default_value = "text")]
    pub(crate) format: Format,
}

/// The flights of the morphing study.
#[derive(Debug, Clone, Args)]
pub(crate) struct MorphingArguments {
    #[command(flatten)]
    pub(crate) out: StudyOutput,
    /// Seeds of the scheduled law as flown; 20, or 3 if quick
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub(crate) seeds: Option<u64>,
}

/// The members of the family of random flights, and what flies them.
#[derive(Debug, Clone, Args)]
pub(crate) struct RandomArguments {
    #[command(flatten)]
    pub(crate) out: StudyOutput,
    /// Which members, both ends included: `1..150`; up to 15 of them if quick
    #[arg(long, value_name = "FIRST..LAST", default_value = "1..150", value_parser = seeds)]
    pub(crate) seeds: Box<[u64]>,
    /// Controller that fills a slot in all of them, for example `position=position-pid`
    #[arg(long, value_name = "SLOT=NAME", value_delimiter = ',')]
    pub(crate) controller: Vec<String>,
    /// Any key of the scenario in all of them, for example `pilot.period_s=6`
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
}

/// The flight whose loops are made late.
#[derive(Debug, Clone, Args)]
pub(crate) struct TimingArguments {
    /// Name of a shipped scenario, or path of a file
    #[arg(default_value = "figure8-morph", hide_possible_values = true)]
    #[arg(value_parser = ScenarioOr(StringValueParser::new()))]
    pub(crate) scenario: String,
    #[command(flatten)]
    pub(crate) out: StudyOutput,
    /// Controller that fills a slot in all flights, for example `position=position-pid`
    #[arg(long, value_name = "SLOT=NAME", value_delimiter = ',')]
    pub(crate) controller: Vec<String>,
    /// Any key of the scenario in all flights, for example `attitude_mpc.rate_hz=200`
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
}

/// The candidates of a tuning study, and what they fly.
#[derive(Debug, Clone, Args)]
pub(crate) struct TuningArguments {
    #[command(flatten)]
    pub(crate) out: StudyOutput,
    /// Sets of numbers, the shipped one included; 3 if quick
    #[arg(long, value_name = "N", default_value = "40", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub(crate) candidates: u64,
    /// Seed of what is drawn for them
    #[arg(long, value_name = "SEED", default_value = "1")]
    pub(crate) seed: u64,
    /// Random flights by which is chosen, both ends included; up to 15 of them if quick
    #[arg(long, value_name = "FIRST..LAST", default_value = "1..150", value_parser = seeds)]
    pub(crate) seeds: Box<[u64]>,
    /// Random flights by which the Pareto front is judged
    #[arg(long, value_name = "FIRST..LAST", default_value = "151..300", value_parser = seeds)]
    pub(crate) judged: Box<[u64]>,
}

/// `FIRST..LAST`, as a campaign and `replay` take it.
fn seeds(text: &str) -> Result<Box<[u64]>, String> {
    values::seeds(text).map(Into::into)
}

/// The attitude loop of a study.
#[derive(Debug, Clone, Args)]
pub(crate) struct StabilityArguments {
    #[command(flatten)]
    pub(crate) out: StudyOutput,
    /// Control rate, 50 to 1000
    #[arg(long, value_name = "HZ", default_value = "100", value_parser = attitude_rate)]
    pub(crate) rate: f64,
    /// Deployable angle
    #[arg(long, value_name = "DEGREES", default_value = "45")]
    pub(crate) angle: f64,
}

/// A rate at which the attitude loop is tested.
fn attitude_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().map_err(|_| format!("`{text}` is not a number"))?;
    if TESTED_RATES_HZ.contains(&rate) {
        Ok(rate)
    } else {
        let (least, most) = TESTED_RATES_HZ.into_inner();
        Err(format!("no attitude loop is tested there: give {least} to {most} Hz"))
    }
}
