//! Arguments of `rehearse`.

use super::Format;
use super::duration::duration;
use clap::Args;
use core::time::Duration;
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  morphquad rehearse figure8-morph --at 6s --swap attitude=attitude-lqr
  morphquad rehearse hover --at 2s --swap position=./my-controller,config=my.toml --format json
  morphquad rehearse figure8-morph --at 6s --swap attitude=attitude-pid --scenario-of 1 > rehearsal.toml
  morphquad rehearse --spec spec.json";

/// What to rehearse.
#[derive(Debug, Clone, Args)]
pub struct RehearseArguments {
    /// A scenario inside the executable, or a path to one
    #[arg(required_unless_present = "spec", conflicts_with = "spec")]
    pub scenario: Option<String>,
    /// Instant of the flight at which the swap would be asked for
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "1s")]
    pub at: Duration,
    /// Controller that would take over, for example `attitude=attitude-lqr`; behind it may stand ,config=FILE
    #[arg(long, value_name = "SLOT=NAME", required_unless_present = "spec")]
    pub swap: Option<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N")]
    #[arg(value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: Option<u64>,
    /// Any key of the scenario, for example `rehearsal.owner_scale=2`
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Controller that fills a slot before, for example `attitude=attitude-lqr`
    #[arg(long, value_name = "SLOT=NAME", value_delimiter = ',')]
    pub controller: Vec<String>,
    /// Number of the swap within the run, from which the draws follow
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub number: u64,
    /// Show the scenario that the candidate flies in this draw, and fly nothing
    #[arg(long, value_name = "0|1|2", value_parser = clap::value_parser!(u8).range(..=2))]
    pub scenario_of: Option<u8>,
    /// Form of the verdict
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
    /// Rehearse what this file of JSON describes, or standard input for `-`, and print the verdict as one line
    /// of JSON; ends when the process that started it does
    #[arg(long, value_name = "FILE", conflicts_with_all = ["swap", "seed", "set", "controller", "scenario_of", "at", "number", "format"])]
    pub spec: Option<PathBuf>,
    /// How much to stand back for other processes while it flies what `--spec` describes
    #[arg(long, value_name = "N", default_value_t = 0, requires = "spec")]
    #[arg(value_parser = clap::value_parser!(i32).range(0..=19))]
    pub nice: i32,
}
