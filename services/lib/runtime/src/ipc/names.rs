//! Names of the services that are not topics.

use shared_types::Role;

/// A service beside the topics of the floor plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServiceKind {
    /// How far a role has got.
    Progress(Role),
    /// Wakes a role.
    Wake(Role),
    /// A role's published state.
    State(Role),
    /// State from which a restarted process continues.
    Handover(Role),
    /// The conductor's clock.
    Clock,
    /// Processes that are ready.
    Hello,
}

impl ServiceKind {
    /// Service name within the run.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Progress(role) => format!("progress/{}", role.label()),
            Self::Wake(role) => format!("wake/{}", role.label()),
            Self::State(role) => format!("state/{}", role.label()),
            Self::Handover(role) => format!("handover/{}", role.label()),
            Self::Clock => "clock".to_owned(),
            Self::Hello => "hello".to_owned(),
        }
    }
}
