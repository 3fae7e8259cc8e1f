//! Arguments of `replay`.

use super::Format;
use super::duration::duration;
use super::recordings::RecordingName;
use clap::{ArgGroup, Args};
use core::time::Duration;
use experiments::branch::At;
use std::path::PathBuf;

/// What to do with a recording.
#[derive(Debug, Clone, Args)]
#[command(group(ArgGroup::new("what").required(true).multiple(true)))]
pub struct ReplayArguments {
    /// The recording
    #[arg(value_parser = RecordingName)]
    pub file: PathBuf,
    /// Compute its hashes again and compare them with those stored
    #[arg(long, group = "what")]
    pub hash: bool,
    /// Fly each service again on what it had, and compare every output and state bit for bit
    #[arg(long, group = "what")]
    pub verify: bool,
    /// Only this service, for example `plant`; of a slot that changed hands `attitude`, `attitude-lqr`,
    /// `attitude@1` for all that sat on seat 1, or `attitude-lqr@1`
    #[arg(long, value_name = "NAME")]
    pub service: Vec<String>,
    /// Let another controller replay and show how far it departs: a service, or another build
    #[arg(long, group = "what", value_name = "EXE|NAME")]
    pub with: Option<String>,
    /// Any key of the scenario, for the controller that replays or from the branch on
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Write the outputs of the one service named as a recording
    #[arg(long, group = "what", value_name = "FILE")]
    pub outputs: Option<PathBuf>,
    /// From the middle on.
    #[command(flatten)]
    pub branch: BranchArguments,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// What is done with the flight as recorded; no flag of a branch means anything there.
const OF_RECORDED: [&str; 4] = ["hash", "verify", "with", "outputs"];

/// A branch of a recorded flight.
#[derive(Debug, Clone, Args)]
pub struct BranchArguments {
    /// Take the flight up at a plant tick or a time, and fly on: @1234, @12.5s
    #[arg(long, value_name = "@TICK", group = "what", conflicts_with_all = OF_RECORDED, conflicts_with = "service")]
    pub branch: Option<At>,
    /// Another service for a slot from there on, for example `attitude=attitude-mpc`
    #[arg(long, value_name = "SLOT=NAME", requires = "branch", conflicts_with_all = OF_RECORDED)]
    pub swap: Vec<String>,
    /// Draw everything random from another seed from there on
    #[arg(long, value_name = "N", requires = "branch", conflicts_with_all = OF_RECORDED)]
    pub seed: Option<u64>,
    /// Logical time of the whole flight: 20s, 500ms, 2m
    #[arg(long = "for", value_name = "DURATION", allow_hyphen_values = true, value_parser = duration, requires = "branch", conflicts_with_all = OF_RECORDED)]
    pub duration: Option<Duration>,
    /// Folder for a recording of the branch
    #[arg(long, value_name = "DIR", requires = "branch", conflicts_with_all = OF_RECORDED)]
    pub record: Option<PathBuf>,
    /// A branch for each value of a key, for example `plant.mismatch.mass_scale=0.9..1.1/5`
    #[arg(long, value_name = "KEY=A..B/N", requires = "branch", conflicts_with_all = OF_RECORDED)]
    pub sweep: Vec<String>,
    /// A branch for each seed: 0..999
    #[arg(long, value_name = "A..B", requires = "branch", conflicts_with = "seed", conflicts_with_all = OF_RECORDED)]
    pub seeds: Option<String>,
    /// Folder for the table of many branches; `branches` if left out
    #[arg(long, value_name = "DIR", requires = "branch", conflicts_with_all = OF_RECORDED)]
    pub out: Option<PathBuf>,
}
