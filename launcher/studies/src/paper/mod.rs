//! `morphquad paper`: the paper's Tests I to III again, and what becomes of them among rotors.
//!
//! [`rig`] closes the loop, [`measure`] reads numbers from it. `step_rates`, `horizons` and
//! `sizes` are Tests I, II and III: each runs its experiments and makes tables and pictures of
//! them. [`report`] prints and writes. What the paper leaves open (`r_w`, bounds, the unit of the
//! disturbance) is chosen so that its printed numbers come out; every table states what was chosen.

mod horizons;
mod laguerre;
pub mod measure;
mod pictures;
pub mod report;
pub mod rig;
mod sizes;
mod step_rates;
#[cfg(test)]
mod tests;
mod times;

use attitude_mpc::ConfigError;
use figures::figure::Figure;
use figures::results::Table;
use rig::{Experiment, Trajectory};
use serde::Serialize;
use thiserror::Error;
use vehicle::{MorphAngle, ParameterError};

/// A test of the paper's section IV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Test {
    /// I: operation frequencies.
    One,
    /// II: prediction horizons.
    Two,
    /// III: sizes and disturbance.
    Three,
}

impl Test {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::One, Self::Two, Self::Three];

    /// The test with this number.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number).checked_sub(1)?).copied()
    }

    /// 1, 2 or 3.
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::One => 1,
            Self::Two => 2,
            Self::Three => 3,
        }
    }

    /// Runs its experiments.
    ///
    /// # Errors
    /// A law or a vehicle that is impossible.
    pub fn run(self) -> Result<Findings, PaperError> {
        let (mut findings, figures) = match self {
            Self::One => {
                let findings = step_rates::run()?;
                let figures = vec![
                    ("figure-3", pictures::rates(&findings.runs)),
                    ("figure-3-rotors", pictures::rotors(&findings.runs)),
                ];
                (findings, figures)
            }
            Self::Two => {
                let (findings, bars) = horizons::run()?;
                let figures = vec![("figure-4", pictures::horizons(&findings.runs, &bars))];
                (findings, figures)
            }
            Self::Three => {
                let findings = sizes::run()?;
                let figures = vec![
                    ("figure-5", pictures::sizes(&findings.runs)),
                    ("figure-6", pictures::disturbed(&findings.runs)),
                ];
                (findings, figures)
            }
        };
        findings.figures = figures;
        Ok(findings)
    }
}

/// Everything a test found.
#[derive(Debug)]
pub struct Findings {
    /// Which test.
    pub test: Test,
    /// What the test compares, by the paper.
    pub title: &'static str,
    /// Tables, in reading order.
    pub sections: Vec<Section>,
    /// What must hold, and whether it does.
    pub checks: Vec<Check>,
    /// Every closed loop that was run, but for the search of the lag limit.
    pub runs: Vec<Run>,
    /// Pictures by name.
    pub figures: Vec<(&'static str, Figure)>,
}

/// A table with its remarks.
#[derive(Debug)]
pub struct Section {
    /// Name of its files.
    pub name: &'static str,
    /// What it shows.
    pub title: String,
    /// For people.
    pub table: Table,
    /// What was chosen, and what cannot be matched, with the reason.
    pub remarks: Vec<&'static str>,
    /// False if its numbers depend on the machine.
    pub reproducible: bool,
}

impl Section {
    fn new(name: &'static str, title: impl Into<String>, table: Table) -> Self {
        Self { name, title: title.into(), table, remarks: Vec::new(), reproducible: true }
    }

    fn remark(mut self, remark: &'static str) -> Self {
        self.remarks.push(remark);
        self
    }
}

/// A claim of the paper, or of ours.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    pub claim: String,
    /// What was found.
    pub found: String,
    /// Whether it holds.
    pub holds: bool,
}

impl Check {
    fn new(claim: impl Into<String>, found: impl Into<String>, holds: bool) -> Self {
        Self { claim: claim.into(), found: found.into(), holds }
    }

    /// The claim that u and Δu stay within their bounds in all of `runs`.
    fn bounds(runs: &[Run]) -> Self {
        let worst =
            runs.iter().map(|run| measure::excess_nm(&run.trajectory)).fold(f64::MIN, f64::max);
        let rotors = runs.iter().flat_map(|run| &run.trajectory.samples);
        let rotor = rotors.map(|sample| sample.rotor_excess_n).fold(f64::NEG_INFINITY, f64::max);
        let samples: usize = runs.iter().map(|run| run.trajectory.samples.len()).sum();
        let unsolved: usize = runs.iter().map(|run| run.trajectory.unsolved).sum();
        Self::new(
            "u, its increments and, where they are bounded, rotor thrusts within bounds, to 1e-9",
            format!(
                "furthest beyond a bound: {:.1e} in {samples} samples of {} runs, {unsolved} unsolved",
                worst.max(rotor).max(0.0),
                runs.len()
            ),
            worst <= 1e-9 && rotor <= 1e-9 && unsolved == 0,
        )
    }
}

/// An experiment with what became of it.
#[derive(Debug)]
pub struct Run {
    /// Unique within its test.
    pub name: String,
    /// What was run.
    pub experiment: Experiment,
    /// What happened.
    pub trajectory: Trajectory,
}

impl Run {
    fn new(name: impl Into<String>, experiment: &Experiment) -> Result<Self, PaperError> {
        Ok(Self { name: name.into(), experiment: *experiment, trajectory: experiment.run()? })
    }
}

/// A law or a vehicle that the paper's tests cannot be run with.
#[derive(Debug, Error)]
pub enum PaperError {
    /// The law refuses.
    #[error("attitude law: {0}")]
    Law(#[from] ConfigError),
    /// The vehicle refuses.
    #[error(transparent)]
    Vehicle(#[from] ParameterError),
}

/// Set point of every test \[rad\].
const TARGET_RAD: f64 = 0.2;
/// The three sizes of Table I and their names in the paper.
const SIZES: [(&str, MorphAngle); 3] =
    [("min", MorphAngle::MIN), ("med", MorphAngle::MEDIUM), ("max", MorphAngle::MAX)];

/// {Np, Nc} as the paper writes it.
fn label((prediction, control): (usize, usize)) -> String {
    format!("{{{prediction},{control}}}")
}

/// `digits` decimals, or a dash.
fn cell(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

/// A difference with its sign.
fn difference(ours: Option<f64>, paper: f64, digits: usize) -> String {
    ours.map_or_else(|| "-".to_owned(), |ours| format!("{:+.digits$}", ours - paper))
}
