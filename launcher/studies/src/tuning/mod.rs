//! Sets of numbers for the position MPC, by how close they fly and by how much they bear.
//!
//! Candidates are drawn by seed from [`KNOBS`], the shipped set first. Each flies figure eights in ever shorter periods,
//! calm and in wind, and the [random flights](crate::random) of some seeds. The Pareto front, candidates that no other one
//! beats in everything, is judged on seeds that nothing was chosen by. Open `report.rs` for table, picture and files.

pub mod report;
#[cfg(test)]
mod tests;

use crate::random::{self, RandomError};
use observe::Metrics;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scenario::{Override, Scenario};
use simulate::fan_out::{Progress, fan_out};
use simulate::in_process::{StateSource, fly as fly_alone};

/// A number of the position MPC that is tuned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knob {
    /// Its key in a scenario.
    pub key: &'static str,
    pub least: f64,
    /// Largest.
    pub most: f64,
    /// Decimals that are tried: 0 for a whole number.
    pub decimals: usize,
}

/// What is drawn: evenly, by the logarithm where the ends are a factor of ten apart.
pub const KNOBS: [Knob; 8] = [
    Knob { key: "position_mpc.prediction_horizon", least: 90.0, most: 110.0, decimals: 0 },
    Knob { key: "position_mpc.control_horizon", least: 60.0, most: 90.0, decimals: 0 },
    Knob { key: "position_mpc.control_blocks", least: 6.0, most: 10.0, decimals: 0 },
    Knob { key: "position_mpc.tilt_weight", least: 0.5, most: 5.0, decimals: 2 },
    Knob { key: "position_mpc.thrust_weight", least: 0.05, most: 2.0, decimals: 2 },
    Knob { key: "position_mpc.tilt_step_max_rad", least: 0.04, most: 0.08, decimals: 3 },
    Knob { key: "position_mpc.tilt_lag_s", least: 0.02, most: 0.05, decimals: 3 },
    Knob { key: "position_mpc.tilt_delay_s", least: 0.01, most: 0.03, decimals: 3 },
];

/// The scenario, whose figure eight is flown in these periods \[s\], calm and in its wind.
const SCENARIO: &str = "figure8-morph";
const PERIODS_S: [f64; 6] = [8.0, 6.0, 5.0, 4.5, 4.25, 4.0];

/// What to try.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Candidates, the shipped set included.
    pub candidates: u64,
    /// Of what is drawn for the candidates.
    pub seed: u64,
    /// Random flights by which is chosen.
    pub seeds: Vec<u64>,
    /// Random flights by which the Pareto front is judged.
    pub judged: Vec<u64>,
}

/// One set of numbers and how it flew.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Values of `morphquad run --set`; none for the shipped set.
    pub flags: Vec<String>,
    /// RMS error of each figure eight \[m\], calm and in wind by period.
    pub rms_m: Vec<f64>,
    /// Geometric mean of these over those of the shipped set.
    pub closeness: f64,
    /// Random flights of the seeds that it was chosen by.
    pub random: Robustness,
    /// Random flights of the others; none outside the front.
    pub judged: Option<Robustness>,
}

/// How a set of numbers flew a range of random flights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Robustness {
    /// Vehicles lost.
    pub lost: usize,
    /// Largest error that 90 % of the flights stay within \[m\].
    pub within_m: f64,
}

impl Candidate {
    /// The other one is as good in everything, and better in something.
    fn is_beaten_by(&self, other: &Self) -> bool {
        let of = |one: &Self| [one.closeness, one.random.within_m, one.random.lost as f64];
        let (own, others) = (of(self), of(other));
        let pairs = || own.iter().zip(&others);
        pairs().all(|(own, other)| other <= own) && pairs().any(|(own, other)| other < own)
    }
}

/// All candidates of a plan, the shipped set first.
#[derive(Debug, Clone)]
pub struct Study {
    /// What was asked for.
    pub plan: Plan,
    /// In the order in which they were drawn.
    pub candidates: Vec<Candidate>,
}

impl Study {
    /// No other candidate beats this one in everything.
    #[must_use]
    pub fn is_on_front(&self, one: &Candidate) -> bool {
        !self.candidates.iter().any(|other| one.is_beaten_by(other))
    }

    /// The Pareto front, the closest first.
    #[must_use]
    pub fn front(&self) -> Vec<&Candidate> {
        let on_front = |one: &&Candidate| self.is_on_front(one);
        let mut front: Vec<&Candidate> = self.candidates.iter().filter(on_front).collect();
        front.sort_by(|a, b| a.closeness.total_cmp(&b.closeness));
        front
    }
}

/// Values of `--set` of the candidate that is drawn in this place; the shipped set in the first.
fn draw(seed: u64, place: u64) -> Vec<String> {
    if place == 0 {
        return Vec::new();
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(place);
    let draw = |Knob { key, least, most, decimals }: Knob| {
        let share: f64 = random.random_range(0.0..=1.0);
        let value = if most >= 10.0 * least {
            least * libm::pow(most / least, share)
        } else {
            least + share * (most - least)
        };
        format!("{key}={value:.decimals$}")
    };
    KNOBS.map(draw).into()
}

/// Tries the plan on all cores; `progress` is called for each candidate.
///
/// # Errors
/// A set that the scenario refuses, or a flight that hangs.
pub fn run(plan: &Plan, progress: Progress<'_>) -> Result<Study, RandomError> {
    let mut study = Study { plan: plan.clone(), candidates: Vec::new() };
    for place in 0..plan.candidates {
        let flags = draw(plan.seed, place);
        let rms_m = closeness(&flags)?;
        let shipped = study.candidates.first().map_or(&rms_m, |shipped| &shipped.rms_m);
        let logarithms = rms_m.iter().zip(shipped).map(|(own, shipped)| libm::log(own / shipped));
        let closeness = libm::exp(logarithms.sum::<f64>() / rms_m.len() as f64);
        let random = robustness(&flags, &plan.seeds)?;
        study.candidates.push(Candidate { flags, rms_m, closeness, random, judged: None });
        progress();
    }
    let on_front: Vec<bool> = study.candidates.iter().map(|one| study.is_on_front(one)).collect();
    for (candidate, _) in
        study.candidates.iter_mut().zip(on_front).filter(|(_, on_front)| *on_front)
    {
        candidate.judged = Some(robustness(&candidate.flags, &plan.judged)?);
    }
    Ok(study)
}

fn overrides(flags: &[String]) -> Result<Vec<Override>, RandomError> {
    Ok(flags.iter().map(|flag| Override::set(flag)).collect::<Result<_, _>>()?)
}

/// RMS error of each figure eight \[m\].
fn closeness(flags: &[String]) -> Result<Vec<f64>, RandomError> {
    let calm = ["disturbance_injector.script=[]".to_owned()];
    let courses: Vec<Vec<String>> = [&calm[..], &[]]
        .into_iter()
        .flat_map(|weather| {
            PERIODS_S.map(|period_s| {
                let period = [format!("pilot.period_s={period_s:?}")];
                [flags, &period, weather].concat()
            })
        })
        .collect();
    fan_out(&courses, &|| (), |course| {
        let scenario = Scenario::load(SCENARIO, &overrides(course)?)?;
        let mut metrics = fly_alone(&scenario, StateSource::Estimator, Metrics::of(&scenario))?;
        metrics.finish();
        Ok(metrics.tracking().rms_m)
    })
}

fn robustness(flags: &[String], seeds: &[u64]) -> Result<Robustness, RandomError> {
    let overrides = overrides(flags)?;
    let plan = random::Plan { seeds: seeds.to_vec(), overrides, flags: String::new() };
    let study = random::fly(&plan, &|| ())?;
    Ok(Robustness { lost: study.lost(), within_m: study.quantile_m(0.9) })
}
