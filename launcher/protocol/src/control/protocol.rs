//! What can be asked of a running flight, and what it answers.

use super::status::RunStatus;
use core::fmt;
use host::exit;
use scenario::orders;
use scenario::script::{SHADOW_S, STANDBY_SHADOW_S};
use serde::{Deserialize, Serialize};
use shared_types::time::ns_from_s;
use std::path::PathBuf;

/// One line towards the launcher, for example `{"request":"ps"}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// How processes and slots are doing.
    Ps,
    /// Another controller is to command a slot.
    Swap(SwapRequest),
    /// Back to the old owner, while it is still warm.
    Rollback { slot: String },
    /// An instance that does not command is to leave.
    Retire {
        /// Its name, with its seat if others have the same: `attitude-mpc@1`.
        name: String,
    },
    /// Keep an instance warm beside the owner, which takes over when the owner fails.
    Standby {
        slot: String,
        /// Controller, or path of an executable.
        name: String,
        /// How long it shadows before it is judged \[ns\].
        #[serde(default = "standby_shadow_ns")]
        shadow_ns: u64,
        /// Whether it is flown ahead first; if left out, it is when it differs from the owner.
        #[serde(default)]
        rehearse: Option<bool>,
    },
    /// The flight is to end in order, as if it had been interrupted.
    Stop,
    /// Another place to go, another width of the arms, or a disturbance.
    Order {
        /// What.
        order: orders::Order,
    },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SwapRequest {
    pub slot: String,
    /// Controller or path of an executable, of which a new instance is started; or one that is there.
    pub to: String,
    /// Path of a scenario that configures it, if not the flight's.
    #[serde(default)]
    pub config: Option<PathBuf>,
    /// How long it shadows before it is judged \[ns\].
    #[serde(default = "shadow_ns")]
    pub shadow_ns: u64,
    /// How far (rms) it may disagree with the owner, over the largest command; what suits the kind if left out.
    #[serde(default)]
    pub max_bump: Option<f64>,
    /// How long the old owner stays warm \[ns\].
    #[serde(default = "rollback_ns")]
    pub rollback_ns: u64,
    /// Overrule the gate where it is about disagreement, and the rehearsal.
    #[serde(default)]
    pub force: bool,
    /// Whether it is flown ahead before the flip; if left out, it is when it is of another kind or
    /// build than the owner.
    #[serde(default)]
    pub rehearse: Option<bool>,
    /// Shadow and judge only.
    #[serde(default)]
    pub dry_run: bool,
}

fn shadow_ns() -> u64 {
    ns_from_s(SHADOW_S)
}

fn standby_shadow_ns() -> u64 {
    ns_from_s(STANDBY_SHADOW_S)
}

fn rollback_ns() -> u64 {
    500_000_000
}

/// One line from the launcher, for example `{"reply":"refused","reason":"bad_request",...}`.
#[expect(clippy::large_enum_variant, reason = "a few per second, each written out and forgotten")]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reply", rename_all = "snake_case")]
pub enum Reply {
    /// To [`Request::Ps`].
    Status(RunStatus),
    /// A step on the way; more follows.
    Progress(Progress),
    /// It was done as asked.
    Done(Done),
    /// Pilot or injector have it, and do it from the instant that is named.
    Ordered(orders::OrderReport),
    /// No, or it came to nothing; the owner commands as before.
    Refused(Refusal),
}

/// A step on the way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    pub slot: String,
    /// For programs: `joined`, `shadowing`, `gate`, `fails`, `flips`, `flipped` and others.
    pub step: String,
    /// Logical instant that it is about \[ns\].
    pub at_ns: Option<u64>,
    /// For people.
    pub text: String,
    /// What the gate measured, with the step `gate`.
    pub figures: Option<Figures>,
    /// Where the vehicle was when its rehearsal failed, with the step `fails`: instant \[s\], x, y and z \[m\] in the
    /// world and attitude, body to world, as w, x, y, z.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub course: Vec<[f64; 8]>,
}

/// What the gate measured: disagreement of candidate and owner per axis, over the largest command.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Instants compared one step ahead.
    pub tracked: u64,
    /// Instants compared while it ran free.
    pub free: u64,
    /// Worst, one step ahead.
    pub tracking_worst: [f64; 4],
    /// Worst, running free.
    pub free_worst: [f64; 4],
    /// Root mean square, running free.
    pub free_rms: [f64; 4],
    /// Slope over the owner's commands; `None` where the owner was quiet.
    pub slope: [Option<f64>; 4],
    /// Deadlines missed.
    pub missed: u64,
    /// The most that `tracking_worst` may be.
    pub tracking_worst_max: [f64; 4],
    /// The most that `free_worst` may be.
    pub free_worst_max: [f64; 4],
    /// The most that `free_rms` may be.
    pub free_rms_max: [f64; 4],
    /// The most that `missed` may be.
    pub missed_max: u64,
}

/// The good end of an order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Slot; empty if it is about the flight as a whole.
    pub slot: String,
    /// For programs: `swapped`, `rolled back`, `dry run`, `stands by`, `retired` or `stopping`.
    pub outcome: String,
    /// For people.
    pub text: String,
}

impl Done {
    /// To [`Request::Stop`].
    #[must_use]
    pub fn stopping() -> Self {
        let text = "the flight ends in order".to_owned();
        Self { slot: String::new(), outcome: "stopping".to_owned(), text }
    }
}

/// Why not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// For programs.
    pub reason: Reason,
    /// What a command that asked ends with.
    pub exit_code: u8,
    /// For people: what, where, and what to do about it.
    pub text: String,
}

/// Kinds of refusal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// No request of this launcher, too long, or too slow in coming.
    BadRequest,
    /// The flight has no such slot.
    UnknownSlot,
    /// No controller answers to a name.
    UnknownName,
    /// It cannot be asked of that instance, or not now that things are as they are.
    NoSense,
    /// A number that cannot be ordered.
    OutOfRange,
    /// Something else is going on in the slot.
    Busy,
    /// The gate let the candidate not through.
    Gate,
    /// Flown ahead, the candidate failed, or it could not be flown ahead.
    Rehearsal,
    /// A process failed on the way.
    Failed,
    /// More conversations than the launcher holds at a time.
    TooMany,
}

impl Reason {
    /// What a slot's state machine means.
    #[must_use]
    pub fn of(reason: &slot::Reason) -> Self {
        match (reason, reason.exit_code()) {
            (slot::Reason::Gate(_), _) => Self::Gate,
            (slot::Reason::Rehearsal(_), _) => Self::Rehearsal,
            (_, exit::USAGE) => Self::NoSense,
            (_, exit::UNFIT) => Self::Busy,
            _ => Self::Failed,
        }
    }

    /// What a command ends with that was refused so.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        match self {
            Self::BadRequest
            | Self::UnknownSlot
            | Self::UnknownName
            | Self::NoSense
            | Self::OutOfRange => exit::USAGE,
            Self::Gate | Self::Rehearsal | Self::Failed => exit::FAILED,
            Self::Busy | Self::TooMany => exit::UNFIT,
        }
    }
}

impl Refusal {
    /// A refusal with the exit code of its reason.
    #[must_use]
    pub fn new(reason: Reason, text: impl Into<String>) -> Self {
        Self { reason, exit_code: reason.exit_code(), text: text.into() }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Reply {
    /// True if no other reply to the same request follows.
    #[must_use]
    pub fn is_last(&self) -> bool {
        match self {
            Self::Status(_) | Self::Done(_) | Self::Ordered(_) | Self::Refused(_) => true,
            Self::Progress(_) => false,
        }
    }
}
