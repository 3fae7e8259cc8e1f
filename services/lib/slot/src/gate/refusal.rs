//! Why a candidate may not fly.

use super::Phase;
use thiserror::Error;

/// Why a candidate may not fly.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refusal {
    /// A command was not finite.
    #[error("its {axis} at {:.6} s is {value}", *at_ns as f64 * 1e-9)]
    NotFinite {
        /// Axis.
        axis: &'static str,
        /// The number.
        value: f64,
        /// Effective instant \[ns\].
        at_ns: u64,
    },
    /// A command left its bounds.
    #[error(
        "its {axis} at {:.6} s is {value:.6}, outside {min:.6} to {max:.6}", *at_ns as f64 * 1e-9
    )]
    OutOfBounds {
        /// Axis.
        axis: &'static str,
        /// The number.
        value: f64,
        /// Lower bound.
        min: f64,
        /// Upper bound.
        max: f64,
        /// Effective instant \[ns\].
        at_ns: u64,
    },
    /// It and the owner differ too much at an instant.
    #[error(
        "{phase}, its {axis} at {:.6} s differs from the owner's by {:.3} % of the largest command; {:.3} % is allowed (`--force`, in a script `force`, overrides it)",
        *at_ns as f64 * 1e-9, 100.0 * value, 100.0 * limit
    )]
    TooFar {
        /// Part of the window.
        phase: Phase,
        /// Axis.
        axis: &'static str,
        /// Disagreement over `u_max`.
        value: f64,
        /// Limit over `u_max`.
        limit: f64,
        /// Effective instant \[ns\].
        at_ns: u64,
    },
    /// It and the owner differ too much over a part of the window.
    #[error(
        "{phase} until {:.6} s, its {axis} differs from the owner's by {:.3} % rms of the largest command; {:.3} % is allowed (`--force`, in a script `force`, overrides it)",
        *at_ns as f64 * 1e-9, 100.0 * value, 100.0 * limit
    )]
    TooFarOnTheWhole {
        /// Part of the window.
        phase: Phase,
        /// Axis.
        axis: &'static str,
        /// Root mean square over `u_max`.
        value: f64,
        /// Limit over `u_max`.
        limit: f64,
        /// Last effective instant \[ns\].
        at_ns: u64,
    },
    /// It and the owner differ by something that lasts.
    #[error(
        "{phase} until {:.6} s, its {axis} is off the owner's by {:.3} % of the largest command on average; {:.3} % is allowed (`--force`, in a script `force`, overrides it)",
        *at_ns as f64 * 1e-9, 100.0 * value, 100.0 * limit
    )]
    TooFarOnAverage {
        /// Part of the window.
        phase: Phase,
        /// Axis.
        axis: &'static str,
        /// Mean of candidate less owner, over `u_max`.
        value: f64,
        /// Limit over `u_max`.
        limit: f64,
        /// Last effective instant \[ns\].
        at_ns: u64,
    },
    /// It answers with the wrong sign, or far too much or too little.
    #[error(
        "running free until {:.6} s, its {axis} follows the owner's with slope {value:.3} ± {margin:.3}; {min:.3} to {max:.3} is allowed (wrong sign or gain? `--force`, in a script `force`, overrides it)",
        *at_ns as f64 * 1e-9
    )]
    WrongSlope {
        /// Axis.
        axis: &'static str,
        /// Slope.
        value: f64,
        /// Three standard errors of it.
        margin: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
        /// Last effective instant \[ns\].
        at_ns: u64,
    },
    /// Where the owner's goes up, it goes down.
    #[error(
        "running free until {:.6} s, its {axis} changes against the owner's, with slope {value:.3} ± {margin:.3} (wrong sign? `--force`, in a script `force`, overrides it)",
        *at_ns as f64 * 1e-9
    )]
    WrongWay {
        /// Axis.
        axis: &'static str,
        /// Slope of its changes over the owner's.
        value: f64,
        /// Three standard errors of it.
        margin: f64,
        /// Last effective instant \[ns\].
        at_ns: u64,
    },
    /// It was late too often.
    #[error("it missed {missed} deadlines, the first at {:.6} s; {limit} are allowed", *at_ns as f64 * 1e-9)]
    MissedDeadlines {
        /// How often.
        missed: u64,
        /// How often it may be.
        limit: u64,
        /// Instant of the first \[ns\].
        at_ns: u64,
    },
    /// There was too little to compare.
    #[error(
        "{phase}, only {seen} of its commands could be compared; {limit} are needed: shadow it longer"
    )]
    TooFew {
        /// Part of the window.
        phase: Phase,
        /// Instants compared.
        seen: u64,
        /// Instants needed.
        limit: u64,
    },
}

impl Refusal {
    /// True if it is about disagreement, which `--force` overrides; never about what no controller
    /// may do.
    #[must_use]
    pub fn yields_to_force(&self) -> bool {
        matches!(
            self,
            Self::TooFar { .. }
                | Self::TooFarOnTheWhole { .. }
                | Self::TooFarOnAverage { .. }
                | Self::WrongSlope { .. }
                | Self::WrongWay { .. }
        )
    }
}
