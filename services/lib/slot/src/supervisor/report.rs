//! What the supervisor reports: the steps on the way, and the ends.

use super::instances::Program;
use super::reason::{Fault, Reason, RehearsalRefusal};
use crate::gate::{GateFigures, Refusal};
use crate::record::Seat;

/// Something to record and to report.
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
    /// It is being flown ahead, for the second time if the flag is set.
    Rehearses(Seat, bool),
    /// Flown ahead, it did this.
    Rehearsed(Seat, String),
    /// The rehearsal did not let it through, and was overruled.
    RehearsalForced(Seat, RehearsalRefusal),
    /// The last proven owner stays as the fallback of one that is watched.
    FallbackStays {
        /// The seat that stays.
        seat: Seat,
        /// The seat that commands.
        owner: Seat,
    },
    /// It will be watched, and there will be no process to go back to once its window is over.
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
    /// The consumer follows it.
    Flipped {
        /// New owner.
        seat: Seat,
        /// Epoch.
        epoch: u64,
        /// When \[ns\].
        at_ns: u64,
    },
    /// A record came too late or was not acknowledged; this one states the same for a later instant.
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
    /// An owner is lost and no other process can take over: it is started again.
    Ownerless(Seat, Fault),
    /// An owner that was started again is lost again, or gave nothing to follow: on its seat an
    /// instance of this program, the one that the flight began with, is started instead.
    Replaced(Seat, Program),
    /// It commands, from nothing or again.
    Commands(Seat),
    /// The owner before is lost that was the fallback during the rollback window, which ends with it.
    FallbackLost {
        /// The seat that is lost.
        seat: Seat,
        /// The seat that commands, or is about to.
        owner: Seat,
        /// What became of it.
        fault: Fault,
    },
    /// The standby is lost.
    StandbyLost(Seat, Fault),
    /// The standby has been lost too often and is given up.
    StandbyGivenUp(Program),
    /// Neither it nor the owner is trusted: it is given up for one that is.
    StandbyUntrusted(Program),
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
                "{seat} will have no fallback after its window (monitor.fallback): if it trips, the vehicle is held without it and the initial controller is started in its place"
            ),
            Self::Rehearses(seat, false) => write!(f, "{seat} is flown ahead"),
            Self::Rehearses(seat, true) => {
                write!(f, "{seat} is flown ahead again, from where the vehicle is now")
            }
            Self::Rehearsed(seat, outcome) => write!(f, "{seat} has been flown ahead: {outcome}"),
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
                write!(
                    f,
                    "the record of the new owner was not taken in time: try {tries} for a later instant, epoch {epoch}"
                )
            }
            Self::TookOver { seat, from, fault } => {
                write!(f, "{seat} takes over from {from}: {fault}")
            }
            Self::Ownerless(seat, fault) => {
                write!(f, "there is no fallback for {seat}, and the slot waits for a new process: {fault}")
            }
            Self::Replaced(seat, _) => {
                write!(f, "{seat} is not started again: what the flight began with takes its place")
            }
            Self::Commands(seat) => write!(f, "{seat} commands"),
            Self::FallbackLost { seat, owner, fault } => {
                write!(f, "{seat} is lost, with which the rollback window of {owner} ends: {fault}")
            }
            Self::StandbyLost(seat, fault) => write!(f, "the standby on {seat} is lost: {fault}"),
            Self::StandbyGivenUp(_) => f.write_str("the standby is given up"),
            Self::StandbyUntrusted(_) => f.write_str(
                "the standby makes room for a trusted one: the owner is as little trusted as itself",
            ),
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
