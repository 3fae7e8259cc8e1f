//! What can be asked of a running flight, and what it answers.

use super::status::RunStatus;
use crate::exit;
use core::fmt;
use serde::{Deserialize, Serialize};

/// One line towards the launcher, for example `{"request":"ps"}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// How processes and slots are doing.
    Ps,
}

/// One line from the launcher, for example `{"reply":"refused","reason":"bad_request",...}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reply", rename_all = "snake_case")]
pub enum Reply {
    /// To [`Request::Ps`].
    Status(RunStatus),
    /// No; nothing was changed.
    Refused(Refusal),
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
    /// Of another user.
    NotYours,
    /// More conversations than the launcher holds at a time.
    TooMany,
}

impl Reason {
    /// What a command ends with that was refused so.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        match self {
            Self::BadRequest => exit::USAGE,
            Self::NotYours | Self::TooMany => exit::UNFIT,
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
            Self::Status(_) | Self::Refused(_) => true,
        }
    }
}
