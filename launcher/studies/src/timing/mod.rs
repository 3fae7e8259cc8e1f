//! What each loop of a flight bears: how long its steps may take, and how late it may begin.
//!
//! [`fly`] flies a scenario with `[[timing]]` for one loop at a time, over [`TIMES_S`] and then closer and closer to the
//! times up to which nothing is missed, the flight passes, and the vehicle is not lost. Open `report.rs` for tables,
//! picture and files.

pub mod report;
#[cfg(test)]
mod tests;

use crate::stability::{Bench, StabilityError, delay_margin_s};
use ::verdict::Grade;
use document::ScenarioError;
use observe::{Closing, Metrics};
use scenario::services::Assignment;
use scenario::{Override, Scenario};
use shared_types::Role;
use simulate::fan_out::{Progress, fan_out};
use simulate::in_process::{InProcessError, StateSource, fly as fly_alone};
use thiserror::Error;

/// Loops between a sensor and a rotor: estimator, position and attitude.
const LOOPS: [Role; 3] = [Role::Estimator, Role::Position, Role::Attitude];
/// Shortest and longest time that is flown \[s\].
pub const TIMES_S: [f64; 2] = [1e-4, 0.4];

/// What takes time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Each step, always the same.
    Step,
    /// The begin of each step, anything up to the time.
    Jitter,
}

/// Both of them, in the order shown.
pub const KINDS: [Kind; 2] = [Kind::Step, Kind::Jitter];

impl Kind {
    /// As in tables.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Step => "step takes",
            Self::Jitter => "begins late by up to",
        }
    }

    /// The flag of `morphquad run` for a loop and a time.
    fn flag(self, role: Role, time_s: f64) -> String {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "positive, below a second"
        )]
        let time_ns = (time_s * 1e9).round() as u64;
        match self {
            Self::Step => format!("{}:step={time_ns}ns", role.label()),
            Self::Jitter => format!("{}:start-late=0s..{time_ns}ns", role.label()),
        }
    }
}

/// What to fly.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Name or path of the scenario.
    pub scenario: String,
    /// Changes of it that all flights share.
    pub overrides: Vec<Override>,
    /// The same as flags of `morphquad run`, quoted as a shell needs it.
    pub flags: String,
    /// Times between the shortest and the longest, both included.
    pub points: u16,
    /// Halvings, by ratio, of the bracket of a limit.
    pub halvings: u16,
}

impl Plan {
    /// Flights that this takes.
    #[must_use]
    pub fn flights(&self) -> usize {
        let sweeps = LOOPS.len() * KINDS.len();
        sweeps * (usize::from(self.points) + LIMITS.len() * usize::from(self.halvings))
    }

    fn times_s(&self) -> Vec<f64> {
        let [least_s, most_s] = TIMES_S;
        let last = f64::from(self.points.max(2) - 1);
        let time_s = |k: u16| least_s * libm::pow(most_s / least_s, f64::from(k) / last);
        (0..self.points.max(2)).map(time_s).collect()
    }
}

/// One flight in numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// The time that it was flown with \[s\].
    pub time_s: f64,
    /// Root mean square of the position error \[m\].
    pub rms_m: f64,
    /// Largest position error \[m\].
    pub max_m: f64,
    /// Releases left out and inputs missed by all loops.
    pub missed: u64,
    /// Samples that came after the step they were for.
    pub late: u64,
    /// Verdict.
    pub grade: Grade,
}

/// Up to what a time is borne.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// No loop misses anything, and no sample is late.
    OnTime,
    /// The flight passes.
    Passes,
    /// The vehicle is not lost.
    Survives,
}

/// All of them, in the order shown.
pub const LIMITS: [Limit; 3] = [Limit::OnTime, Limit::Passes, Limit::Survives];

impl Limit {
    fn holds(self, flown: &Flown) -> bool {
        match self {
            Self::OnTime => flown.missed + flown.late == 0,
            Self::Passes => flown.grade == Grade::Passed,
            Self::Survives => flown.grade < Grade::Lost,
        }
    }
}

/// One loop and one kind of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// The loop.
    pub role: Role,
    /// The service that runs it.
    pub name: String,
    /// Its period \[s\].
    pub period_s: f64,
    /// What takes time.
    pub kind: Kind,
    /// By time.
    pub flights: Vec<Flown>,
    /// The longest time up to which each of [`LIMITS`] holds, and none if it does not at the shortest; the longest of
    /// [`TIMES_S`] if it holds up to there \[s\].
    pub limits_s: [Option<f64>; LIMITS.len()],
}

/// All sweeps.
#[derive(Debug, Clone)]
pub struct Study {
    /// What was asked for.
    pub plan: Plan,
    /// The flight in which nothing takes time.
    pub usual: Flown,
    /// By kind and loop.
    pub sweeps: Vec<Sweep>,
    /// How long after its release a command may be in effect before the attitude MPC's loop is unstable as it starts, by the
    /// eigenvalues that `study stability` takes: the delay that the law models and its margin; none if another controller
    /// flies, or no delay makes it so \[s\].
    pub predicted_s: Option<f64>,
}

/// Why a study cannot be flown.
#[derive(Debug, Error)]
pub enum TimingError {
    /// A flight's scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// Its loops cannot be wired.
    #[error(transparent)]
    Wiring(#[from] scenario::WiringError),
    /// The attitude law refuses its numbers.
    #[error(transparent)]
    Law(#[from] attitude_mpc::ConfigError),
    /// The eigenvalues of the attitude loop.
    #[error(transparent)]
    Stability(#[from] StabilityError),
    /// A flight cannot be flown to its end.
    #[error(transparent)]
    Flight(#[from] InProcessError),
    /// A scenario in which loops take time already.
    #[error("the scenario has [[timing]] of its own, which the study would change")]
    Timed,
}

/// Flies the plan on all cores.
///
/// # Errors
/// The first scenario that is refused, or flight that hangs.
pub fn fly(plan: &Plan, progress: Progress<'_>) -> Result<Study, TimingError> {
    let base = Scenario::load(&plan.scenario, &plan.overrides)?;
    if !base.settings().timing.is_empty() {
        return Err(TimingError::Timed);
    }
    let graph = base.graph()?;
    let assignment = Assignment::of(base.settings());
    let nodes = LOOPS.iter().filter_map(|role| graph.node(*role));
    let mut sweeps: Vec<Sweep> = KINDS
        .into_iter()
        .flat_map(|kind| nodes.clone().map(move |node| (kind, node)))
        .map(|(kind, node)| Sweep {
            role: node.role,
            name: assignment.name(node.role).to_owned(),
            period_s: 1.0 / node.rate.hz(),
            kind,
            flights: Vec::new(),
            limits_s: [None; LIMITS.len()],
        })
        .collect();
    let times_s = plan.times_s();
    let cases: Vec<(Role, Kind, f64)> = sweeps
        .iter()
        .flat_map(|sweep| times_s.iter().map(|time_s| (sweep.role, sweep.kind, *time_s)))
        .collect();
    let flown = fan_out(&cases, progress, |case| fly_one(plan, Some(*case)))?;
    for (sweep, flights) in sweeps.iter_mut().zip(flown.chunks(times_s.len())) {
        sweep.flights = flights.to_vec();
    }
    let wanted: Vec<(usize, usize)> = (0..sweeps.len())
        .flat_map(|sweep| (0..LIMITS.len()).map(move |limit| (sweep, limit)))
        .collect();
    let found = fan_out(&wanted, &|| (), |&(sweep, limit)| {
        find(plan, &sweeps[sweep], LIMITS[limit], progress)
    })?;
    for ((sweep, limit), found_s) in wanted.into_iter().zip(found) {
        sweeps[sweep].limits_s[limit] = found_s;
    }
    let usual = fly_one(plan, None)?;
    Ok(Study { plan: plan.clone(), usual, sweeps, predicted_s: predicted_s(&base)? })
}

/// The longest time up to which a limit holds: between the last flight of the sweep in which it does and the first in which
/// it does not.
fn find(
    plan: &Plan,
    sweep: &Sweep,
    limit: Limit,
    progress: Progress<'_>,
) -> Result<Option<f64>, TimingError> {
    let breaks = sweep.flights.iter().position(|flown| !limit.holds(flown));
    let (Some(first), Some(bad)) = (breaks, breaks.and_then(|at| sweep.flights.get(at))) else {
        return Ok(sweep.flights.last().map(|flown| flown.time_s));
    };
    let Some(good) = first.checked_sub(1).and_then(|at| sweep.flights.get(at)) else {
        return Ok(None);
    };
    let (mut good_s, mut bad_s) = (good.time_s, bad.time_s);
    for _ in 0..plan.halvings {
        let middle_s = (good_s * bad_s).sqrt();
        let flown = fly_one(plan, Some((sweep.role, sweep.kind, middle_s)))?;
        progress();
        if limit.holds(&flown) { good_s = middle_s } else { bad_s = middle_s }
    }
    Ok(Some(good_s))
}

fn fly_one(plan: &Plan, case: Option<(Role, Kind, f64)>) -> Result<Flown, TimingError> {
    let mut overrides = plan.overrides.clone();
    if let Some((role, kind, time_s)) = case {
        overrides.push(Override::timing(&kind.flag(role, time_s))?);
    }
    let scenario = Scenario::load(&plan.scenario, &overrides)?;
    let mut metrics = fly_alone(&scenario, StateSource::Estimator, Metrics::of(&scenario))?;
    metrics.finish();
    let closing = Closing { flown_ns: scenario.duration_ns(), ..Closing::default() };
    let (tracking, totals) = (metrics.tracking(), metrics.totals());
    Ok(Flown {
        time_s: case.map_or(0.0, |(.., time_s)| time_s),
        rms_m: tracking.rms_m,
        max_m: tracking.max_m,
        missed: totals.missed,
        late: totals.late,
        grade: metrics.judge(&closing).grade(),
    })
}

fn predicted_s(base: &Scenario) -> Result<Option<f64>, TimingError> {
    let settings = base.settings();
    if Assignment::of(settings).name(Role::Attitude) != "attitude-mpc" {
        return Ok(None);
    }
    let graph = base.graph()?;
    let Some(node) = graph.node(Role::Attitude) else { return Ok(None) };
    let rate_hz = node.rate.hz();
    let morph_angle = base.start_morph_angle().map_err(StabilityError::from)?;
    let bench = Bench { rate_hz, morph_angle, vehicle: base.modelled_vehicle() };
    let law = base.attitude_law()?;
    let margin_s = delay_margin_s(&bench, &law)?;
    Ok(margin_s.map(|margin_s| law.command_delay_s + margin_s))
}
