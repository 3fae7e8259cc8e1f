//! Why something did not go as asked.

use crate::gate::Refusal;
use crate::record::Seat;
use thiserror::Error;

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
    /// Flown ahead, it leaves the tube or loses the vehicle; described with number and limit.
    #[error("flown ahead, {0} (`--force`, in a script `force`, overrides it)")]
    Fails(String),
    /// There is no answer; the text states why.
    #[error("not rehearsed: {0} (`--no-rehearsal`, in a script `no-rehearsal`, skips it)")]
    NotRehearsed(String),
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
    /// No process sits there.
    #[error("no process is on {0}")]
    VacantSeat(Seat),
    /// The owner cannot be retired.
    #[error("{0} owns the slot: swap to another controller first")]
    OwnsTheSlot(Seat),
    /// There is a standby.
    #[error("{0} already stands by: retire it first")]
    StandbyExists(Seat),
    /// Neither the owner nor its standby would be trusted.
    #[error(
        "{0} commands and is not trusted, so that its standby has to be: name a built-in controller"
    )]
    UntrustedStandby(Seat),
    /// No swap can be undone any more.
    #[error(
        "there is no swap to roll back: none was made, or its old owner has left; `swap --rollback 30s` keeps it so long"
    )]
    NothingToRollBack,
    /// The candidate that is to be rolled back has not taken over.
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
            | Self::VacantSeat(_)
            | Self::OwnsTheSlot(_)
            | Self::StandbyExists(_)
            | Self::UntrustedStandby(_)
            | Self::NothingToRollBack => 2,
            Self::Busy(_) | Self::Ownerless(_) | Self::NoFreeSeat | Self::NotInCommand(_) => 3,
            _ => 1,
        }
    }
}
