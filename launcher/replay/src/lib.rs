//! `morphquad replay`: flies a recording's components again on what they had, and compares.
//!
//! What a step saw is determined by the recording: nominally all samples in effect, and the topic
//! `deviation` records every exception, so the same executor with the same inputs must give the same
//! bits, in both clocks. Open `again.rs` for one component, `source.rs` for one input, `compare.rs`
//! for samples and states, `departure.rs` for another controller on the same inputs.

mod again;
mod compare;
mod component_topics;
mod course;
mod departure;
mod fields;
mod hashes;
mod life_key;
mod lives;
mod other;
mod pairs;
mod parting;
mod report;
mod source;
mod tapes;
mod timing;

pub use compare::{Difference, ServiceVerdict, Verification, verify};
pub use departure::{Departure, FieldDeparture, With, depart, write_outputs};
pub use fields::Number;
pub use hashes::{Hashes, hashes};
pub use lives::{Instance, Selection};

pub use course::{Course, Repeats};
pub use pairs::{Pair, difference, pairs};
pub use parting::{Cause, Parting, are_of_one_scenario, parting};
pub use tapes::Loss;
pub use timing::{TimingError, timing_of};

use components::BuildError;
use document::ScenarioError;
use record::read::{ReadError, RecordedFlight};
use record::{Branched, Continued, RecordError};
use runtime::RestoreError;
use shared_types::Role;
use thiserror::Error;

/// Why a recording cannot be flown again.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Flown with two scenarios, of which it holds the second.
    #[error(
        "this recording is {0}: what is before was flown with another scenario and cannot be \
         flown again with this one; take the recording of run {run}, and repeat the branch from it",
        run = .0.parent_run
    )]
    Branched(Branched),
    /// It begins in the middle of a flight.
    #[error(
        "this recording is, {0}: what the loops knew by then is in none of its samples, so that they \
         cannot be flown again; `--hash` checks what it holds"
    )]
    Continued(Continued),
    /// Its loops cannot be wired.
    #[error("the recorded scenario cannot be wired: {0}")]
    Wiring(String),
    /// A role that took no part.
    #[error("{role} took no part in this flight: leave --service out, or name another")]
    NotFlown {
        /// Label of the role.
        role: &'static str,
    },
    /// A component refuses its configuration.
    #[error("{role}: {error}")]
    Component {
        /// Label of the role.
        role: &'static str,
        /// Its complaint.
        error: String,
    },
    /// The recording lacks the state from which a restarted process went on.
    #[error(
        "{role} was restarted from its state of release {release}, which is not in the recording: it \
         can be replayed up to the restart only"
    )]
    NoState {
        /// Label of the role.
        role: &'static str,
        /// Release of the state.
        release: u64,
    },
    /// A recorded state does not fit.
    #[error("{role}: {error}")]
    Restore {
        /// Label of the role.
        role: &'static str,
        /// What does not fit.
        error: RestoreError,
    },
    /// Settings for the other controller.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// Another build could not do its part.
    #[error("{executable} cannot replay this recording: {reason}")]
    Other {
        executable: String,
        /// The error of it, or of the system.
        reason: String,
    },
    /// No instance of that name, or on that seat.
    #[error("no {asked} took part in this flight: there were {flew}")]
    NoInstance {
        /// As asked for.
        asked: String,
        /// What flew.
        flew: String,
    },
    /// Several controllers had a slot.
    #[error(
        "several controllers flew in the {role} slot, {flew}: name with --service which one is meant"
    )]
    Several {
        /// Label of the role.
        role: &'static str,
        /// What flew.
        flew: String,
    },
    /// The user ended it.
    #[error("interrupted: the other build was stopped, and nothing is left of what it wrote")]
    Interrupted,
    /// The replayed outputs cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
}

/// What was flown with two scenarios is no flight of the one that the file holds, and half a flight is none.
fn refuse_branched(flight: &RecordedFlight) -> Result<(), ReplayError> {
    if let Some(continued) = flight.continued() {
        return Err(ReplayError::Continued(continued));
    }
    flight.branched().map_or(Ok(()), |branched| Err(ReplayError::Branched(branched.clone())))
}

impl ReplayError {
    fn component(role: Role) -> impl FnOnce(BuildError) -> Self {
        move |error| Self::Component { role: role.label(), error: error.to_string() }
    }
}
