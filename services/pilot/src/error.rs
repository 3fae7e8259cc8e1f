//! Why a flight plan is refused.

use core::fmt;
use thiserror::Error;

/// Largest gap between two pieces of each measure: files have six decimals, of which high powers of time make
/// millimetres.
pub(super) const MAX_GAPS: [(f64, &str); 4] =
    [(0.01, "m"), (0.1, "m/s"), (0.02, "rad"), (0.2, "rad/s")];

/// A flight plan that cannot be flown as written.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PilotError {
    /// Not a number, or outside what makes sense.
    #[error("`{parameter}` is {value:?}: give a number from {min} to {max}")]
    OutOfRange {
        /// Path of the parameter within the plan.
        parameter: String,
        value: f64,
        /// Smallest value accepted.
        min: f64,
        /// Largest value accepted.
        max: f64,
    },
    /// A list without entries.
    #[error("`{parameter}` is empty: give at least one entry, it holds for the whole flight")]
    Empty {
        /// Path of the parameter within the plan.
        parameter: &'static str,
    },
    /// Entries out of order.
    #[error(
        "`{parameter}[{index}].t_s` is {t_s} s after an entry at {previous_s} s: let the times increase"
    )]
    TimesNotIncreasing {
        /// Path of the list within the plan.
        parameter: &'static str,
        /// The entry.
        index: usize,
        /// Its time \[s\].
        t_s: f64,
        /// Time of the entry before \[s\].
        previous_s: f64,
    },
    /// A piece that does not go on where the one before it ends.
    #[error(
        "`{list}[{index}]` begins {gap:.3} {unit} from where the piece before it ends: let them join within {limit} {unit}"
    )]
    Disjoint {
        /// Path of the list within the plan.
        list: &'static str,
        /// The piece.
        index: usize,
        /// How far it begins from there.
        gap: f64,
        /// How far it may.
        limit: f64,
        /// Unit of both.
        unit: &'static str,
    },
    /// No time to get going, fly and come to rest.
    #[error(
        "`trajectory.duration_s` is {duration_s} s: half an eight with its lead-in and lead-out takes {shortest_s} s, so lengthen it or shorten `period_s` or the leads"
    )]
    FigureTooShort {
        /// Duration asked for \[s\].
        duration_s: f64,
        /// Shortest duration of this figure \[s\].
        shortest_s: f64,
    },
    /// Faster than the servo that moves the arms.
    #[error(
        "`morph[{index}]` needs {rate_rad_s:.2} rad/s where the servo gives {limit_rad_s:.2} rad/s: allow at least {shortest_s:.4} s since the knot before"
    )]
    MorphTooFast {
        /// The knot at the end of the sweep.
        index: usize,
        /// Peak rate of the sweep \[rad/s\].
        rate_rad_s: f64,
        /// Rate limit of the servo \[rad/s\].
        limit_rad_s: f64,
        /// Shortest time for this sweep \[s\].
        shortest_s: f64,
    },
}

impl PilotError {
    /// Which entry of a list is refused.
    #[must_use]
    pub fn index(&self) -> Option<usize> {
        match self {
            Self::OutOfRange { parameter, .. } => {
                let (_, index) = parameter.split_once('[')?;
                index.split_once(']')?.0.parse().ok()
            }
            Self::TimesNotIncreasing { index, .. }
            | Self::Disjoint { index, .. }
            | Self::MorphTooFast { index, .. } => Some(*index),
            Self::Empty { .. } | Self::FigureTooShort { .. } => None,
        }
    }
}

/// Refuses a value outside `[min, max]`, NaN included. Only what is refused is named, since a plan may have very many
/// values.
pub(super) fn within(
    parameter: impl fmt::Display,
    value: f64,
    (min, max): (f64, f64),
) -> Result<(), PilotError> {
    if (min..=max).contains(&value) {
        Ok(())
    } else {
        Err(PilotError::OutOfRange { parameter: parameter.to_string(), value, min, max })
    }
}

/// Refuses a position that is not finite or outside any flying site.
pub(super) fn position(
    parameter: impl fmt::Display,
    position_w_m: [f64; 3],
) -> Result<(), PilotError> {
    for (axis, value) in position_w_m.into_iter().enumerate() {
        within(format_args!("{parameter}[{axis}]"), value, (-10_000.0, 10_000.0))?;
    }
    Ok(())
}

/// Refuses a heading that is not finite or many turns away.
pub(super) fn yaw(parameter: impl fmt::Display, yaw_rad: f64) -> Result<(), PilotError> {
    within(parameter, yaw_rad, (-1000.0, 1000.0))
}

/// Refuses an empty list, and times that are negative, not finite or not increasing.
pub(super) fn increasing(
    parameter: &'static str,
    times_s: impl Iterator<Item = f64>,
) -> Result<(), PilotError> {
    let mut previous = None;
    for (index, t_s) in times_s.enumerate() {
        within(format_args!("{parameter}[{index}].t_s"), t_s, (0.0, 1e6))?;
        if let Some(previous_s) = previous.filter(|p| t_s <= *p) {
            return Err(PilotError::TimesNotIncreasing { parameter, index, t_s, previous_s });
        }
        previous = Some(t_s);
    }
    previous.map(|_| ()).ok_or(PilotError::Empty { parameter })
}
