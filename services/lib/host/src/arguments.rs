//! The arguments that name the run and the place in it that a process takes.

use clap::Args;
use runtime::Place;
use std::path::PathBuf;

/// The arguments that the launcher gives to every process.
#[derive(Debug, Clone, Args)]
pub struct PlaceArguments {
    /// Folder of the run to join
    #[arg(long, value_name = "FOLDER")]
    pub run: PathBuf,
    /// How many processes have had the seat before
    #[arg(long, value_name = "N")]
    pub generation: u32,
    /// Process to outlive by grace and landing at most
    #[arg(long, value_name = "PID")]
    pub launcher_pid: u32,
    /// Which of the role's seats to take
    #[arg(long, value_name = "N", default_value = "0")]
    pub seat: u32,
    /// Begin where, and from what state, a hand-over asks
    #[arg(long)]
    pub await_handover: bool,
    /// Configuration of its own: TOML for a controller, a scenario for a service
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Processor to stay on
    #[arg(long, value_name = "CPU")]
    pub cpu: Option<usize>,
    /// How much to stand back for others
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub nice: Option<i32>,
}

impl PlaceArguments {
    /// The seat within the role, and who takes it.
    #[must_use]
    pub fn place(&self) -> Place {
        Place { seat: self.seat, generation: self.generation }
    }
}
