//! The tube of permitted errors: an envelope from the vehicle's limits, tightened to the owner's error.

use crate::limits::NOT_FINITE;
use crate::{Axis, Challenge, Facts, Limits, Trial};
use serde::{Deserialize, Serialize};
use shared_types::Slot;

/// What is measured in the window of a challenge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measure {
    /// Largest tilt \[rad\].
    Tilt,
    /// Largest angle to the set point \[rad\].
    AttitudePeak,
    /// Root mean square angle to the set point in the last part of the window \[rad\].
    AttitudeRest,
    /// Root mean square body rate in the last part of the window \[rad/s\].
    RateRest,
    /// Largest distance from the reference \[m\].
    PositionPeak,
    /// Root mean square distance from the reference in the last part of the window \[m\].
    PositionRest,
    /// Root mean square error of the velocity in the last part of the window \[m/s\].
    VelocityRest,
    /// Largest difference between the heading and that of the reference \[rad\].
    HeadingPeak,
    /// Root mean square difference between successive commands in the last part of the window, of the worst
    /// axis, relative to the largest command.
    Effort,
}

impl Measure {
    /// The measures by which a candidate for a slot is judged.
    #[must_use]
    pub fn of(slot: Slot, is_rig: bool) -> &'static [Self] {
        const ATTITUDE: &[Measure] = &[
            Measure::Tilt,
            Measure::AttitudePeak,
            Measure::AttitudeRest,
            Measure::RateRest,
            Measure::Effort,
            Measure::PositionPeak,
            Measure::PositionRest,
        ];
        const POSITION: &[Measure] = &[
            Measure::Tilt,
            Measure::PositionPeak,
            Measure::PositionRest,
            Measure::VelocityRest,
            Measure::HeadingPeak,
            Measure::Effort,
        ];
        match (slot, is_rig) {
            (Slot::Attitude, true) => &ATTITUDE[..5],
            (Slot::Attitude, false) => ATTITUDE,
            (Slot::Position, _) => POSITION,
        }
    }

    /// Name of the measure in messages.
    #[must_use]
    pub fn description(self) -> &'static str {
        match self {
            Self::Tilt => "tilt",
            Self::AttitudePeak => "attitude error",
            Self::AttitudeRest => "attitude error at the end of the recovery",
            Self::RateRest => "body rate at the end of the recovery",
            Self::PositionPeak => "position error",
            Self::PositionRest => "position error at the end of the recovery",
            Self::VelocityRest => "velocity error at the end of the recovery",
            Self::HeadingPeak => "heading error",
            Self::Effort => "difference between successive commands",
        }
    }

    /// A value with its unit as text; angles are converted to degrees and shares to per cent.
    #[must_use]
    pub fn shown(self, value: f64) -> String {
        if value >= NOT_FINITE {
            return "not a number".to_owned();
        }
        match self {
            Self::Tilt | Self::AttitudePeak | Self::AttitudeRest | Self::HeadingPeak => {
                format!("{:.1} deg", value.to_degrees())
            }
            Self::RateRest => format!("{value:.2} rad/s"),
            Self::PositionPeak | Self::PositionRest => format!("{value:.3} m"),
            Self::VelocityRest => format!("{value:.3} m/s"),
            Self::Effort => format!("{:.1} %", 100.0 * value),
        }
    }
}

/// Width of the tube, from the section `[rehearsal]` of a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tube {
    /// The candidate's error may be this many times the owner's.
    pub owner_scale: f64,
    /// Distance from the reference at which a vehicle counts as lost \[m\].
    pub excursion_max_m: f64,
    /// Tilt at which a vehicle counts as lost \[rad\].
    pub tilt_max_rad: f64,
    /// Share of the envelope below which no error is refused, however small the owner's error is; noise alone
    /// causes such errors.
    pub floor_share: f64,
}

impl Default for Tube {
    fn default() -> Self {
        Self {
            owner_scale: 1.5,
            excursion_max_m: 0.5,
            tilt_max_rad: core::f64::consts::FRAC_PI_3,
            floor_share: 0.4,
        }
    }
}

/// One number of a rehearsal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// Number of the initial state: 0 for the mean, then the draws.
    pub draw: usize,
    /// Challenge of the window.
    pub challenge: Challenge,
    /// Beginning of the window, counted from the flip \[s\].
    pub at_s: f64,
    /// What is measured; its documentation has the unit of the four values below.
    pub measure: Measure,
    /// Value of the candidate; `f64::MAX` replaces one that is not a number.
    pub candidate: f64,
    /// Value of the owner in the same flight.
    pub owner: f64,
    /// Largest value that the vehicle's limits allow.
    pub envelope: f64,
    /// Largest value that the candidate may have.
    pub limit: f64,
}

impl Figure {
    /// True if the candidate stays within its limit, which a value that is not a number does not.
    #[must_use]
    pub fn is_within(&self) -> bool {
        self.candidate <= self.limit
    }
}

/// A candidate is as good as an owner beyond the envelope if its error is at most this many times the owner's:
/// both see the same noise and respond to it differently.
const AS_GOOD: f64 = 1.1;

/// Body rate that is allowed without a disturbance, as a share of what is allowed with one.
const CALM: f64 = 0.3;

/// Factor on the limits of attitude, body rate, effort and remaining position error while the arms sweep
/// fast: the inertia changes by more than half within a few control periods, and with it the loop gains.
const SWEEPING: f64 = 2.5;

/// Kind of a window, by what it demands of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The flip: all controllers of the rehearsed flight have just started and still settle.
    Begun,
    /// The reference moves smoothly.
    Calm,
    /// A kick, a push or a gust disturbs the vehicle.
    Shaken,
}

impl Phase {
    fn of(challenge: &Challenge) -> Self {
        match challenge {
            Challenge::Flip => Self::Begun,
            Challenge::Step { .. } | Challenge::Sweep => Self::Calm,
            Challenge::Kick { .. } | Challenge::Push { .. } | Challenge::Gust { .. } => {
                Self::Shaken
            }
        }
    }

    /// The value for this phase, of those for begun, calm and shaken.
    fn pick(self, [begun, calm, shaken]: [f64; 3]) -> f64 {
        match self {
            Self::Begun => begun,
            Self::Calm => calm,
            Self::Shaken => shaken,
        }
    }
}

/// Angle that a kick causes until full torque has stopped it \[rad\]; 0 for other challenges.
fn stopping_rad(challenge: &Challenge, limits: &Limits) -> f64 {
    let [x, y, z] = limits.stopping_b_rad;
    match challenge {
        Challenge::Kick { axis: Axis::Roll, .. } => x,
        Challenge::Kick { axis: Axis::Pitch, .. } => y,
        Challenge::Kick { axis: Axis::Yaw, .. } => z,
        Challenge::Kick { .. } => x.max(y).max(z),
        _ => 0.0,
    }
}

impl Tube {
    /// Limit on an error of the candidate. Where the owner's error is inside the envelope, it is
    /// `owner_scale` times that error, at least `floor_share` of the envelope and at most the envelope.
    /// Where the owner's error is beyond the envelope, it is `AS_GOOD` times that error, so that a candidate as
    /// good as the owner never fails.
    #[must_use]
    pub fn limit(&self, envelope: f64, owner: f64) -> f64 {
        if owner <= envelope {
            (self.owner_scale * owner).max(self.floor_share * envelope).min(envelope)
        } else if owner < NOT_FINITE {
            AS_GOOD * owner
        } else {
            envelope
        }
    }

    /// Largest value of a measure that the vehicle's limits allow in the window of a challenge, in the unit
    /// of the measure. The equations are in `launcher/docs/rehearsal.md`.
    #[must_use]
    pub fn envelope(
        &self,
        slot: Slot,
        measure: Measure,
        trial: &Trial,
        (facts, limits): (&Facts, &Limits),
    ) -> f64 {
        let challenge = &trial.challenge;
        let wider = if trial.sweeping { SWEEPING } else { 1.0 };
        let phase = Phase::of(challenge);
        let tilt_rad = facts.tilt_max_rad;
        match measure {
            Measure::Tilt => self.tilt_max_rad,
            Measure::AttitudePeak => 2.0 * (tilt_rad + stopping_rad(challenge, limits)),
            Measure::AttitudeRest => wider * phase.pick([0.7, 0.6, 1.0]) * tilt_rad,
            // The rate that covers the tilt bound within two and a half reaction times.
            Measure::RateRest => {
                wider * phase.pick([CALM, CALM, 1.0]) * tilt_rad / (2.5 * limits.reaction_s)
            }
            Measure::PositionPeak => match slot {
                Slot::Attitude => 0.5 * self.excursion_max_m,
                Slot::Position => self.excursion_max_m,
            },
            Measure::PositionRest => {
                let shares = match slot {
                    Slot::Attitude => [0.08, 0.08, 0.3],
                    Slot::Position => [0.5, 0.5, 0.8],
                };
                wider * phase.pick(shares) * self.excursion_max_m
            }
            // The rate at which a position loop reduces such an error, in 1/s.
            Measure::VelocityRest => phase.pick([1.6, 0.44, 2.8]) * self.excursion_max_m,
            // Position controllers pass the heading of the reference on.
            Measure::HeadingPeak => tilt_rad,
            Measure::Effort => match slot {
                Slot::Attitude => wider * phase.pick([0.4, 0.4, 0.9]),
                Slot::Position => wider * phase.pick([0.2, 0.07, 0.28]),
            },
        }
    }
}
