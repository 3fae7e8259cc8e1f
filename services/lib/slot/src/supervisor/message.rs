//! The events that the supervisor receives, and the actions that it requests.

use super::instances::{Instance, Program};
use super::reason::{Fault, RehearsalRefusal};
use super::report::Report;
use crate::gate::{GateFigures, Refusal};
use crate::record::{Record, Seat};

/// Where time is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Now {
    /// Everything before this instant has been seen \[ns\].
    pub logical_ns: u64,
    /// Lockstep: nothing at or after this instant has run \[ns\]. Realtime: the same as
    /// `logical_ns`.
    pub allowed_ns: u64,
}

/// What is to command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Target {
    /// A new instance of a program.
    New(Program),
    /// One that is already there, such as the standby.
    Seated(Seat),
}

/// How a swap is to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SwapTerms {
    /// How long the candidate shadows before it is judged \[ns\].
    pub shadow_ns: u64,
    /// How long the old owner stays as the fallback \[ns\].
    pub rollback_ns: u64,
    /// Overrule the gate where it is about disagreement, and the rehearsal. The candidate is not trusted then.
    pub force: bool,
    /// Fly the candidate ahead before the flip, and let that decide.
    pub rehearse: bool,
    /// Judge only.
    pub dry_run: bool,
}

/// What a user or a script asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Request {
    /// Another instance is to command.
    Swap(Target, SwapTerms),
    /// Back to the old owner, while its window is open.
    Rollback,
    /// An instance that does not command is to leave.
    Retire(Seat),
    /// Keep an instance of this program warm beside the owner: it shadows for this long \[ns\], is
    /// flown ahead if the flag is set, is judged, and then is the fallback, again and again if it
    /// dies.
    Standby(Program, u64, bool),
}

/// The end of a rehearsal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rehearsed {
    /// Logical instant from which the candidate was flown ahead \[ns\].
    pub from_ns: u64,
    /// The vehicle has left the tube of the rehearsal since then, so that its answer is about another
    /// flight than the one at hand.
    pub left_tube: bool,
    /// Whether the candidate may fly; if so, a description of what it did.
    pub verdict: Result<String, RehearsalRefusal>,
}

/// What happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A request.
    Request(Request),
    /// The process on a seat has connected, all its ports open.
    Ready(Seat, Instance),
    /// Answer to [`Action::Judge`], or at any time before it what no window makes good.
    Verdict(Seat, Result<Box<GateFigures>, Refusal>),
    /// Answer to [`Action::Rehearse`].
    Rehearsed(Seat, Rehearsed),
    /// Time has come to [`super::SlotMachine::deadline_ns`].
    Time,
    /// The consumer put the record of this epoch into effect at `at_ns`, and follows this seat.
    Acknowledged {
        /// Epoch.
        epoch: u64,
        /// Seat.
        seat: Seat,
        /// Effective instant \[ns\].
        at_ns: u64,
    },
    /// The consumer refused the record of this epoch: it came too late.
    RecordRefused {
        /// Epoch.
        epoch: u64,
    },
    /// The consumer went over to the fallback.
    FailedOver {
        /// Epoch in effect.
        epoch: u64,
        /// When \[ns\].
        at_ns: u64,
    },
    /// The monitor tripped: from `at_ns` on the owner of `epoch` no longer counts, and the consumer
    /// follows the fallback, if there is one.
    Tripped {
        /// Epoch in effect.
        epoch: u64,
        /// The trip's effective instant \[ns\].
        at_ns: u64,
    },
    /// Neither the owner of `epoch` nor a fallback has given the consumer a usable command since
    /// `since_ns`; repeated until it ends.
    Unguided {
        /// Epoch in effect.
        epoch: u64,
        /// First instant without one \[ns\].
        since_ns: u64,
        /// Instant of this report \[ns\].
        at_ns: u64,
    },
    /// The monitor hangs: nothing watches the owner any more.
    Unwatched,
    /// The process on a seat is gone.
    Died(Seat),
    /// The process on a seat is there and of no use. It will be killed.
    Misbehaved(Seat, Fault),
}

/// What is to be done, in this order.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Start a new instance on a free seat.
    Spawn(Seat, Program),
    /// Start the dead instance on this seat again, with a raised generation; after the launcher's
    /// own pause, if it has died often.
    Restart(Seat, Program),
    /// Write the owner record.
    Publish(Record),
    /// Let the process on `seat` begin.
    HandOver {
        /// Its seat.
        seat: Seat,
        /// The seat whose last state it restores; `None`: it starts from nothing and tracks.
        state_of: Option<Seat>,
        /// Its first release is the first at or after this instant \[ns\].
        join_ns: u64,
        /// It tracks what is applied in releases before this instant \[ns\].
        track_until_ns: u64,
    },
    /// The shadow window is over: send the gate's [`Event::Verdict`].
    Judge(Seat),
    /// Fly the candidate on this seat ahead from now on: send [`Event::Rehearsed`]. Asked again, it
    /// begins anew.
    Rehearse(Seat),
    /// The record just written has no place for the process on this seat, which leaves by itself.
    /// Send [`Event::Died`] when it has, or [`Event::Misbehaved`] when your timeout is over.
    AwaitExit(Seat),
    /// Kill the process on this seat; [`Event::Died`] must follow.
    Kill(Seat),
    /// Pass this report on to those that it concerns.
    Report(Report),
}
