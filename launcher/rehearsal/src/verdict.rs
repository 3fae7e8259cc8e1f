//! The verdict of a rehearsal, as numbers and as a sentence.

use crate::{Challenge, Figure, Lost, Posture};
use core::fmt;
use serde::{Deserialize, Serialize};
use shared_types::Slot;
use thiserror::Error;

/// Everything that was measured in a rehearsal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RehearsalFigures {
    /// The slot that the candidate is to take.
    pub slot: Slot,
    /// One figure per initial state, challenge and measure.
    pub figures: Vec<Figure>,
    /// If the vehicle was lost: initial state, last challenge, time since that challenge \[s\] and how.
    pub lost: Option<(usize, Challenge, f64, Lost)>,
}

impl RehearsalFigures {
    /// The figure that is nearest to its limit, or furthest beyond it; `None` if there are no figures.
    #[must_use]
    pub fn worst(&self) -> Option<&Figure> {
        let share = |figure: &Figure| {
            let share = figure.candidate / figure.limit;
            if share.is_nan() { f64::INFINITY } else { share }
        };
        self.figures.iter().max_by(|a, b| share(a).total_cmp(&share(b)))
    }
}

/// Why a candidate may not fly.
#[derive(Debug, Clone, PartialEq, Error, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "refusal")]
pub enum RehearsalRefusal {
    /// The rehearsed vehicle was lost.
    #[error("would lose the vehicle {after_s:.2} s after {}: {lost}", .challenge.description())]
    Lost {
        /// Number of the initial state: 0 for the mean, then the draws.
        draw: usize,
        /// The last challenge before the loss.
        challenge: Challenge,
        /// Time from that challenge to the loss \[s\].
        after_s: f64,
        /// How the vehicle was lost.
        lost: Lost,
        /// Everything that was measured before.
        figures: RehearsalFigures,
        /// Where it was from the flip to the loss, the last seconds of it if that was long.
        #[serde(default)]
        course: Vec<Posture>,
    },
    /// An error leaves the tube.
    #[error("would leave its tube after {}: {figure}", .figure.challenge.description())]
    Outside {
        /// The figure that is furthest beyond its limit.
        figure: Figure,
        /// Everything that was measured.
        figures: RehearsalFigures,
        /// Where it was from that challenge to the next, the last seconds of it if that was long.
        #[serde(default)]
        course: Vec<Posture>,
    },
    /// An attitude controller goes on following an owner of the position slot that has tripped.
    #[error(
        "would still follow a position controller {:.0} ms after it has tripped, limit {:.0} ms",
        1e3 * .after_s,
        1e3 * .limit_s
    )]
    TripIgnored {
        /// Time from the trip to a step in which it was still followed \[s\].
        after_s: f64,
        /// Time within which it has to follow the fallback \[s\].
        limit_s: f64,
    },
    /// The candidate failed to start or to take over.
    #[error("cannot be rehearsed: {why}")]
    Failed {
        /// What happened instead.
        why: String,
    },
    /// The rehearsal could not be flown to its end, for a reason that is not the candidate's.
    #[error("not rehearsed: {why}")]
    NotRehearsed {
        /// The reason.
        why: String,
    },
}

impl RehearsalRefusal {
    /// Where the vehicle was when the candidate failed; empty if it did not come to that.
    #[must_use]
    pub fn course(&self) -> &[Posture] {
        match self {
            Self::Lost { course, .. } | Self::Outside { course, .. } => course,
            _ => &[],
        }
    }

    /// What was measured before the refusal; `None` if nothing was.
    #[must_use]
    pub fn figures(&self) -> Option<&RehearsalFigures> {
        match self {
            Self::Lost { figures, .. } | Self::Outside { figures, .. } => Some(figures),
            _ => None,
        }
    }
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tilted { tilt_rad, limit_rad } => {
                let (tilt_deg, limit_deg) = (tilt_rad.to_degrees(), limit_rad.to_degrees());
                write!(f, "tilt {tilt_deg:.1} deg, limit {limit_deg:.1} deg")
            }
            Self::Away { distance_m, limit_m } => {
                write!(f, "{distance_m:.2} m from the reference, limit {limit_m:.2} m")
            }
            Self::Grounded { height_m, limit_m } => {
                write!(f, "height {height_m:.2} m, limit {limit_m:.2} m")
            }
            Self::Uncommanded => {
                write!(f, "no valid command, so that the actuation guard took over")
            }
            Self::NotFinite => write!(f, "its motion is not a number, limit any number"),
        }
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (is, may) = (self.measure.shown(self.candidate), self.measure.shown(self.limit));
        let owner = self.measure.shown(self.owner);
        write!(f, "{} {is}, limit {may} (owner {owner})", self.measure.description())
    }
}

/// Result of a rehearsal; the launcher receives it as JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Name of the candidate.
    pub candidate: String,
    /// Name of the owner.
    pub owner: String,
    /// True if the candidate may fly.
    pub accepted: bool,
    /// Verdict and reason as a sentence without its full stop.
    pub message: String,
    /// Why the candidate may not fly; `None` if it is accepted.
    pub refusal: Option<RehearsalRefusal>,
    /// Everything that was measured, if the candidate is accepted; a refusal carries its own figures.
    pub figures: Option<RehearsalFigures>,
}

impl Verdict {
    /// The verdict for the result of a rehearsal of `candidate` in place of `owner`.
    #[must_use]
    pub fn of(
        candidate: &str,
        owner: &str,
        done: Result<RehearsalFigures, Box<RehearsalRefusal>>,
    ) -> Self {
        let (candidate, owner) = (candidate.to_owned(), owner.to_owned());
        match done {
            Ok(figures) => {
                let closest = figures.worst().map_or(String::new(), |figure| {
                    format!(
                        "; closest to its limit after {}: {figure}",
                        figure.challenge.description()
                    )
                });
                let message = format!("{candidate} can fly in place of {owner}{closest}");
                Self {
                    candidate,
                    owner,
                    accepted: true,
                    message,
                    refusal: None,
                    figures: Some(figures),
                }
            }
            Err(refusal) => {
                let message = format!("{candidate} {refusal}");
                let refusal = Some(*refusal);
                Self { candidate, owner, accepted: false, message, refusal, figures: None }
            }
        }
    }

    /// What was measured, whether the candidate is accepted or not; `None` if nothing was.
    #[must_use]
    pub fn measured(&self) -> Option<&RehearsalFigures> {
        self.figures.as_ref().or_else(|| self.refusal.as_ref()?.figures())
    }
}
