//! What a criterion has found.

use crate::swings::Oscillation;
use shared_types::TripCause;

/// A number beyond its limit. Its unit is that of the fields of `Trip` that belong to the cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finding {
    /// What went wrong.
    pub cause: TripCause,
    /// The measured or predicted number.
    pub value: f64,
    /// The limit that it exceeds.
    pub limit: f64,
    /// How long the fault has lasted \[s\]; 0 for criteria without a duration.
    pub lasted_s: f64,
    /// Changes of side counted; 0 for criteria that count none.
    pub reversals: u64,
}

impl Finding {
    /// A finding without duration and reversals.
    #[must_use]
    pub const fn of(cause: TripCause, value: f64, limit: f64) -> Self {
        Self { cause, value, limit, lasted_s: 0.0, reversals: 0 }
    }

    /// A finding if the number is beyond its limit.
    pub(crate) fn beyond(cause: TripCause, value: f64, limit: f64) -> Option<Self> {
        (value > limit).then_some(Self::of(cause, value, limit))
    }

    /// A finding about an oscillation, at the amplitude of now.
    pub(crate) fn oscillates(
        cause: TripCause,
        value: f64,
        limit: f64,
        Oscillation { reversals, window_ns }: &Oscillation,
    ) -> Self {
        Self {
            lasted_s: *window_ns as f64 * 1e-9,
            reversals: *reversals as u64,
            ..Self::of(cause, value.abs(), limit)
        }
    }
}
