//! How far a slot is, as it is reported.

use crate::record::Seat;

/// How far a slot is, for observers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Progress {
    /// The owner commands and nothing is under way.
    Steady,
    /// No process commands; the owner is being started.
    Ownerless,
    /// A candidate is being started.
    Joining(Seat),
    /// It shadows the owner until this instant \[ns\], and tracks what is applied.
    Tracking(Seat, u64),
    /// It shadows the owner and runs free, until this instant \[ns\].
    Shadowing(Seat, u64),
    /// It is being flown ahead.
    Rehearsing(Seat),
    /// It gets the slot.
    Flipping(Seat),
    /// It commands, and can be rolled back until this instant \[ns\].
    Window(Seat, u64),
    /// The owner before it gets the slot again.
    Reverting(Seat),
}

impl Progress {
    /// As one keyword.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Steady => "steady",
            Self::Ownerless => "ownerless",
            Self::Joining(_) => "joining",
            Self::Tracking(..) => "tracking",
            Self::Shadowing(..) => "shadowing",
            Self::Rehearsing(_) => "rehearsing",
            Self::Flipping(_) => "flipping",
            Self::Window(..) => "window",
            Self::Reverting(_) => "reverting",
        }
    }

    /// The instance that it is about.
    #[must_use]
    pub fn seat(self) -> Option<Seat> {
        match self {
            Self::Steady | Self::Ownerless => None,
            Self::Joining(seat)
            | Self::Tracking(seat, _)
            | Self::Shadowing(seat, _)
            | Self::Rehearsing(seat)
            | Self::Flipping(seat)
            | Self::Window(seat, _)
            | Self::Reverting(seat) => Some(seat),
        }
    }

    /// When it is over, if that is known \[ns\].
    #[must_use]
    pub fn until_ns(self) -> Option<u64> {
        match self {
            Self::Tracking(_, until_ns)
            | Self::Shadowing(_, until_ns)
            | Self::Window(_, until_ns) => Some(until_ns),
            _ => None,
        }
    }
}
