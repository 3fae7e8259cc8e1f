//! What the supervisor is told, and what it wants done.

use crate::gate::{GateFigures, Refusal};
use crate::record::{Record, Seat};
use thiserror::Error;

/// An executable with its configuration, as a place in the launcher's own list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Program(pub u32);

/// Where time is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Now {
    /// Everything before this instant has been seen \[ns\].
    pub logical_ns: u64,
    /// Lockstep: nothing at or after this instant has run \[ns\]. Realtime: the same as
    /// `logical_ns`.
    pub allowed_ns: u64,
}

/// A process that has connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Instance {
    /// Hash of its state's layout: two of one layout are of one kind.
    pub layout: u64,
    /// Its rate \[mHz\]; 0 for one without a grid of its own.
    pub millihertz: u64,
    /// From its release to its command's effect \[ns\].
    pub latency_ns: u64,
}

/// Who is to command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Target {
    /// A new instance of a program.
    New(Program),
    /// One that is already there, such as the standby.
    Seated(Seat),
}

/// How a swap is to be done.
#[expect(clippy::struct_excessive_bools, reason = "choices of their own, in any combination")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Order {
    /// How long the candidate shadows before it is judged \[ns\].
    pub shadow_ns: u64,
    /// How long the old owner stays as the fallback \[ns\].
    pub rollback_ns: u64,
    /// Overrule the gate where it is about disagreement, and the rehearsal.
    pub force: bool,
    /// Fly the candidate ahead before the flip, and let that decide.
    pub rehearse: bool,
    /// The candidate may be the only controller once its window is over. Any other is watched for as
    /// long as it commands, and the last proven owner stays as its fallback.
    pub trusted: bool,
    /// Judge only.
    pub dry_run: bool,
}

/// What a user or a script asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Request {
    /// Another instance is to command.
    Swap(Target, Order),
    /// Back to the old owner, while its window is open.
    Rollback,
    /// An instance that does not command is to leave.
    Retire(Seat),
    /// Keep an instance of this program warm beside the owner: it shadows for this long \[ns\], is
    /// flown ahead if the flag says so, is
    /// judged, and then is the fallback, again and again if it dies.
    Standby(Program, u64, bool),
}

/// Why an instance is out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Error)]
pub enum Fault {
    /// Its process ended.
    #[error("its process ended")]
    Died,
    /// It did not connect in time.
    #[error("it did not become ready in time")]
    NeverReady,
    /// Another build's samples or state.
    #[error("the layout of its samples is not this build's: rebuild it")]
    WrongLayout,
    /// It makes no progress.
    #[error("it makes no progress")]
    Stalled,
    /// The consumer had no usable command of it and went over to the fallback.
    #[error("its commands failed to come, or were refused")]
    Silent,
    /// The monitor found that it would lose the vehicle.
    #[error("the monitor tripped it")]
    Tripped,
    /// It was watched when the monitor hung.
    #[error("the monitor hangs, and nothing watches it")]
    Unwatched,
}

/// Why a rehearsal does not let a candidate fly.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum RehearsalRefusal {
    /// Flown ahead, it leaves the tube or loses the vehicle; in words, with number and limit.
    #[error("flown ahead, {0} (`force` overrides it)")]
    Fails(String),
    /// There is no answer; the words say why.
    #[error("not rehearsed: {0} (`no-rehearsal` skips it)")]
    NotRehearsed(String),
}

/// The end of a rehearsal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rehearsed {
    /// Logical instant from which the candidate was flown ahead \[ns\].
    pub from_ns: u64,
    /// The vehicle has left the tube of the rehearsal since then, so that its answer is about another
    /// flight than the one at hand.
    pub left_tube: bool,
    /// Whether the candidate may fly; if so in words what it did.
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
    /// Time has come to [`super::Slot::deadline_ns`].
    Time,
    /// The consumer put the record of this epoch into effect at `at_ns`, and obeys this seat.
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
    FellOver {
        /// Epoch in effect.
        epoch: u64,
        /// When \[ns\].
        at_ns: u64,
    },
    /// The monitor tripped: from `at_ns` on the owner of `epoch` no longer counts, and the consumer
    /// obeys the fallback, if there is one.
    Tripped {
        /// Epoch in effect.
        epoch: u64,
        /// The trip's effective instant \[ns\].
        at_ns: u64,
    },
    /// Neither the owner of `epoch` nor a fallback has given the consumer a usable command since
    /// `since_ns`; said again and again until it ends.
    Unguided {
        /// Epoch in effect.
        epoch: u64,
        /// First instant without one \[ns\].
        since_ns: u64,
        /// Instant of this word \[ns\].
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
        /// Whose last state it restores; `None`: it starts from nothing and tracks.
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
    /// Send [`Event::Died`] when it has, or [`Event::Misbehaved`] when your patience is over.
    AwaitExit(Seat),
    /// Kill the process on this seat; [`Event::Died`] must follow.
    Kill(Seat),
    /// Tell whom it concerns.
    Report(Report),
}

/// Something to record and to tell.
#[derive(Debug, Clone, PartialEq)]
pub enum Report {
    /// Answers the request that was just made, and nothing has changed.
    Refused(Reason),
    /// A step on the way.
    Step(Step),
    /// Ends what was going on at this seat without what was asked for.
    Aborted(Seat, Reason),
    /// Ends what was going on at this seat as asked for.
    Done(Seat, Outcome),
}

/// A step on the way.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// A candidate has connected and shadows from `at_ns` on.
    Joined {
        /// Its seat.
        seat: Seat,
        /// It restores the owner's state; otherwise its layout differs and it tracks first.
        same_kind: bool,
        /// Join instant \[ns\].
        at_ns: u64,
    },
    /// It tracks no more.
    RunsFree(Seat),
    /// The gate let it through.
    Passed(Seat, Box<GateFigures>),
    /// The gate did not, and was overruled.
    Forced(Seat, Refusal),
    /// It is being flown ahead, for the second time if the flag says so.
    Rehearses(Seat, bool),
    /// Flown ahead, it did this.
    Rehearsed(Seat, String),
    /// The rehearsal did not let it through, and was overruled.
    RehearsalForced(Seat, RehearsalRefusal),
    /// The last proven owner stays as the fallback of one that is watched.
    FallbackStays {
        /// Who stays.
        seat: Seat,
        /// Who commands.
        owner: Seat,
    },
    /// It will be watched, and there will be nobody to go back to once its window is over.
    WithoutFallback(Seat),
    /// A record was written that gives it the slot.
    FlipsAt {
        /// New owner.
        seat: Seat,
        /// Epoch.
        epoch: u64,
        /// T \[ns\].
        at_ns: u64,
    },
    /// The consumer obeys it.
    Flipped {
        /// New owner.
        seat: Seat,
        /// Epoch.
        epoch: u64,
        /// When \[ns\].
        at_ns: u64,
    },
    /// A record came too late or was not acknowledged; this one says the same for a later instant.
    TriedAgain {
        /// Epoch of the new record.
        epoch: u64,
        /// How often it has been tried.
        tries: u32,
    },
    /// An owner is lost and another seat has the slot.
    TookOver {
        /// New owner.
        seat: Seat,
        /// Old owner.
        from: Seat,
        /// What became of that.
        fault: Fault,
    },
    /// An owner is lost and nobody can take over: it is started again.
    Ownerless(Seat, Fault),
    /// An owner that was started again is lost again at once, or gave nothing to obey: on its seat an
    /// instance of this program, the one that the flight began with, is started instead.
    Replaced(Seat, Program),
    /// It commands, from nothing or again.
    Commands(Seat),
    /// The standby is lost.
    StandbyLost(Seat, Fault),
    /// The standby has been lost too often and is given up.
    StandbyGivenUp(Program),
    /// An instance that was to leave has left.
    Left(Seat),
}

/// How a request ended well.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// It commands and the rollback window is over.
    Swapped,
    /// The old owner commands again, as asked.
    RolledBack,
    /// It passed the gate, and that was all.
    DryRun,
    /// It is the fallback.
    StandsBy,
    /// It leaves.
    Retired,
}

/// Why a request is refused or came to nothing.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Reason {
    /// Another swap, or a standby's start, is in progress.
    #[error("another swap is in progress on {0}: wait for its end, or retire {0}")]
    Busy(Seat),
    /// The owner has just died and is being started again.
    #[error("the slot has no owner to compare with: {0} is being started")]
    Ownerless(Seat),
    /// All seats are taken.
    #[error("all seats are taken: retire an instance")]
    NoFreeSeat,
    /// It owns the slot already.
    #[error("{0} already owns the slot; to replace it by a new instance name the executable")]
    AlreadyOwns(Seat),
    /// Nobody sits there.
    #[error("nobody flies on {0}")]
    NobodyThere(Seat),
    /// The owner cannot be retired.
    #[error("{0} owns the slot: swap to another controller first")]
    OwnsTheSlot(Seat),
    /// There is a standby.
    #[error("{0} already stands by: retire it first")]
    StandbyExists(Seat),
    /// No swap can be undone any more.
    #[error("there is no swap to roll back: none was made, or its old owner has left")]
    NothingToRollBack,
    /// Whoever is to be rolled back has not taken over.
    #[error(
        "{0} is not in command, so there is nothing to roll back yet; retire it to send it away"
    )]
    NotInCommand(Seat),
    /// It is out.
    #[error("{0}")]
    Fault(#[from] Fault),
    /// The gate refused it.
    #[error("{0}")]
    Gate(#[from] Refusal),
    /// The rehearsal refused it.
    #[error("{0}")]
    Rehearsal(#[from] RehearsalRefusal),
    /// The owner was lost while it shadowed.
    #[error("the owner was lost meanwhile: there is nothing left to compare with")]
    OwnerLost,
    /// The consumer never confirmed the flip.
    #[error("the consumer did not confirm the flip, {0} times")]
    NotAcknowledged(u32),
    /// The user took it back.
    #[error("it was rolled back on request")]
    RolledBack,
    /// The user sent it away.
    #[error("it was retired on request")]
    Retired,
}

impl Reason {
    /// Exit code of the command that asked: 1 refused or failed, 2 asked for what makes no sense,
    /// 3 not now.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::AlreadyOwns(_)
            | Self::NobodyThere(_)
            | Self::OwnsTheSlot(_)
            | Self::StandbyExists(_)
            | Self::NothingToRollBack => 2,
            Self::Busy(_) | Self::Ownerless(_) | Self::NoFreeSeat | Self::NotInCommand(_) => 3,
            _ => 1,
        }
    }
}

impl core::fmt::Display for Step {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let s = |at_ns: u64| at_ns as f64 * 1e-9;
        match self {
            Self::Joined { seat, same_kind: true, at_ns } => {
                write!(f, "{seat} joined at {:.6} s and shadows from the owner's state", s(*at_ns))
            }
            Self::Joined { seat, same_kind: false, at_ns } => write!(
                f,
                "{seat} joined at {:.6} s; its state has another layout than the owner's, so it tracks what is applied first",
                s(*at_ns)
            ),
            Self::RunsFree(seat) => write!(f, "{seat} tracks no more and runs free"),
            Self::Passed(seat, _) => write!(f, "the gate lets {seat} through"),
            Self::Forced(seat, refusal) => write!(f, "{seat} is let through by force: {refusal}"),
            Self::WithoutFallback(seat) => write!(
                f,
                "{seat} will have no fallback after its window (watch.fallback): if it trips, the vehicle is levelled and the initial controller is started in its place"
            ),
            Self::Rehearses(seat, false) => write!(f, "{seat} is flown ahead"),
            Self::Rehearses(seat, true) => {
                write!(f, "{seat} is flown ahead again, from where the vehicle is now")
            }
            Self::Rehearsed(seat, words) => write!(f, "{seat} has been flown ahead: {words}"),
            Self::RehearsalForced(seat, refusal) => {
                write!(f, "{seat} is let through by force: {refusal}")
            }
            Self::FallbackStays { seat, owner } => {
                write!(f, "{owner} stays watched; {seat} stays as its fallback until it is retired")
            }
            Self::FlipsAt { seat, epoch, at_ns } => {
                write!(f, "{seat} gets the slot at {:.6} s, epoch {epoch}", s(*at_ns))
            }
            Self::Flipped { seat, epoch, at_ns } => {
                write!(f, "{seat} commands since {:.6} s, epoch {epoch}", s(*at_ns))
            }
            Self::TriedAgain { epoch, tries } => {
                write!(f, "the record was not taken: try {tries}, epoch {epoch}")
            }
            Self::TookOver { seat, from, fault } => {
                write!(f, "{seat} takes over from {from}: {fault}")
            }
            Self::Ownerless(seat, fault) => {
                write!(f, "nobody can take over from {seat}, which is started again: {fault}")
            }
            Self::Replaced(seat, _) => {
                write!(f, "{seat} is not started again: what the flight began with takes its place")
            }
            Self::Commands(seat) => write!(f, "{seat} commands"),
            Self::StandbyLost(seat, fault) => write!(f, "the standby on {seat} is lost: {fault}"),
            Self::StandbyGivenUp(_) => f.write_str("the standby is given up"),
            Self::Left(seat) => write!(f, "{seat} is free"),
        }
    }
}

impl core::fmt::Display for Outcome {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Swapped => "it commands, and the rollback window is over",
            Self::RolledBack => "it commands again",
            Self::DryRun => "it passed the gate; nothing was changed",
            Self::StandsBy => "it stands by",
            Self::Retired => "it leaves",
        })
    }
}
