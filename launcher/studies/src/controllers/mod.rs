//! The controllers of both slots side by side: every attitude law under every position law.
//!
//! [`Plan`] names what is flown, [`fly`] flies it on all cores in this process and gives a [`Study`] of
//! one [`Row`] per pair. Open `flown.rs` for what is measured in a flight, `report.rs` for table and
//! files.

mod flown;
pub mod report;
#[cfg(test)]
mod tests;

use core::time::Duration;
use document::ScenarioError;
use flown::{Flown, fly_one};
use scenario::services::names_for;
use scenario::{Override, Scenario};
use shared_types::Role;
use simulate::fan_out::{Progress, fan_out};
use simulate::in_process::InProcessError;
use thiserror::Error;

/// A force that no tilt within its bound holds against, and when \[N\], \[s\].
const PUSH_N: f64 = 0.6;
const PUSH_S: [f64; 2] = [2.0, 3.0];
/// When the shipped disturbance comes here, so that the step before it is over \[s\].
const PULSE_AT_S: f64 = 2.5;

/// What to fly: every pair of controllers.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Seeds of the figure eight, from 1.
    pub seeds: u64,
    /// Sizes of the rig's vehicle \[°\].
    pub sizes_deg: Vec<f64>,
    /// Logical time of a figure eight \[s\].
    pub figure_s: f64,
}

impl Plan {
    /// The whole figure eight ten times, steps and pulses at the three sizes of Table I.
    #[must_use]
    pub fn full() -> Self {
        Self { seeds: 10, sizes_deg: vec![45.0, 94.5, 160.0], figure_s: 20.0 }
    }

    /// Once, and at the ends.
    #[must_use]
    pub fn quick() -> Self {
        Self { seeds: 1, sizes_deg: vec![45.0, 160.0], figure_s: 10.0 }
    }

    /// Flights that this takes.
    #[must_use]
    pub fn flights(&self) -> usize {
        self.cases().len()
    }

    fn cases(&self) -> Vec<Case> {
        let mut cases = Vec::new();
        for pair in pairs() {
            let of = |kind| Case { pair, kind };
            cases.extend((1..=self.seeds).map(|seed| of(Kind::Figure { seed })));
            cases.push(of(Kind::Push));
            // On the rig there is no position loop.
            if Some(pair.position) == names_for(Role::Position).next() {
                for &size_deg in &self.sizes_deg {
                    cases.push(of(Kind::Step { size_deg }));
                    cases.push(of(Kind::Pulse { size_deg }));
                }
            }
        }
        cases
    }
}

/// The services that fill the slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ControllerPair {
    /// Service of the attitude slot.
    pub attitude: &'static str,
    /// Service of the position slot.
    pub position: &'static str,
}

/// Every attitude controller under every position controller.
fn pairs() -> Vec<ControllerPair> {
    let under = |position| {
        names_for(Role::Attitude).map(move |attitude| ControllerPair { attitude, position })
    };
    names_for(Role::Position).flat_map(under).collect()
}

/// What a flight is about.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// `figure8-morph`: tracking, violations, clipping, time of a step.
    Figure { seed: u64 },
    /// `hover`, pushed harder than the tilt bound can hold: saturation and recovery.
    Push,
    /// `attitude-step`.
    Step { size_deg: f64 },
    /// `disturbance`, with its pulse after the step is over.
    Pulse { size_deg: f64 },
}

/// One flight.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Case {
    pair: ControllerPair,
    kind: Kind,
}

/// One pair in numbers; the worst over seeds and sizes unless a field states otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The controllers that flew.
    pub pair: ControllerPair,
    /// Root mean square of the position error over all figure eights \[m\].
    pub rms_m: f64,
    /// Largest position error in them \[m\].
    pub max_m: f64,
    /// Largest distance in the push \[m\].
    pub push_m: f64,
    /// From the end of the push until the vehicle stays within 0.1 m \[s\]; none if it never does.
    pub push_recovery_s: Option<f64>,
    /// Settling of roll or pitch, and of yaw, after a step of 0.2 rad \[s\]; none if one never does.
    pub settling_s: [Option<f64>; 2],
    /// Largest angle in that step \[rad\].
    pub peak_rad: f64,
    /// Largest deviation after the pulse \[rad\].
    pub pulse_rad: f64,
    /// From the pulse until the vehicle stays within 0.02 rad \[s\]; none if it never does.
    pub pulse_recovery_s: Option<f64>,
    /// Commands outside their bounds, over all flights.
    pub violations: u64,
    /// Share of ticks of the figure eights with clipped rotors.
    pub clipped_share: f64,
    /// Flights that ended lost.
    pub lost: u64,
    /// Median time of a step of the attitude and the position loop \[ns\], on this machine, now.
    pub step_ns: [u64; 2],
}

/// All pairs, position law by position law.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// What was flown.
    pub plan: Plan,
    /// What came of it.
    pub rows: Vec<Row>,
}

/// Why a study cannot be flown.
#[derive(Debug, Error)]
pub enum ControllersError {
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
pub fn fly(plan: &Plan, progress: Progress<'_>) -> Result<Study, ControllersError> {
    let cases = plan.cases();
    let flown = fan_out(&cases, progress, |case| fly_one(&scenario(plan, case)?, case))?;
    let flown: Vec<(Case, Flown)> = cases.into_iter().zip(flown).collect();
    let rows = pairs().into_iter().map(|pair| row(pair, &flown)).collect();
    Ok(Study { plan: plan.clone(), rows })
}

/// Sums the flights of a pair up; those on the rig are of the attitude law alone.
fn row(pair: ControllerPair, flown: &[(Case, Flown)]) -> Row {
    let own = || flown.iter().filter(|(case, _)| case.pair == pair);
    let rig = || flown.iter().filter(|(case, _)| case.pair.attitude == pair.attitude);
    let figures = || own().filter(|(case, _)| matches!(case.kind, Kind::Figure { .. }));
    let steps = || rig().filter(|(case, _)| matches!(case.kind, Kind::Step { .. }));
    let pulses = || rig().filter(|(case, _)| matches!(case.kind, Kind::Pulse { .. }));
    let push = || own().filter(|(case, _)| case.kind == Kind::Push);
    let count = figures().count().max(1) as f64;
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let slowest = |values: &mut dyn Iterator<Item = Option<f64>>| {
        let values: Option<Vec<f64>> = values.collect();
        values.map(|values| values.into_iter().fold(0.0, f64::max))
    };
    let squares: f64 = figures().map(|(_, f)| f.rms_m * f.rms_m).sum();
    let all = own().chain(rig().filter(|(case, _)| {
        case.pair != pair && matches!(case.kind, Kind::Step { .. } | Kind::Pulse { .. })
    }));
    let (violations, lost) = all.fold((0, 0), |(violations, lost), (_, f)| {
        (violations + f.violations, lost + u64::from(f.lost))
    });
    let median = |slot: usize| {
        let mut medians: Vec<u64> = figures().map(|(_, f)| f.step_ns[slot]).collect();
        medians.sort_unstable();
        medians.get(medians.len() / 2).copied().unwrap_or(0)
    };
    Row {
        pair,
        rms_m: (squares / count).sqrt(),
        max_m: most(&mut figures().map(|(_, f)| f.max_m)),
        push_m: most(&mut push().map(|(_, f)| f.max_m)),
        push_recovery_s: slowest(&mut push().map(|(_, f)| f.recovery_s)),
        settling_s: [0, 1].map(|part| slowest(&mut steps().map(|(_, f)| f.settling_s[part]))),
        peak_rad: most(&mut steps().map(|(_, f)| f.peak_rad)),
        pulse_rad: most(&mut pulses().map(|(_, f)| f.deviation_rad)),
        pulse_recovery_s: slowest(&mut pulses().map(|(_, f)| f.recovery_s)),
        violations,
        clipped_share: figures().map(|(_, f)| f.clipped_share).sum::<f64>() / count,
        lost,
        step_ns: [median(0), median(1)],
    }
}

/// The shipped scenario with the edits that make it this flight.
fn scenario(plan: &Plan, case: &Case) -> Result<Scenario, ScenarioError> {
    let ControllerPair { attitude, position } = case.pair;
    let mut overrides = vec![
        Override::controller(&format!("attitude={attitude}"))?,
        Override::controller(&format!("position={position}"))?,
    ];
    let size = |size_deg: f64| Override::set(&format!("start.morph_angle_deg={size_deg:?}"));
    let name = match case.kind {
        Kind::Figure { seed } => {
            overrides.push(Override::seed(seed));
            overrides.push(Override::duration(Duration::from_secs_f64(plan.figure_s)));
            "figure8-morph"
        }
        Kind::Push => {
            let [from_s, to_s] = PUSH_S;
            let script = format!(
                "disturbance_injector.script=[{{kind=\"pulse\",at_s={from_s:?},duration_s={:?},\
                 load={{force_w_n=[{PUSH_N:?},0.0,0.0]}}}}]",
                to_s - from_s
            );
            overrides.push(Override::set(&script)?);
            overrides.push(Override::duration(Duration::from_secs(10)));
            "hover"
        }
        Kind::Step { size_deg } => {
            overrides.push(size(size_deg)?);
            overrides.push(Override::duration(Duration::from_secs(3)));
            "attitude-step"
        }
        Kind::Pulse { size_deg } => {
            overrides.push(size(size_deg)?);
            overrides.push(Override::set(&format!(
                "disturbance_injector.script.0.at_s={PULSE_AT_S:?}"
            ))?);
            overrides.push(Override::duration(Duration::from_secs(5)));
            "disturbance"
        }
    };
    Scenario::load(name, &overrides)
}
