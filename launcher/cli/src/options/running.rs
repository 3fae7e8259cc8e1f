//! Arguments of the commands to a running flight.

use super::Format;
use super::duration::duration;
use clap::Args;
use core::time::Duration;
use scenario::candidate::share;
use std::path::PathBuf;

pub(super) const PS_EXAMPLES: &str = "\
Examples:
  morphquad ps
  morphquad ps --run 7f3a --format json

AT is the first instant that a process has not yet published completely, AGE the wall time since this \
last advanced. CPU counts from the start of the process, RSS with the memory that processes share. \
Ends with 2 if no run is active, or several and none is named.";

pub(super) const SWAP_EXAMPLES: &str = "\
Examples:
  morphquad swap attitude --to attitude-mpc
  morphquad swap attitude --to ./target/release/morphquad-mine --shadow 1s --dry-run
  morphquad swap attitude --to attitude-mpc@1

`@1` is the instance on seat 1, such as the standby. The candidate shadows the owner, is judged by the gate, is flown ahead for 3 s in a simulation of its own \
if it is of another kind or build, and takes over at an instant agreed on before; the old owner stays warm for the \
rollback window, and after it if the new one is not built in. Interrupting this command does not stop the swap. \
Ends with 0 when the window is over; 1 if the gate refused or something failed, and the owner commands as \
before; 2 for an unknown slot or name, no run or several, or an instance that owns the slot already; 3 if \
another swap is in progress.";

pub(super) const ADOPT_EXAMPLES: &str = "\
Examples:
  morphquad adopt
  morphquad adopt 7f3a --record ./rescued

When the launcher of a realtime flight dies, its processes fly on for launcher.launcher_grace_s, 30 s of the \
flight unless the scenario sets another time: as planned and ordered, warm fallbacks take over, and nothing is restarted. \
Then the vehicle lands, and they leave. This command leads the flight to its end, as `run` would have: restarts, orders, summary, and a recording from here \
on. Ends as `run` does; 2 if it is not clear which run is meant, or it flies in lockstep, and 3 if a launcher \
leads it, it never started, or it is of another build: the run then goes on as it was.";

/// A running flight.
#[derive(Debug, Clone, Args)]
pub struct RunChoice {
    /// The run, by its ID or the beginning of it; not needed if there is only one
    #[arg(long, value_name = "ID")]
    pub run: Option<String>,
}

/// What to show of a running flight.
#[derive(Debug, Clone, Args)]
pub struct PsArguments {
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the answer
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

pub(super) const STOP_EXAMPLES: &str = "\
Examples:
  morphquad stop
  morphquad stop --run 7f3a

As Ctrl-C at the launcher: the flight ends in order, and its recording is complete.";

/// A run to end.
#[derive(Debug, Clone, Args)]
pub struct StopArguments {
    /// Which run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the answer
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// A run to lead to its end.
#[derive(Debug, Clone, Args)]
pub struct AdoptArguments {
    /// The run, by its ID or the beginning of it; the only one without a launcher if left out
    pub run: Option<String>,
    /// Folder for the recording; beside the one before if left out
    #[arg(long, value_name = "DIR", conflicts_with = "no_record")]
    pub record: Option<PathBuf>,
    /// Record nothing
    #[arg(long)]
    pub no_record: bool,
    /// Form of the summary
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Another controller for a slot.
#[derive(Debug, Clone, Args)]
pub struct SwapArguments {
    /// `attitude` or `position`
    pub slot: String,
    /// A controller or an executable, of which a new instance is started, or NAME@SEAT
    #[arg(long, value_name = "NAME|EXE")]
    pub to: String,
    /// Scenario that configures it; the flight's if left out
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// How long it shadows before it is judged
    #[arg(long, value_name = "DURATION", default_value = "1s", allow_hyphen_values = true, value_parser = duration)]
    pub shadow: Duration,
    /// How far (rms) it may disagree with the owner, as a share of the largest command, however hard
    /// that works; left out, 1% for the same kind, 10% and more where the owner works hard for another
    #[arg(long, value_name = "PERCENT", value_parser = bump)]
    pub max_bump: Option<f64>,
    /// How long the old owner stays warm
    #[arg(long, value_name = "DURATION", default_value = "500ms", allow_hyphen_values = true, value_parser = duration)]
    pub rollback: Duration,
    /// Take over although the gate finds that it disagrees, or the rehearsal that it fails
    #[arg(long)]
    pub force: bool,
    /// Rehearsal.
    #[command(flatten)]
    pub rehearsal: RehearsalChoice,
    /// Shadow and judge only
    #[arg(long)]
    pub dry_run: bool,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the lines
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// A slot to give back.
#[derive(Debug, Clone, Args)]
pub struct RollbackArguments {
    /// `attitude` or `position`
    pub slot: String,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the lines
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// An instance to send away.
#[derive(Debug, Clone, Args)]
pub struct RetireArguments {
    /// Its name, or NAME@SEAT if others have the same
    pub name: String,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the lines
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// A fallback to keep.
#[derive(Debug, Clone, Args)]
pub struct StandbyArguments {
    /// `attitude` or `position`
    pub slot: String,
    /// A controller or an executable
    #[arg(value_name = "NAME|EXE")]
    pub name: String,
    /// How long it shadows before it is judged
    #[arg(long, value_name = "DURATION", default_value = "500ms", allow_hyphen_values = true, value_parser = duration)]
    pub shadow: Duration,
    /// Rehearsal.
    #[command(flatten)]
    pub rehearsal: RehearsalChoice,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the lines
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Whether a candidate is flown ahead.
#[derive(Debug, Clone, Copy, Args)]
pub struct RehearsalChoice {
    /// Fly it ahead although it is of the owner's kind and build
    #[arg(long, conflicts_with = "no_rehearsal")]
    pub rehearse: bool,
    /// Do not fly it ahead, whatever it is
    #[arg(long)]
    pub no_rehearsal: bool,
}

impl RehearsalChoice {
    /// What was chosen; `None` leaves it to the launcher.
    #[must_use]
    pub fn choice(self) -> Option<bool> {
        (self.rehearse || self.no_rehearsal).then_some(self.rehearse)
    }
}

fn bump(text: &str) -> Result<f64, String> {
    share(text).ok_or_else(|| format!("`{text}` is no share: write 1% or 0.01"))
}
