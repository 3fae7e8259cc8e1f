//! A family of random flights: `figure8-morph` by vehicles and in weather that the controllers' models do not know.
//!
//! [`RANGES`] lists what is drawn, evenly and by seed; [`fly`] flies the members that a [`Plan`] names, on all cores in
//! this process. A member that no law within its bounds could hold still is left out and listed. Open `draw.rs` for how a
//! draw becomes a scenario and when it has no trim, `report.rs` for tables, picture and files.

mod draw;
pub mod report;
#[cfg(test)]
mod tests;

pub use draw::{Draw, RANGES, Range};

use ::verdict::Grade;
use document::ScenarioError;
use observe::{Closing, Metrics};
use scenario::{Override, Scenario};
use simulate::fan_out::{Progress, fan_out};
use simulate::in_process::{InProcessError, StateSource, fly as fly_alone};
use thiserror::Error;

/// What is flown.
const SCENARIO: &str = "figure8-morph";

/// Which members to fly, and with which changes.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Their seeds.
    pub seeds: Vec<u64>,
    /// Changes of the scenario that all of them share, such as other controllers.
    pub overrides: Vec<Override>,
    /// The same as flags of `morphquad run`, quoted as a shell needs it.
    pub flags: String,
}

impl Plan {
    /// Flights that this takes, at most.
    #[must_use]
    pub fn flights(&self) -> usize {
        self.seeds.len()
    }
}

/// One flight in numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    /// What was drawn.
    pub draw: Draw,
    /// Root mean square of the position error \[m\].
    pub rms_m: f64,
    /// Largest position error \[m\].
    pub max_m: f64,
    /// Largest tilt \[rad\].
    pub tilt_rad: f64,
    /// Verdict.
    pub grade: Grade,
    /// Flags of `morphquad run figure8-morph` that fly it again.
    pub flags: String,
}

impl Flown {
    /// The vehicle was lost.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.grade >= Grade::Lost
    }
}

/// All members of a plan.
#[derive(Debug, Clone)]
pub struct Study {
    /// What was asked for.
    pub plan: Plan,
    /// Those that were flown, by seed.
    pub flights: Vec<Flown>,
    /// Those without a trim, and why.
    pub left_out: Vec<(Draw, String)>,
}

impl Study {
    /// The largest error that a share of all flights stays below \[m\]; not a number without flights.
    #[must_use]
    pub fn quantile_m(&self, share: f64) -> f64 {
        let mut errors: Vec<f64> = self.flights.iter().map(|flown| flown.max_m).collect();
        errors.sort_by(f64::total_cmp);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a place in the list"
        )]
        let place = (share * errors.len() as f64).ceil() as usize;
        errors.get(place.max(1) - 1).copied().unwrap_or(f64::NAN)
    }

    /// Flights whose vehicle was lost.
    #[must_use]
    pub fn lost(&self) -> usize {
        self.flights.iter().filter(|flown| flown.is_lost()).count()
    }

    /// Flights that were farther from their path than this, once at least.
    #[must_use]
    pub fn beyond(&self, limit_m: f64) -> usize {
        self.flights.iter().filter(|flown| flown.max_m > limit_m).count()
    }
}

/// Why a study cannot be flown.
#[derive(Debug, Error)]
pub enum RandomError {
    /// A flight's scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The position law refuses its numbers.
    #[error(transparent)]
    Law(#[from] position_mpc::ConfigError),
    /// A flight cannot be flown to its end.
    #[error(transparent)]
    Flight(#[from] InProcessError),
}

/// Flies the plan on all cores.
///
/// # Errors
/// The first scenario that is refused, or flight that hangs.
pub fn fly(plan: &Plan, progress: Progress<'_>) -> Result<Study, RandomError> {
    let base = Scenario::load(SCENARIO, &plan.overrides)?;
    let (bounds, model) = (base.position_law()?, base.modelled_vehicle());
    let (mut with_trim, mut left_out) = (Vec::new(), Vec::new());
    for draw in plan.seeds.iter().copied().map(Draw::of) {
        match draw.without_trim(&bounds, &model) {
            Some(why) => {
                left_out.push((draw, why));
                progress();
            }
            None => with_trim.push(draw),
        }
    }
    let flights = fan_out(&with_trim, progress, |draw| fly_one(plan, &base, *draw))?;
    Ok(Study { plan: plan.clone(), flights, left_out })
}

fn fly_one(plan: &Plan, base: &Scenario, draw: Draw) -> Result<Flown, RandomError> {
    let drawn = draw.flags(base);
    let scenario = draw.scenario(&plan.overrides, &drawn)?;
    let mut metrics = fly_alone(&scenario, StateSource::Estimator, Metrics::of(&scenario))?;
    metrics.finish();
    let closing = Closing { flown_ns: scenario.duration_ns(), ..Closing::default() };
    let tracking = metrics.tracking();
    let drawn = drawn.iter().map(|flag| format!(" --set {}", document::shell_word(flag)));
    let given = Some(&plan.flags).filter(|flags| !flags.is_empty());
    let given = given.map_or(String::new(), |flags| format!(" {flags}"));
    Ok(Flown {
        draw,
        rms_m: tracking.rms_m,
        max_m: tracking.max_m,
        tilt_rad: metrics.tilt_max_rad(),
        grade: metrics.judge(&closing).grade(),
        flags: format!("--seed {}{given}{}", draw.seed, drawn.collect::<String>()),
    })
}
