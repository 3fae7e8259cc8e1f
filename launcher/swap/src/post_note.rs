//! A process of a flight as the next launcher finds it noted.

use crate::child::{ChildSpec, OutputPipes};
use serde::{Deserialize, Serialize};
use shared_types::{Role, Seat};

/// A process that was started.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PostNote {
    /// Label of its role.
    pub role: String,
    /// Its number within the role.
    pub seat: u32,
    /// Processes that were started there before it.
    pub generation: u32,
    /// What was started.
    pub spec: ChildSpec,
    /// Its number, and when it was started.
    pub process: Option<(u32, u64)>,
    /// Where what it writes goes.
    pub pipes: OutputPipes,
    /// It has sent its hello.
    pub ready: bool,
    /// It has left in order.
    pub finished: bool,
    /// Hash of the layout of its state.
    pub layout: u64,
    /// Period of its loop \[ns\].
    pub period_ns: u64,
}

impl PostNote {
    /// Its role and seat.
    #[must_use]
    pub fn place(&self) -> Seat {
        let role = Role::STEPPING.into_iter().find(|role| role.label() == self.role);
        Seat { role: role.unwrap_or(Role::Supervisor), index: self.seat }
    }
}
