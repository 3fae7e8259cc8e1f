//! The most work that one solve of the attitude law can be, certified and not sampled.
//!
//! One axis at a time, as the solver takes them: their changes add up. The gradient of the program
//! stands for the state: every one counts whose free optimum stays within ten times the bound
//! in each move, and every torque held within its bound. That is more than any flight asks for, so
//! what holds here holds there.

use crate::certificate::{Affine, CertificateError, ParametricQp, ParametricRow, Start};
use attitude_mpc::settings::Settings;
use attitude_mpc::{
    AttitudeLaw, AttitudeLawConfig, ConfigError, Horizon, HorizonChoice, Input, Setpoint,
};
use figures::results::Table;
use nalgebra::{DMatrix, DVector, Vector3};
use vehicle::{MorphAngle, VehicleParameters};

/// Free optima up to this many times the bound.
const REACH: f64 = 10.0;
/// Paths after which an enumeration gives up.
const MAX_PATHS: u64 = 1_000_000;

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
pub enum WorstCaseError {
    /// The law refuses the configuration.
    #[error(transparent)]
    Law(#[from] ConfigError),
    /// The enumeration could not be finished.
    #[error("Nc = {control}: {source}")]
    Certificate {
        /// Nc of the program.
        control: usize,
        /// Why.
        source: CertificateError,
    },
}

/// What holds for every state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WorstCase {
    /// Nc.
    pub control: usize,
    /// Whether a solve begins with any former working set, or with none.
    pub warm: bool,
    /// Most changes of the working set in a solve of one axis.
    pub changes: u32,
    /// Working sets started from.
    pub starts: usize,
    /// Paths enumerated.
    pub paths: u64,
}

/// Certifies the flight law's roll axis at `rate_hz` \[Hz\] and `morph_angle` for the given Nc.
///
/// # Errors
/// A rate that the law refuses, or a program with too many paths.
pub fn certify(
    rate_hz: f64,
    morph_angle: MorphAngle,
    control: usize,
    warm: bool,
) -> Result<WorstCase, WorstCaseError> {
    let program = axis(rate_hz, morph_angle, control)?;
    let start = if warm { Start::Warm } else { Start::Cold };
    let certificate = program
        .certify(start, MAX_PATHS)
        .map_err(|source| WorstCaseError::Certificate { control, source })?;
    let (changes, starts, paths) = (certificate.changes, certificate.starts, certificate.paths);
    Ok(WorstCase { control, warm, changes, starts, paths })
}

/// The roll axis of the law's program, its gradient and the torque held as parameters.
fn axis(
    rate_hz: f64,
    morph_angle: MorphAngle,
    control: usize,
) -> Result<ParametricQp, WorstCaseError> {
    let vehicle = VehicleParameters::default();
    let flight = AttitudeLawConfig::flight(rate_hz);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1..=200")]
    let prediction = (Settings::look_ahead_s(&flight)? * rate_hz).round() as usize;
    let horizon = HorizonChoice::Samples(Horizon { prediction, control });
    let mut law = AttitudeLaw::new(AttitudeLawConfig { horizon, ..flight }, &vehicle)?;
    let output = law.step(&Input {
        gamma_rad: Vector3::zeros(),
        body_rate_rad_s: Vector3::zeros(),
        age_s: 0.0,
        morph_angle,
        setpoint: Setpoint { gamma_rad: Vector3::zeros(), thrust_n: vehicle.weight_n() },
        applied_torque_nm: None,
    });
    let program = law.program();
    let hessian = program.zeta.view((0, 0), (control, control)).into_owned();
    // At rest with no torque held the first row's bound is the torque bound, in the law's units.
    let level = program.upper[0];
    let increment = level * output.increment_bound_nm.x / output.torque_bound_nm.x;
    let gradient = hessian.map(f64::abs) * DVector::repeat(control, REACH * increment);
    let parameters = control + 1;
    let unit = |index: usize, slope: f64| Affine {
        slope: DVector::from_fn(parameters, |i, _| if i == index { slope } else { 0.0 }),
        constant: 0.0,
    };
    let to = DVector::from_fn(parameters, |i, _| gradient.get(i).copied().unwrap_or(level));
    Ok(ParametricQp {
        f: (0..control).map(|j| unit(j, 1.0)).collect(),
        rows: rows(control, increment, level, &unit(control, -1.0)),
        hessian,
        from: -&to,
        to,
    })
}

/// (14): increments, and their running sums between `∓level` and the torque held.
fn rows(control: usize, increment: f64, level: f64, held: &Affine) -> Vec<ParametricRow> {
    let constant = |value: f64| Affine { slope: &held.slope * 0.0, constant: value };
    let room = |value: f64| Affine { slope: held.slope.clone(), constant: value };
    let all = DMatrix::from_fn(control, control, |k, j| f64::from(u8::from(j <= k)));
    let sums = (0..control).map(|k| ParametricRow {
        normal: all.row(k).transpose(),
        lower: vec![room(-level)],
        upper: vec![room(level)],
    });
    let mut rows: Vec<_> = sums.collect();
    // The first sum is the first increment: one row with both bounds.
    rows[0].lower.push(constant(-increment));
    rows[0].upper.push(constant(increment));
    rows.extend((1..control).map(|k| ParametricRow {
        normal: DVector::from_fn(control, |j, _| f64::from(u8::from(j == k))),
        lower: vec![constant(-increment)],
        upper: vec![constant(increment)],
    }));
    rows
}

/// One line per certificate.
#[must_use]
pub fn table(cases: &[WorstCase]) -> Table {
    let mut table = Table::new([
        "Nc",
        "start",
        "most changes: one axis",
        "three axes",
        "sets started from",
        "paths followed",
    ]);
    for case in cases {
        table.push([
            case.control.to_string(),
            (if case.warm { "any former set" } else { "empty set" }).to_owned(),
            case.changes.to_string(),
            (3 * case.changes).to_string(),
            case.starts.to_string(),
            case.paths.to_string(),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use qp::{ActiveSet, QpSolver, QpStatus};
    use rand::{RngExt, SeedableRng};

    /// Most changes of the flown solver at 20,000 sampled parameters, each from the set before.
    fn sampled(program: &ParametricQp, warm: bool) -> u32 {
        let (n, m) = (program.hessian.nrows(), program.rows.len());
        let rows = DMatrix::from_fn(m, n, |i, j| program.rows[i].normal[j]);
        let mut solver = ActiveSet::new(n, m, qp::Settings::default()).unwrap();
        solver.set_matrices(&program.hessian, &rows).unwrap();
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut worst = 0;
        for _ in 0..20_000 {
            let at = program.to.map(|most| most * random.random_range(-1.0..1.0));
            let value = |affine: &Affine| affine.constant + affine.slope.dot(&at);
            let f = DVector::from_fn(n, |j, _| value(&program.f[j]));
            let least = |i: usize| program.rows[i].lower.iter().map(value).fold(-1e9, f64::max);
            let most = |i: usize| program.rows[i].upper.iter().map(value).fold(1e9, f64::min);
            let bounds =
                (DVector::from_fn(m, |i, _| least(i)), DVector::from_fn(m, |i, _| most(i)));
            if !warm {
                solver.clear();
            }
            let outcome = solver.solve(&f, &bounds.0, &bounds.1);
            assert_eq!(outcome.status, QpStatus::Solved);
            worst = worst.max(outcome.iterations);
        }
        worst
    }

    #[test]
    fn no_sampled_solve_of_the_flown_axis_needs_more_changes_than_certified() {
        for (control, warm) in [(1, false), (1, true), (2, false), (2, true)] {
            let case = certify(100.0, MorphAngle::MIN, control, warm).unwrap();
            let program = axis(100.0, MorphAngle::MIN, control).unwrap();
            let seen = sampled(&program, warm);
            assert!(seen >= 1 && seen <= case.changes, "{case:?}: {seen} seen");
        }
    }
}
