//! Flight through morphing: `figure8-morph` at ever faster sweeps, with a model that knows the
//! arms and with models that do not.
//!
//! [`Plan`] names what is flown, [`fly`] flies it on all cores in this process and gives a
//! [`Study`] of [`Cell`]s. Open `flown.rs` for what is measured in a flight, `marks.rs` for what
//! the scheduled law promises, `report.rs` for table, picture and files.

mod flown;
mod marks;
pub mod report;
#[cfg(test)]
mod tests;

pub use flown::{Flown, Window};
pub use marks::{Mark, marks};

use document::ScenarioError;
use flown::fly_one;
use scenario::{Override, Scenario};
use serde::Serialize;
use simulate::fan_out::{Progress, fan_out};
use simulate::in_process::{InProcessError, StateSource};
use thiserror::Error;

/// First instant of a sweep \[s\]: the figure is at full speed.
const FIRST_SWEEP_S: f64 = 3.0;
/// No sweep ends later \[s\].
const LAST_SWEEP_S: f64 = 17.0;
/// Rest at a size between two sweeps \[s\].
const REST_S: f64 = 1.0;

/// What the attitude law believes about the arms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// The measured angle.
    Scheduled,
    /// This angle \[°\], whatever is measured.
    Fixed(f64),
}

/// Everything about a flight but law, sweep and seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Conditions {
    /// The scenario's wind, or calm air.
    pub wind: bool,
    /// Rotor lag and command delay are in the attitude law's prediction model.
    pub lag_modelled: bool,
    /// The rotors lag as the vehicle's do, or hardly at all.
    pub lag_real: bool,
    /// Where the controllers' state comes from.
    pub state: StateSource,
}

impl Conditions {
    /// As the vehicle is flown, in calm air.
    #[must_use]
    pub fn calm(state: StateSource) -> Self {
        Self { wind: false, lag_modelled: true, lag_real: true, state }
    }

    /// Lag modelled where there is lag: what is flown, and what the marks are about.
    #[must_use]
    pub fn is_as_flown(&self) -> bool {
        self.lag_modelled && self.lag_real
    }
}

/// What to fly: every combination.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Durations of a sweep from one end of the linkage to the other \[s\].
    pub sweeps_s: Vec<f64>,
    pub laws: Vec<Law>,
    pub conditions: Vec<Conditions>,
    /// Seeds of the scheduled law as flown, from 1.
    pub seeds: u64,
    /// Seeds of every other cell, from 1; no more than `seeds`.
    pub other_seeds: u64,
}

impl Plan {
    /// All four laws at five sweeps in all sixteen conditions.
    #[must_use]
    pub fn full(seeds: u64) -> Self {
        let mut conditions = Vec::new();
        for (lag_modelled, lag_real) in [(true, true), (false, true), (true, false), (false, false)]
        {
            for wind in [false, true] {
                for state in [StateSource::Truth, StateSource::Estimator] {
                    conditions.push(Conditions { wind, lag_modelled, lag_real, state });
                }
            }
        }
        Self {
            sweeps_s: vec![4.0, 2.0, 1.0, 0.6, 0.3],
            laws: vec![Law::Scheduled, Law::Fixed(45.0), Law::Fixed(94.5), Law::Fixed(160.0)],
            conditions,
            seeds,
            other_seeds: seeds.min(3),
        }
    }

    /// The slowest and the fastest sweep in calm air, as flown.
    #[must_use]
    pub fn quick(seeds: u64) -> Self {
        let states = [StateSource::Truth, StateSource::Estimator];
        Self {
            sweeps_s: vec![4.0, 0.3],
            conditions: states.map(Conditions::calm).to_vec(),
            other_seeds: 1,
            ..Self::full(seeds)
        }
    }

    /// Flights that this takes, those without morph included.
    #[must_use]
    pub fn flights(&self) -> usize {
        self.cells().len() + self.baselines().len()
    }

    fn seeds_of(&self, law: Law, conditions: Conditions) -> u64 {
        let promised = law == Law::Scheduled && conditions.is_as_flown();
        // In calm air with perfect state only the encoder's noise differs.
        let random = conditions.wind || conditions.state == StateSource::Estimator;
        if promised && random { self.seeds } else { self.other_seeds.min(self.seeds) }
    }

    fn cells(&self) -> Vec<Flight> {
        let mut flights = Vec::new();
        for &conditions in &self.conditions {
            for &law in &self.laws {
                for &sweep_s in &self.sweeps_s {
                    for seed in 1..=self.seeds_of(law, conditions) {
                        flights.push(Flight { law, sweep_s: Some(sweep_s), conditions, seed });
                    }
                }
            }
        }
        flights
    }

    /// Flights without morph: the scheduled law, so that its model is right.
    fn baselines(&self) -> Vec<Flight> {
        let law = Law::Scheduled;
        let of = |&conditions| {
            let seeds = 1..=self.seeds_of(law, conditions);
            seeds.map(move |seed| Flight { law, sweep_s: None, conditions, seed })
        };
        self.conditions.iter().flat_map(of).collect()
    }
}

/// One flight.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Flight {
    law: Law,
    /// Duration of its sweeps \[s\]; none without morph.
    sweep_s: Option<f64>,
    conditions: Conditions,
    seed: u64,
}

/// One law at one sweep in one set of conditions, over its seeds.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    pub law: Law,
    /// Duration of a sweep \[s\].
    pub sweep_s: f64,
    pub conditions: Conditions,
    /// Each flight.
    pub flights: Vec<Flown>,
    /// Root mean square of the position error in the sweep windows over that in the same windows
    /// of the identical flight without morph, for each flight.
    pub ratios: Vec<f64>,
}

impl Cell {
    /// Root mean square of the position error over all flights \[m\].
    #[must_use]
    pub fn rms_m(&self) -> f64 {
        let squares = self.flights.iter().map(|f| f.rms_m * f.rms_m).sum::<f64>();
        (squares / self.flights.len().max(1) as f64).sqrt()
    }

    /// Largest position error of all flights \[m\].
    #[must_use]
    pub fn peak_m(&self) -> f64 {
        self.flights.iter().map(|f| f.peak_m).fold(0.0, f64::max)
    }

    /// Mean over the flights of the ratio of each.
    #[must_use]
    pub fn mean_ratio(&self) -> f64 {
        self.ratios.iter().sum::<f64>() / self.ratios.len().max(1) as f64
    }

    /// Largest ratio of any flight.
    #[must_use]
    pub fn worst_ratio(&self) -> f64 {
        self.ratios.iter().copied().fold(0.0, f64::max)
    }

    /// The worst that happened to any flight.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        self.flights.iter().map(|f| f.verdict).max().unwrap_or(Verdict::Flown)
    }
}

/// How a flight went; the worst comes last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Quietly.
    Flown,
    /// The attitude oscillated without end and without loss.
    LimitCycle,
    /// The vehicle was lost, or the gate had to take over.
    Lost,
}

/// All cells, in the order conditions, law, sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// What was flown.
    pub plan: Plan,
    /// What came of it.
    pub cells: Vec<Cell>,
}

/// Why a study cannot be flown.
#[derive(Debug, Error)]
pub enum MorphingError {
    /// A flight's scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A flight cannot be flown to its end.
    #[error(transparent)]
    Flight(#[from] InProcessError),
}

/// Flies the plan on all cores.
///
/// # Errors
/// The first scenario that is refused, or flight that hangs.
pub fn fly(plan: &Plan, progress: Progress<'_>) -> Result<Study, MorphingError> {
    let (cells, baselines) = (plan.cells(), plan.baselines());
    let flights: Vec<Flight> = cells.iter().chain(&baselines).copied().collect();
    let windows: Vec<_> = plan.sweeps_s.iter().map(|&sweep_s| windows(sweep_s)).collect();
    let work = |flight: &Flight| fly_one(&scenario(flight)?, flight, &windows);
    let mut morphed = fan_out(&flights, progress, work)?;
    let still = morphed.split_off(cells.len());
    Ok(Study { plan: plan.clone(), cells: collect(plan, &cells, morphed, &baselines, &still) })
}

/// Puts the flights of a cell together and each beside the one without morph.
fn collect(
    plan: &Plan,
    flights: &[Flight],
    flown: Vec<Flown>,
    baselines: &[Flight],
    still: &[Flown],
) -> Vec<Cell> {
    let mut cells: Vec<Cell> = Vec::new();
    for (flight, flown) in flights.iter().zip(flown) {
        let &Flight { law, sweep_s: Some(sweep_s), conditions, seed } = flight else { continue };
        let sweep = plan.sweeps_s.iter().position(|s| s.total_cmp(&sweep_s).is_eq()).unwrap_or(0);
        let is_same = |b: &Flight| (b.conditions, b.seed) == (conditions, seed);
        let reference = baselines.iter().zip(still).find(|(b, _)| is_same(b));
        let reference_m = reference.map_or(f64::NAN, |(_, still)| still.window_rms_m[sweep]);
        let is_its = |c: &Cell| (c.law, c.sweep_s, c.conditions) == (law, sweep_s, conditions);
        if !cells.last().is_some_and(is_its) {
            let (flights, ratios) = (Vec::new(), Vec::new());
            cells.push(Cell { law, sweep_s, conditions, flights, ratios });
        }
        if let Some(cell) = cells.last_mut() {
            cell.ratios.push(flown.window_rms_m[sweep] / reference_m);
            cell.flights.push(flown);
        }
    }
    cells
}

/// Sweeps there and back with a rest after each, as many as fit.
fn windows(sweep_s: f64) -> Vec<Window> {
    let starts = (0..).map(|i| FIRST_SWEEP_S + f64::from(i) * (sweep_s + REST_S));
    let windows = starts.map(|from_s| Window { from_s, to_s: from_s + sweep_s });
    windows.take_while(|w| w.to_s <= LAST_SWEEP_S + 1e-9).collect()
}

/// `figure8-morph` with the edits that make it this flight.
fn scenario(flight: &Flight) -> Result<Scenario, ScenarioError> {
    let mut edits = vec![format!("pilot.morph={}", knots(flight.sweep_s))];
    let Conditions { wind, lag_modelled, lag_real, .. } = flight.conditions;
    if !wind {
        edits.push("disturbance_injector.script=[]".to_owned());
    }
    if !lag_modelled {
        edits.push("attitude_mpc.rotor_lag_s=0.0".to_owned());
        edits.push("attitude_mpc.command_delay_s=0.0".to_owned());
    }
    if !lag_real {
        edits.push("plant.mismatch.rotor_lag_s=0.0001".to_owned());
    }
    if let Law::Fixed(angle_deg) = flight.law {
        edits.push(format!("attitude_mpc.fixed_morph_angle_deg={angle_deg:?}"));
    }
    let mut overrides = vec![Override::seed(flight.seed)];
    for edit in &edits {
        overrides.push(Override::set(edit)?);
    }
    Scenario::load("figure8-morph", &overrides)
}

/// The schedule of the deployable angle, as a scenario writes it.
fn knots(sweep_s: Option<f64>) -> String {
    let sweeps = sweep_s.map(windows).unwrap_or_default();
    let ends = [(45.0, 160.0), (160.0, 45.0)].into_iter().cycle();
    let knots = sweeps.iter().zip(ends).map(|(Window { from_s, to_s }, (from, to))| {
        format!("[{from_s:?}, {from:?}], [{to_s:?}, {to:?}]")
    });
    format!("[{}]", knots.collect::<Vec<_>>().join(", "))
}
