//! The grammar of the command line; `running` has the commands to a running flight.

mod bench;
mod demo;
pub(crate) mod doctor;
mod duration;
mod examples;
mod groups;
mod live;
mod orders;
mod pages;
mod plot;
mod recordings;
mod recover;
mod rehearse;
mod replay;
pub(crate) mod report;
mod run;
mod running;
mod scenario;
mod scenario_name;
mod study;
mod top;
mod topic;
pub(crate) mod trace;
pub(crate) mod view;

pub use demo::DemoArguments;
pub use doctor::DoctorArguments;
pub(super) use live::LiveArguments;
pub use live::LiveFlags;
pub use replay::{BranchArguments, ReplayArguments};
pub use report::ReportArguments;
pub use run::{RunArguments, ScenarioArguments};
pub use running::{
    AdoptArguments, PsArguments, RetireArguments, RollbackArguments, RunChoice, StandbyArguments,
    StopArguments, SwapArguments,
};
pub(super) use study::{
    MorphingArguments, RandomArguments, StabilityArguments, StudyCommand, StudyOutput,
    TimingArguments, TuningArguments,
};
pub use trace::TraceArguments;
pub use view::ViewArguments;

pub use self::scenario::{
    ScenarioCommand, ScenarioKeysArguments, ScenarioNewArguments, ScenarioShowArguments,
};
pub use bench::{
    BenchCommand, HopArguments, LoopsArguments, PlaceArguments as MeasurePlace, RateArguments,
    TableFormat, scenario_arguments,
};
pub use orders::{DisturbArguments, GotoArguments, MorphArguments};
pub use pages::{CompletionsArguments, LayoutArguments, ManArguments};
pub use plot::PlotArguments;
pub use recordings::{RecordingsCommand, RecordingsListArguments, RecordingsShowArguments};
pub use recover::RecoverArguments;
pub use rehearse::RehearseArguments;
pub use top::TopArguments;
pub use topic::{
    SampleFormat, TopicCommand, TopicEchoArguments, TopicExportArguments, TopicHzArguments,
    TopicInfoArguments, TopicListArguments,
};

use clap::{
    Arg, ArgGroup, Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand, ValueEnum,
};
use groups::grouped;
use host::PlaceArguments;
use std::ffi::OsString;
use std::path::PathBuf;

/// Fly a morphing quadrotor as a set of real processes over shared memory.
#[derive(Debug, Parser)]
#[command(name = "morphquad", version, max_term_width = 100)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Command,
}

impl Cli {
    /// What the arguments mean. A negative number after a flag is its value, to be refused as such, and
    /// not an unexpected argument.
    ///
    /// # Errors
    /// They mean nothing, or ask for help.
    pub(super) fn of(arguments: &[OsString]) -> Result<Self, clap::Error> {
        let command = with_negative_numbers(grouped(Self::command())).version(version());
        Self::from_arg_matches(&command.try_get_matches_from(arguments)?)
    }
}

/// Version and commit of the executable.
fn version() -> String {
    format!("{} ({})", env!("CARGO_PKG_VERSION"), record::build::declared().git)
}

fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let is_flag = |arg: &Arg| arg.get_long().is_some() && arg.get_action().takes_values();
    let command =
        command.mut_args(|arg| if is_flag(&arg) { arg.allow_negative_numbers(true) } else { arg });
    command.mut_subcommands(with_negative_numbers)
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Fly a scenario
    #[command(after_help = examples::RUN)]
    Run(RunArguments),
    /// Fly a demonstration in the browser, with buttons to try
    #[command(after_help = demo::EXAMPLES)]
    Demo(DemoArguments),
    /// Name the scenarios that come with morphquad
    #[command(after_help = examples::LIST)]
    List(ListArguments),
    /// Show what a scenario would fly, or what is wrong with it
    #[command(after_help = examples::CHECK)]
    Check(CheckArguments),
    /// Begin a scenario of one's own, show one, or list what can be set
    #[command(subcommand)]
    Scenario(ScenarioCommand),
    /// Show processes and slots of a running flight
    #[command(after_help = running::PS_EXAMPLES)]
    Ps(PsArguments),
    /// Let another controller take over a slot, attitude or position, of a running flight
    #[command(after_help = running::SWAP_EXAMPLES)]
    Swap(SwapArguments),
    /// Say whether a controller may take a slot over, by flying it ahead
    #[command(after_help = rehearse::EXAMPLES)]
    Rehearse(RehearseArguments),
    /// Undo a swap: give the slot back to the controller before it
    #[command(after_help = "Example:\n  morphquad rollback attitude")]
    Rollback(RollbackArguments),
    /// Stop a controller that runs beside the one in command
    #[command(
        after_help = "Examples:\n  morphquad retire attitude-lqr\n  morphquad retire attitude-mpc@1"
    )]
    Retire(RetireArguments),
    /// Keep an instance warm that takes a slot over when its owner fails
    #[command(after_help = "Example:\n  morphquad standby attitude attitude-mpc")]
    Standby(StandbyArguments),
    /// Send the vehicle of a running flight to a place
    #[command(after_help = orders::GOTO_EXAMPLES)]
    Goto(GotoArguments),
    /// Fold or spread the arms of a running flight
    #[command(after_help = orders::MORPH_EXAMPLES)]
    Morph(MorphArguments),
    /// End a running flight in order, with its recording complete
    #[command(after_help = running::STOP_EXAMPLES)]
    Stop(StopArguments),
    /// Serve a running flight to browsers and Foxglove
    #[command(after_help = live::EXAMPLES)]
    Live(LiveArguments),
    /// Disturb a running flight
    #[command(after_help = orders::DISTURB_EXAMPLES)]
    Disturb(DisturbArguments),
    /// Watch a running flight
    #[command(after_help = top::TOP_EXAMPLES)]
    Top(TopArguments),
    /// Look at the topics of a running flight; `echo` and others read recordings
    #[command(subcommand)]
    Topic(TopicCommand),
    /// Take over a realtime flight whose launcher has died
    #[command(after_help = running::ADOPT_EXAMPLES)]
    Adopt(AdoptArguments),
    /// Fly a recording again: bit by bit, with another controller, or branched
    #[command(after_help = examples::REPLAY)]
    Replay(ReplayArguments),
    /// Check whether this machine can fly in realtime, and what is in the way
    #[command(after_help = doctor::EXAMPLES)]
    Doctor(DoctorArguments),
    /// Follow the wrench commands of a recording back to their IMU samples
    #[command(after_help = trace::EXAMPLES)]
    Trace(TraceArguments),
    /// Show a recording in the browser: the vehicle, every constraint, what happened
    #[command(after_help = view::EXAMPLES)]
    View(ViewArguments),
    /// Draw numbers of a recording over time
    #[command(after_help = plot::EXAMPLES)]
    Plot(PlotArguments),
    /// Judge a recording: pass or fail and why, every number with its limit, pictures
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
    /// Measure latencies of loops, paths and hops beside the machine's own noise
    #[command(subcommand, after_help = bench::EXAMPLES)]
    Bench(BenchCommand),
    /// Write a small crate that flies a slot, to begin one's own controller with
    #[command(after_help = NEW_CONTROLLER_EXAMPLES)]
    NewController(NewControllerArguments),
    /// Write the types of the samples for another language
    #[command(after_help = examples::TYPES)]
    Types(TypesArguments),
    /// Write what a shell needs to complete commands
    #[command(after_help = pages::COMPLETIONS_EXAMPLES)]
    Completions(CompletionsArguments),
    /// Write a manual page for each command
    #[command(after_help = pages::MAN_EXAMPLES)]
    Man(ManArguments),
    /// List the recordings that there are, or describe one of them
    #[command(subcommand)]
    Recordings(RecordingsCommand),
    /// Make a complete file of a recording that is cut
    #[command(after_help = recover::EXAMPLES)]
    Recover(RecoverArguments),
    /// Write a layout of a flight for Foxglove, Lichtblick or `plotjuggler`
    #[command(after_help = pages::LAYOUT_EXAMPLES)]
    Layout(LayoutArguments),
    /// Be one process of a run
    #[command(hide = true)]
    Proc(ProcArguments),
    /// Be another process of a measurement
    #[command(hide = true)]
    BenchPeer,
}

/// Which form.
#[derive(Debug, Clone, Args)]
pub struct ListArguments {
    /// Form of the list
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// What to check.
#[derive(Debug, Clone, Args)]
pub struct CheckArguments {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Form of what would be flown
    #[arg(long, value_enum, default_value = "text")]
    pub format: CheckFormat,
}

/// Form of what would be flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CheckFormat {
    /// For people
    Text,
    /// The whole scenario as a file, keys that were left out with their defaults
    Toml,
    /// Loops, edges and the whole scenario, for machines
    Json,
}

/// Many flights.
#[derive(Debug, Clone, Args)]
pub struct CampaignArguments {
    /// File that names scenario, seeds and grid
    pub file: PathBuf,
    /// Folder for journal and tables; what the file names, or campaigns/NAME
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Throw away what an earlier run has flown
    #[arg(long)]
    pub restart: bool,
    /// Form of the summary
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
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

/// The arguments of one process of a run.
#[derive(Debug, Clone, Args)]
pub struct ProcArguments {
    /// Which service to be
    pub service: String,
    /// Where it takes part.
    #[command(flatten)]
    pub place: PlaceArguments,
}
