//! How a step of a law ended.

use crate::QpStatus;

/// How a step ended; `R` is why a law refuses an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawStatus<R> {
    /// The optimum.
    Solved,
    /// The solver did not finish; its first move was clipped to its bounds.
    Fallback(QpStatus),
    /// The input could not be used; the last command is held.
    Refused(R),
}

impl<R> From<QpStatus> for LawStatus<R> {
    fn from(status: QpStatus) -> Self {
        match status {
            QpStatus::Solved => Self::Solved,
            unfinished => Self::Fallback(unfinished),
        }
    }
}
