//! Arguments of `morphquad top`.

use super::{Format, RunChoice};
use clap::Args;

pub(super) const TOP_EXAMPLES: &str = "\
Examples:
  morphquad top
  morphquad top --once
  morphquad top --once --format json

LATE is from a step's intended release to its start, STEP what it then took, AGE how old the inertial sample \
was that it descends from: medians of the last second (u for us, m for ms). MISS counts releases left out and \
deadlines missed in the whole flight, Q releases that the plant has passed and the loop has not published. EP \
is the epoch of a slot's owner, GEN how often a process was restarted. \
Keys: s swap, r roll back, d disturb, m morph, g goto; each begins a command line, which Enter carries out \
and Esc drops. q ends. Ends with 2 if no run is active, or several and none is named.";

/// What to watch.
#[derive(Debug, Clone, Args)]
pub struct TopArguments {
    /// Look for a second, show it and end; so too where output is no terminal
    #[arg(long)]
    pub once: bool,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of what is shown once
    #[arg(long, value_enum, default_value = "text", requires = "once")]
    pub format: Format,
}
