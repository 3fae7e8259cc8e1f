//! Names of the services that are not topics.

use shared_types::Seat;

/// A service beside the topics of the floor plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServiceKind {
    /// How far a seat's process has got.
    Progress(Seat),
    /// Wakes a seat's process.
    Wake(Seat),
    /// A seat's published state.
    State(Seat),
    /// State from which a process that takes a seat continues.
    Handover(Seat),
    /// The conductor's clock.
    Clock,
    /// Processes that are ready.
    Hello,
    /// Which process sits where.
    Registry,
}

impl ServiceKind {
    /// Service name within the run.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Progress(seat) => format!("progress/{}", seat.label()),
            Self::Wake(seat) => format!("wake/{}", seat.label()),
            Self::State(seat) => format!("state/{}", seat.label()),
            Self::Handover(seat) => format!("handover/{}", seat.label()),
            Self::Clock => "clock".to_owned(),
            Self::Hello => "hello".to_owned(),
            Self::Registry => "registry".to_owned(),
        }
    }
}
