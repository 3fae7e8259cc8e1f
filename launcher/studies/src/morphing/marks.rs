//! What the scheduled law promises in calm air, and whether it holds.

use super::{Conditions, Law, Study, Verdict};
use serde::Serialize;
use simulate::in_process::StateSource;

/// One promise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mark {
    /// The promise as text.
    pub name: &'static str,
    /// The worst over all sweeps.
    pub value: f64,
    /// What it may be at most.
    pub limit: f64,
    /// Sweep at which it is worst \[s\].
    pub sweep_s: f64,
    /// Whether it holds.
    pub holds: bool,
}

/// Root mean square error with perfect state, and with the estimator \[m\].
const RMS_M: [f64; 2] = [0.006, 0.030];
/// Ratio to the flight without morph of each flight with perfect state, and of the mean over the
/// seeds with the estimator.
const RATIO: [f64; 2] = [1.1, 1.2];

/// The marks of a study that flew the scheduled law in calm air.
#[must_use]
pub fn marks(study: &Study) -> Vec<Mark> {
    let [truth, estimator] = [StateSource::Truth, StateSource::Estimator];
    let rms = |cell: &super::Cell| cell.flights.iter().map(|f| f.rms_m).fold(0.0, f64::max);
    [
        (
            "RMS [m], perfect state, any flight",
            truth,
            RMS_M[0],
            &rms as &dyn Fn(&super::Cell) -> f64,
        ),
        ("RMS [m], estimator, any flight", estimator, RMS_M[1], &rms),
        ("sweep / no sweep, perfect state, any flight", truth, RATIO[0], &super::Cell::worst_ratio),
        (
            "sweep / no sweep, estimator, mean of seeds",
            estimator,
            RATIO[1],
            &super::Cell::mean_ratio,
        ),
    ]
    .into_iter()
    .filter_map(|(name, state, limit, value)| {
        let promised = || {
            study.cells.iter().filter(|cell| {
                cell.law == Law::Scheduled && cell.conditions == Conditions::calm(state)
            })
        };
        let worst = promised().max_by(|a, b| value(a).total_cmp(&value(b)))?;
        let value = value(worst);
        // A law that loses the vehicle, or swings, need not have the largest value.
        let flown = promised().all(|cell| cell.verdict() == Verdict::Flown);
        Some(Mark { name, value, limit, sweep_s: worst.sweep_s, holds: flown && value <= limit })
    })
    .collect()
}
