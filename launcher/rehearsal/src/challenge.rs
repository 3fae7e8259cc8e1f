//! The disturbances and set-point changes of a rehearsed flight, and their schedule.
//!
//! Each challenge has its own time window, so that a wrong sign, gain or delay about one axis shows there
//! and can be named. The three flights share the work: single kicks and a step of the set point in the
//! first, a gust and kicks in the opposite direction in the second, the sweep of the arms in the third.
//! Forces are in the world frame (ENU), body rates in the body frame (FLU).

use crate::limits::PUSH_S;
use crate::{Facts, Limits, Snapshot};
use serde::{Deserialize, Serialize};
use shared_types::Slot;

/// An axis: of the body for kicks, of the world for pushes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// About body x.
    Roll,
    /// About body y.
    Pitch,
    /// About body z.
    Yaw,
    /// All three at once.
    All,
    /// Along world x.
    X,
    /// Along world y.
    Y,
    /// Along world z.
    Z,
}

/// One challenge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Challenge {
    /// The candidate takes over.
    Flip,
    /// An instantaneous change of the body rate.
    Kick {
        /// Body axis of the kick.
        axis: Axis,
        /// Change of the body rate in the body frame \[rad/s\].
        body_rate_b_rad_s: [f64; 3],
    },
    /// A short pulse of force.
    Push {
        /// World axis of the push.
        axis: Axis,
        /// Force in the world frame \[N\].
        force_w_n: [f64; 3],
        /// Duration of the pulse \[s\].
        for_s: f64,
    },
    /// A force that is constant for part of the flight.
    Gust {
        /// Force in the world frame \[N\].
        force_w_n: [f64; 3],
        /// Duration of the gust \[s\].
        for_s: f64,
    },
    /// A guidance order to hover elsewhere.
    Step {
        /// New position relative to the reference at that instant, in the world frame \[m\].
        offset_w_m: [f64; 3],
    },
    /// The next sweeps of the arms in the plan, brought forward.
    Sweep,
}

/// A motion of the arms to another morph angle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sweep {
    /// Start, counted from the beginning of the rehearsed flight \[s\].
    pub at_s: f64,
    /// Morph angle β at the end \[°\].
    pub angle_deg: f64,
    /// Duration \[s\].
    pub over_s: f64,
}

/// A challenge and its time window. Times count from the beginning of the rehearsed flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// The challenge at the beginning of the window.
    pub challenge: Challenge,
    /// Beginning of the window \[s\].
    pub at_s: f64,
    /// End of the window, where the next one begins \[s\].
    pub until_s: f64,
    /// True if the plan has the arms sweep fast during the window, which widens its limits.
    pub sweeping: bool,
}

/// The challenges of one flight of a rehearsal.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Schedule {
    /// In order of time, without gaps.
    pub trials: Vec<Trial>,
    /// Sweeps of the plan that are brought forward into this flight, in order of time.
    pub sweeps: Vec<Sweep>,
}

impl Challenge {
    /// Name of the challenge with its article, to follow the word "after" in a sentence.
    #[must_use]
    pub fn description(&self) -> &'static str {
        match self {
            Self::Flip => "the flip",
            Self::Kick { axis, .. } => match axis {
                Axis::Roll => "a kick in roll",
                Axis::Pitch => "a kick in pitch",
                Axis::Yaw => "a kick in yaw",
                _ => "a kick about all axes",
            },
            Self::Push { axis, .. } => match axis {
                Axis::X => "a push along x",
                Axis::Y => "a push along y",
                Axis::Z => "a push along z",
                _ => "a push along all axes",
            },
            Self::Gust { .. } => "a gust",
            Self::Step { .. } => "a step of the set point",
            Self::Sweep => "the sweep of the arms",
        }
    }
}

/// Bounds on the length of the step \[m\], which is the distance that the reference covers in half a second
/// at its highest speed. A shorter step would be hidden by noise; a longer one could not be finished at the
/// tilt bound in the remaining time.
const STEP_M: core::ops::RangeInclusive<f64> = 0.3..=0.6;
/// Share of the lateral force at the tilt bound that load, reference and gust may need together.
const GUST_SHARE: f64 = 0.8;

/// Force of the gust in the world frame \[N\]: in the direction of the estimated load, and as large as the
/// tilt bound permits beside load and reference.
fn gust(facts: &Facts, limits: &Limits, snapshot: &Snapshot) -> [f64; 3] {
    let mass_kg = facts.vehicle.mass_kg;
    let [x, y, _] = snapshot.force_w_n;
    let load_n = libm::hypot(x, y);
    let least_n = 0.1 * mass_kg * limits.lateral_m_s2;
    let most_n = GUST_SHARE * mass_kg * limits.lateral_m_s2;
    let spare_n = (most_n - load_n - mass_kg * facts.acceleration_m_s2).max(least_n);
    // Without a load every direction is equivalent; the diagonal makes the vehicle tilt about both axes.
    let [along_x, along_y] = if load_n > 1e-3 {
        [x / load_n, y / load_n]
    } else {
        [core::f64::consts::FRAC_1_SQRT_2; 2]
    };
    [spare_n * along_x, spare_n * along_y, 0.0]
}

fn kick(limits: &Limits, axis: Axis, sign: f64) -> Challenge {
    let chosen = match axis {
        Axis::Roll => [1.0, 0.0, 0.0],
        Axis::Pitch => [0.0, 1.0, 0.0],
        Axis::Yaw => [0.0, 0.0, 1.0],
        _ => [0.7; 3],
    };
    let body_rate_b_rad_s = core::array::from_fn(|i| sign * chosen[i] * limits.kick_b_rad_s[i]);
    Challenge::Kick { axis, body_rate_b_rad_s }
}

fn push(facts: &Facts, limits: &Limits, axis: Axis, sign: f64) -> Challenge {
    let chosen = match axis {
        Axis::X => [1.0, 0.0, 0.0],
        Axis::Y => [0.0, 1.0, 0.0],
        Axis::Z => [0.0, 0.0, 1.0],
        _ => [0.7; 3],
    };
    let unit_n = facts.vehicle.mass_kg / PUSH_S;
    let force_w_n = core::array::from_fn(|i| sign * chosen[i] * unit_n * limits.push_m_s[i]);
    Challenge::Push { axis, force_w_n, for_s: PUSH_S }
}

/// The challenges of each flight with their beginning, as a share of the time `span_s` from the flip to the
/// end of the flight.
fn plans(
    slot: Slot,
    facts: &Facts,
    snapshot: &Snapshot,
    span_s: f64,
) -> [Vec<(f64, Challenge)>; crate::DRAWS] {
    let limits = Limits::of(facts);
    let gust_n = gust(facts, &limits, snapshot);
    let step_m = (0.5 * facts.speed_m_s).clamp(*STEP_M.start(), *STEP_M.end());
    let step = Challenge::Step { offset_w_m: [0.7 * step_m, -0.7 * step_m, 0.3 * step_m] };
    match slot {
        Slot::Attitude => [
            vec![
                (0.1, kick(&limits, Axis::Roll, 1.0)),
                (0.27, kick(&limits, Axis::Pitch, 1.0)),
                (0.44, kick(&limits, Axis::Yaw, 1.0)),
                (0.61, step),
            ],
            vec![
                (0.1, Challenge::Gust { force_w_n: gust_n, for_s: 0.25 * span_s }),
                (0.5, kick(&limits, Axis::Roll, -1.0)),
                (0.65, kick(&limits, Axis::Pitch, -1.0)),
                (0.8, kick(&limits, Axis::Yaw, -1.0)),
            ],
            vec![
                (0.1, Challenge::Sweep),
                (0.5, kick(&limits, Axis::All, 1.0)),
                (0.75, kick(&limits, Axis::All, -1.0)),
            ],
        ],
        Slot::Position => [
            vec![
                (0.1, push(facts, &limits, Axis::X, 1.0)),
                (0.3, push(facts, &limits, Axis::Y, 1.0)),
                (0.5, push(facts, &limits, Axis::Z, 1.0)),
                (0.65, step),
            ],
            vec![
                (0.1, Challenge::Gust { force_w_n: gust_n, for_s: 0.3 * span_s }),
                (0.65, push(facts, &limits, Axis::Z, -1.0)),
            ],
            vec![
                (0.1, Challenge::Sweep),
                (0.4, push(facts, &limits, Axis::X, -1.0)),
                (0.7, push(facts, &limits, Axis::Y, -1.0)),
            ],
        ],
    }
}

/// The schedule of each flight of a rehearsal. `sweeps` are the sweeps of the plan to bring forward;
/// `planned` are the times in which the plan itself has the arms sweep fast (from, until) \[s\]; `flip_s` is
/// the instant at which the candidate takes over and `end_s` the end of the flight \[s\]. All times count
/// from the beginning of the rehearsed flight.
#[must_use]
pub fn schedule(
    slot: Slot,
    facts: &Facts,
    snapshot: &Snapshot,
    (sweeps, planned): (&[Sweep], &[(f64, f64)]),
    (flip_s, end_s): (f64, f64),
) -> [Schedule; crate::DRAWS] {
    let plans = plans(slot, facts, snapshot, end_s - flip_s);
    let mut index = 0;
    plans.map(|plan| {
        let shakes = |challenge: &Challenge| match challenge {
            Challenge::Step { .. } => !facts.is_rig,
            Challenge::Sweep => !sweeps.is_empty(),
            _ => true,
        };
        let trial = |challenge, at_s| Trial { challenge, at_s, until_s: end_s, sweeping: false };
        let mut trials = vec![trial(Challenge::Flip, flip_s)];
        for (share, challenge) in plan.into_iter().filter(|(_, challenge)| shakes(challenge)) {
            // Multiples of 20 ms are release instants of every loop, so that the figures do not depend on
            // rounding.
            let at_s = ((flip_s + share * (end_s - flip_s)) * 50.0).round() / 50.0;
            if let Some(last) = trials.last_mut() {
                last.until_s = at_s;
            }
            trials.push(trial(challenge, at_s));
        }
        for trial in &mut trials {
            let within =
                |(from_s, until_s): &(f64, f64)| *from_s < trial.until_s && *until_s > trial.at_s;
            trial.sweeping = planned.iter().any(within);
        }
        let begin_s = trials.iter().find(|trial| trial.challenge == Challenge::Sweep);
        let sweeps = match (index, begin_s) {
            (2, Some(trial)) => brought_forward(sweeps, trial.at_s),
            _ => Vec::new(),
        };
        index += 1;
        Schedule { trials, sweeps }
    })
}

/// The sweeps in immediate succession from `at_s` on.
fn brought_forward(sweeps: &[Sweep], at_s: f64) -> Vec<Sweep> {
    let mut begin_s = at_s;
    let mut forward = Vec::new();
    for sweep in sweeps {
        forward.push(Sweep { at_s: begin_s, ..*sweep });
        begin_s += sweep.over_s + 0.1;
    }
    forward
}
