//! The grammar of the command line; `air` has the commands to a run in the air.

mod air;
mod bench;
pub(in crate::cli) mod doctor;
mod examples;
mod orders;
mod pages;
mod recover;
pub(in crate::cli) mod report;
mod top;
mod topic;
pub(in crate::cli) mod trace;
pub(in crate::cli) mod view;

pub use air::{
    AdoptArguments, PsArguments, RetireArguments, RollbackArguments, RunChoice, StandbyArguments,
    SwapArguments,
};
pub use doctor::DoctorArguments;
pub use report::ReportArguments;
pub use trace::TraceArguments;
pub use view::ViewArguments;

pub use bench::{
    BenchCommand, HopArguments, LoopsArguments, PlaceArguments as MeasurePlace, RateArguments,
    ScaleArguments, SolveArguments, TableFormat, WatchArguments, scenario_words,
};
pub use orders::{DisturbArguments, GotoArguments, MorphArguments};
pub use pages::{CompletionsArguments, ManArguments};
pub use recover::RecoverArguments;
pub use top::TopArguments;
pub use topic::{
    SampleFormat, TopicCommand, TopicEchoArguments, TopicExportArguments, TopicHzArguments,
    TopicInfoArguments, TopicListArguments,
};

use crate::branch::At;
use crate::run::{Pin, RunOptions, Speed};
use crate::scenario::{Override, Scenario, ScenarioError, TESTED_RATES_HZ};
use clap::{ArgGroup, Args, Parser, Subcommand, ValueEnum};
use core::time::Duration;
use host::PlaceArguments;
use std::io::IsTerminal as _;
use std::path::PathBuf;

/// Fly a morphing quadrotor as a set of real processes over shared memory.
#[derive(Debug, Parser)]
#[command(name = "morphquad", version, about, max_term_width = 100)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Fly a scenario
    #[command(after_help = examples::RUN)]
    Run(RunArguments),
    /// Name the scenarios inside the executable
    #[command(after_help = examples::LIST)]
    List,
    /// Show what a scenario would fly, or what is wrong with it
    #[command(after_help = examples::CHECK)]
    Check(ScenarioArguments),
    /// Show processes and slots of a run in the air
    #[command(after_help = air::PS_EXAMPLES)]
    Ps(PsArguments),
    /// Let another controller take over a slot of a run in the air
    #[command(after_help = air::SWAP_EXAMPLES)]
    Swap(SwapArguments),
    /// Give a slot back to its old owner while that is still warm
    #[command(after_help = "Example:\n  morphquad rollback attitude")]
    Rollback(RollbackArguments),
    /// Send away an instance that does not command
    #[command(
        after_help = "Examples:\n  morphquad retire attitude-lqr\n  morphquad retire attitude-mpc@1"
    )]
    Retire(RetireArguments),
    /// Keep an instance warm that takes a slot over when its owner fails
    #[command(after_help = "Example:\n  morphquad standby attitude attitude-mpc")]
    Standby(StandbyArguments),
    /// Send the vehicle of a run in the air to a place
    #[command(after_help = orders::GOTO_EXAMPLES)]
    Goto(GotoArguments),
    /// Fold or spread the arms of a run in the air
    #[command(after_help = orders::MORPH_EXAMPLES)]
    Morph(MorphArguments),
    /// Disturb a run in the air
    #[command(after_help = orders::DISTURB_EXAMPLES)]
    Disturb(DisturbArguments),
    /// Watch a run in the air
    #[command(after_help = top::TOP_EXAMPLES)]
    Top(TopArguments),
    /// Look at the topics of a run in the air, or of a recording
    #[command(subcommand)]
    Topic(TopicCommand),
    /// Lead a realtime run to its end whose launcher has died
    #[command(after_help = air::ADOPT_EXAMPLES)]
    Adopt(AdoptArguments),
    /// Fly a recording again: verify it bit by bit, hash it, try another controller on it, or branch
    #[command(after_help = examples::REPLAY)]
    Replay(ReplayArguments),
    /// Tell what of this machine is in the way of realtime flights
    #[command(after_help = doctor::EXAMPLES)]
    Doctor(DoctorArguments),
    /// Follow the wrench commands of a recording back to their IMU samples
    #[command(after_help = trace::EXAMPLES)]
    Trace(TraceArguments),
    /// Show a recording in the browser: the vehicle in space, every constraint, what happened
    #[command(after_help = view::EXAMPLES)]
    View(ViewArguments),
    /// Judge a recording: pass or fail and why, every number with its gate, pictures
    #[command(after_help = report::EXAMPLES)]
    Report(ReportArguments),
    /// Reproduce the paper's Tests I, II and III, on its plant and among rotors
    #[command(after_help = examples::PAPER)]
    Paper(PaperArguments),
    /// Fly a scenario with many seeds and settings, on all cores
    #[command(after_help = examples::CAMPAIGN)]
    Campaign(CampaignArguments),
    /// Fly or compute a whole range of conditions
    #[command(subcommand)]
    Study(StudyCommand),
    /// Measure latencies of loops, paths and hops, with the machine's own noise beside them
    #[command(subcommand, after_help = bench::EXAMPLES)]
    Bench(BenchCommand),
    /// Write a small crate that flies a slot, to begin one's own controller with
    #[command(after_help = NEW_CONTROLLER_EXAMPLES)]
    NewController(NewControllerArguments),
    /// Show the samples as another language declares them
    #[command(after_help = examples::TYPES)]
    Types(TypesArguments),
    /// Write what a shell needs to complete commands
    #[command(after_help = pages::COMPLETIONS_EXAMPLES)]
    Completions(CompletionsArguments),
    /// Write a manual page for each command
    #[command(after_help = pages::MAN_EXAMPLES)]
    Man(ManArguments),
    /// Make a complete file of a recording that is cut
    #[command(after_help = recover::EXAMPLES)]
    Recover(RecoverArguments),
    /// Write the layout with which Foxglove and Lichtblick show a flight
    #[command(after_help = pages::LAYOUT_EXAMPLES)]
    Layout,
    /// Be one process of a run
    #[command(hide = true)]
    Proc(ProcArguments),
    /// Be another process of a measurement
    #[command(hide = true)]
    BenchPeer,
}

/// Which study.
#[derive(Debug, Subcommand)]
pub(super) enum StudyCommand {
    /// Fly every attitude controller under every position controller and compare them in one table
    #[command(after_help = examples::CONTROLLERS)]
    Controllers(StudyOutput),
    /// Fly figure8-morph at sweeps from 4 s to 0.3 s, with the law scheduled and not
    #[command(after_help = examples::MORPHING)]
    Morphing(MorphingArguments),
    /// Map where the attitude loop is stable: rotor lag, inertia and delay over its weight
    #[command(after_help = examples::STABILITY)]
    Stability(StabilityArguments),
    /// Certify how many changes of its working set one solve of the attitude law can need
    #[command(after_help = examples::WORST_CASE)]
    WorstCase(StabilityArguments),
}

/// Where results go and how much is computed.
#[derive(Debug, Clone, Args)]
pub(super) struct StudyOutput {
    /// Folder for tables, pictures and JSON
    #[arg(long, value_name = "DIR", default_value = "study")]
    pub(super) out: PathBuf,
    /// A small part of it, in seconds
    #[arg(long)]
    pub(super) quick: bool,
    /// Form of the result on stdout
    #[arg(long, value_enum, default_value = "text")]
    pub(super) format: Format,
}

/// The flights of the morphing study.
#[derive(Debug, Clone, Args)]
pub(super) struct MorphingArguments {
    #[command(flatten)]
    pub(super) out: StudyOutput,
    /// Seeds of the scheduled law as flown; 20, or 3 if quick
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub(super) seeds: Option<u64>,
}

/// The attitude loop of a study.
#[derive(Debug, Clone, Args)]
pub(super) struct StabilityArguments {
    #[command(flatten)]
    pub(super) out: StudyOutput,
    /// Control rate, 50 to 1000
    #[arg(long, value_name = "HZ", default_value = "100", value_parser = attitude_rate)]
    pub(super) rate: f64,
    /// Deployable angle
    #[arg(long, value_name = "DEGREES", default_value = "45")]
    pub(super) angle: f64,
}

/// A scenario and what to change in it.
#[derive(Debug, Clone, Args)]
pub struct ScenarioArguments {
    /// Name of a shipped scenario, or path of a scenario file
    #[arg(default_value = "figure8-morph")]
    pub scenario: String,
    /// Simulated time, or logical time that follows the wall clock
    #[arg(long, value_name = "lockstep|realtime")]
    pub clock: Option<String>,
    /// Logical time of the flight: 20s, 500ms, 2m
    #[arg(long = "for", value_name = "DURATION", value_parser = humantime::parse_duration)]
    pub duration: Option<Duration>,
    /// Seed of everything random
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    #[arg(value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: Option<u64>,
    /// Rate of one loop, for example `attitude-mpc=500`
    #[arg(long, value_name = "NAME=HZ")]
    pub rate: Vec<String>,
    /// Who fills a slot, for example `attitude=attitude-lqr`; `check` names them
    #[arg(long, value_name = "SLOT=NAME", value_delimiter = ',')]
    pub crew: Vec<String>,
    /// Any key of the scenario, for example `start.morph_angle_deg=120`
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Logical seconds per wall second
    #[arg(long, value_name = "N|max")]
    pub speed: Option<String>,
    /// Another controller for a slot at a time, for example `attitude=attitude-mpc@4.2s,shadow=1s`
    #[arg(long, value_name = "SLOT=NAME@TIME")]
    pub swap: Vec<String>,
    /// Another instance to keep warm beside a slot's owner, for example `attitude=attitude-pid`
    #[arg(long, value_name = "SLOT=NAME")]
    pub standby: Vec<String>,
    /// Kill or stop a process at a time, for example `kill:estimator@4.2s`
    #[arg(long, value_name = "kill|stop:NAME@TIME")]
    pub fault: Vec<String>,
    /// Realtime: refuse to fly unless the system grants priority, locked memory and processors
    #[arg(long)]
    pub strict: bool,
    /// Leave the plan at a time and rest at a place, for example `1,0,2@3s`
    #[arg(long, value_name = "X,Y,Z[,YAW]@TIME", allow_hyphen_values = true)]
    pub goto: Vec<String>,
    /// Leave the morph schedule at a time, for example `120@3s,over=2s`
    #[arg(long, value_name = "DEGREES@TIME")]
    pub morph: Vec<String>,
}

impl ScenarioArguments {
    /// The flags as edits: the particular ones after `--set`, so that they win.
    ///
    /// # Errors
    /// A flag that is no edit of any scenario.
    pub fn overrides(&self) -> Result<Vec<Override>, ScenarioError> {
        let set = self.set.iter().map(|argument| Override::set(argument));
        let rate = self.rate.iter().map(|argument| Override::rate(argument));
        let swap = self.swap.iter().map(|argument| Override::swap(argument));
        let fault = self.fault.iter().map(|argument| Override::fault(argument));
        let standby = self.standby.iter().map(|argument| Override::standby(argument));
        let crew = self.crew.iter().map(|argument| Override::crew(argument));
        let goto = self.goto.iter().map(|argument| Override::goto(argument));
        let morph = self.morph.iter().map(|argument| Override::morph(argument));
        let orders = goto.chain(morph);
        let all = set.chain(rate).chain(crew).chain(swap).chain(standby).chain(fault).chain(orders);
        let mut overrides = all.collect::<Result<Vec<_>, _>>()?;
        overrides.extend(self.strict.then(|| Override::set("realtime.strict=true")).transpose()?);
        overrides.extend(self.clock.as_deref().map(Override::clock));
        overrides.extend(self.duration.map(Override::duration));
        overrides.extend(self.seed.map(Override::seed));
        overrides.extend(self.speed.as_deref().map(Override::speed));
        Ok(overrides)
    }
}

/// What to fly and how.
#[derive(Debug, Clone, Args)]
pub struct RunArguments {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Folder for the recording
    #[arg(long, value_name = "DIR", default_value = "recordings", conflicts_with = "no_record")]
    pub record: PathBuf,
    /// Record nothing
    #[arg(long)]
    pub no_record: bool,
    /// Fly in one thread, without processes and shared memory: the same flight, faster
    #[arg(long, conflicts_with = "disorder")]
    pub in_process: bool,
    /// Where the processes run: on one processor (auto in lockstep, where it is fastest), on any
    /// (auto in realtime, none), or on a given one
    #[arg(long, value_name = "auto|none|CPU", default_value = "auto", value_parser = pin)]
    pub pin: Pin,
    /// Start order, pauses, processors and priorities by chance, for tests that want disorder
    #[arg(long, value_name = "SEED", hide = true)]
    pub disorder: Option<u64>,
    /// Form of the summary
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

impl RunArguments {
    pub(super) fn options(&self, scenario: Scenario) -> RunOptions {
        let speed = scenario.settings().scenario.pace().map_or(Speed::Max, Speed::Times);
        let record = (!self.no_record).then(|| self.record.clone());
        let progress = std::io::stderr().is_terminal();
        let (pin, disorder) = (self.pin, self.disorder);
        RunOptions { scenario, speed, record, pin, disorder, progress }
    }
}

/// What to do with a recording.
#[derive(Debug, Clone, Args)]
#[command(group(ArgGroup::new("what").required(true).multiple(true)))]
pub struct ReplayArguments {
    /// The recording
    pub file: PathBuf,
    /// Compute its hashes again and compare them with those stored
    #[arg(long, group = "what")]
    pub hash: bool,
    /// Fly each service again on what it had, and compare every output and state bit for bit
    #[arg(long, group = "what")]
    pub verify: bool,
    /// Only this service, for example `plant`; of a slot that changed hands `attitude`, `attitude-lqr`,
    /// `attitude@1` for whoever sat on seat 1, or `attitude-lqr@1`
    #[arg(long, value_name = "NAME")]
    pub service: Vec<String>,
    /// Let another controller replay and say how far it departs: a service, or another build
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

/// Many flights.
#[derive(Debug, Clone, Args)]
pub struct CampaignArguments {
    /// File that names scenario, seeds and grid
    pub file: PathBuf,
    /// Folder for journal and tables; what the file says, or campaigns/NAME
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Throw away what an earlier run has flown
    #[arg(long)]
    pub restart: bool,
    /// Form of the summary
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
    #[arg(long = "for", value_name = "DURATION", value_parser = humantime::parse_duration, requires = "branch", conflicts_with_all = OF_RECORDED)]
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
    /// Folder for the table of many branches
    #[arg(long, value_name = "DIR", default_value = "branches", requires = "branch", conflicts_with_all = OF_RECORDED)]
    pub out: PathBuf,
}

/// What to reproduce.
#[derive(Debug, Clone, Args)]
pub struct PaperArguments {
    /// Folder for tables, trajectories and pictures
    #[arg(long, value_name = "DIR", default_value = "paper")]
    pub out: PathBuf,
    /// One test alone: 1 rates, 2 horizons, 3 sizes and disturbance
    #[arg(long, value_name = "1|2|3", value_parser = clap::value_parser!(u8).range(1..=3))]
    pub test: Option<u8>,
    /// Form of what is printed
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Form of a command's result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people
    Text,
    /// For machines
    Json,
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

fn pin(text: &str) -> Result<Pin, String> {
    match text {
        "auto" => Ok(Pin::Auto),
        "none" => Ok(Pin::None),
        cpu => cpu
            .parse()
            .map(Pin::Cpu)
            .map_err(|_| format!("`{cpu}` is no CPU: write auto, none or a number from 0")),
    }
}

const NEW_CONTROLLER_EXAMPLES: &str = "\
Examples:
  morphquad new-controller my-controller
  morphquad new-controller my-planner --slot position --dir ~/controllers/my-planner";

/// What to begin a controller with.
#[derive(Debug, Clone, Args)]
pub struct NewControllerArguments {
    /// Name of the crate and of its executable
    pub name: String,
    /// Slot that it flies
    #[arg(long, value_name = "attitude|position", default_value = "attitude")]
    pub slot: String,
    /// Folder to make; NAME if left out
    #[arg(long, value_name = "DIR")]
    pub dir: Option<PathBuf>,
    /// Source tree of morphquad to build against; the one that this executable is from if left out
    #[arg(long, value_name = "DIR")]
    pub path: Option<PathBuf>,
}

/// For which language, and where to.
#[derive(Debug, Clone, Args)]
#[command(group(ArgGroup::new("language").required(true)))]
pub struct TypesArguments {
    /// As ctypes structures of Python 3
    #[arg(long, group = "language")]
    pub python: bool,
    /// File to write; stdout if left out
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Everything one process of a run is told.
#[derive(Debug, Clone, Args)]
pub struct ProcArguments {
    /// Which service to be
    pub service: String,
    /// Where it takes part.
    #[command(flatten)]
    pub place: PlaceArguments,
}
