//! `morphquad bench`: how long everything takes in the real flight, with the machine's own noise beside it.
//!
//! Durations count from the instant at which something should have happened, none is left out, and each
//! figure stands beside its floor: the same measured in the same run with nothing of ours in between.

pub mod alone;
pub mod facts;
pub mod fleet;
pub mod floor;
pub mod gate;
pub mod hop;
pub mod loops;
pub mod measure;
pub mod page;
pub mod peer;
pub mod pictures;
pub mod place;
pub mod rate;
pub mod report;
pub mod series;
pub mod timing;

use document::ScenarioError;
use figures::figure::us;
use figures::results::ResultsError;
use host::exit;
use miette::Diagnostic;
use runtime::clock::mono_now_ns;
use runtime::ipc::PortError;
use runtime::leader::LeadError;
use simulate::RunError;
use simulate::in_process::InProcessError;
use thiserror::Error;

/// Why nothing was measured.
#[derive(Debug, Error, Diagnostic)]
pub enum BenchError {
    /// The scenario cannot be flown.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scenario(#[from] ScenarioError),
    /// A scenario that can be read once only.
    #[error("`bench rate` flies the scenario many times, and standard input can be read once")]
    #[diagnostic(help("write it to a file, and give that"))]
    StandardInput,
    /// What cannot be measured.
    #[error("{flag}: loops are measured in realtime, at speed 1")]
    #[diagnostic(help("leave it out"))]
    Realtime {
        /// What asks for something else.
        flag: &'static str,
    },
    /// Nothing would be left to measure.
    #[error("--warm-up {warm_up_s} s is more than half of a flight of {flown_s} s")]
    #[diagnostic(help("fly for longer, with --for, or warm up for less"))]
    WarmUp {
        /// As asked for \[s\].
        warm_up_s: f64,
        /// Duration of the flight \[s\].
        flown_s: f64,
    },
    /// The flight never began.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The run's folder.
    #[error(transparent)]
    Lead(#[from] LeadError),
    /// The transport.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The scenario cannot be wired.
    #[error("{0}")]
    Wiring(String),
    /// The scenario cannot be flown in one process.
    #[error("without processes: {0}")]
    Alone(InProcessError),
    /// A file cannot be compared with.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Compare(#[from] gate::CompareError),
    /// A gate that needs an earlier result.
    #[error("--gate with a growth such as +10% needs --compare FILE")]
    #[diagnostic(help(
        "save a result with --save FILE and compare with it, or give a limit such as p99:200us or p99:1.2x"
    ))]
    NothingToCompare,
    /// A limit over the floor, which is not to be measured.
    #[error("--gate with a multiple such as 1.2x needs the floor, and --no-floor leaves it out")]
    #[diagnostic(help("leave --no-floor away, or give a limit such as p99:200us"))]
    NoFloor,
    /// A flight of the measurement could not begin.
    #[error("a flight could not begin: {0}")]
    #[diagnostic(help("`morphquad doctor` shows what this machine lacks"))]
    Unfit(String),
    /// A result could not be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Results(#[from] ResultsError),
    /// A processor that this machine, or this process, does not have.
    #[error("--cpus {cpu}: this process may run on {allowed} only")]
    #[diagnostic(help("name some of those, or leave --cpus away"))]
    NoSuchCpu {
        /// As asked for.
        cpu: usize,
        /// As possible, separated by commas.
        allowed: String,
    },
    /// Another process of the measurement.
    #[error("a peer of the measurement {0}")]
    #[diagnostic(help("the machine may be too busy, or short of memory: try again"))]
    Peer(String),
    /// Something of the operating system.
    #[error("cannot {action}: {source}")]
    System {
        /// What was tried.
        action: String,
        /// Why it failed.
        source: std::io::Error,
    },
}

impl BenchError {
    /// What the command ends with.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Scenario(_)
            | Self::Compare(_)
            | Self::NothingToCompare
            | Self::NoFloor
            | Self::StandardInput
            | Self::Realtime { .. }
            | Self::WarmUp { .. }
            | Self::NoSuchCpu { .. }
            | Self::Run(RunError::NoSuchProcessor { .. }) => exit::USAGE,
            Self::Run(RunError::Interrupted) => exit::INTERRUPTED,
            _ => exit::UNFIT,
        }
    }
}

/// Name of a run that carries no flight.
fn run_id() -> String {
    format!("b{:04x}{:05x}", std::process::id() & 0xffff, (mono_now_ns() / 1000) & 0xf_ffff)
}

/// A ratio, or a dash where there is none.
fn ratio(ratio: Option<f64>) -> String {
    ratio.map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}"))
}
