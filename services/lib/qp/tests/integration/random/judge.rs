//! What an answer must satisfy, measured without the crate's own residuals.

use nalgebra::DVector;
use qp::{QpOutcome, QpSolver, QpStatus};

use super::kinds::{Case, Truth};

/// Relative residual that is allowed.
const RESIDUAL: f64 = 1e-9;

/// Why the solver's answer is wrong, if it is.
pub(crate) fn fault(case: &Case, solver: &dyn QpSolver, outcome: QpOutcome) -> Option<String> {
    let (x, multipliers) = (solver.solution(), solver.multipliers());
    if !x.iter().chain(multipliers).all(|value| value.is_finite()) {
        return Some("a number that is not finite".to_owned());
    }
    let expected = match case.truth {
        Truth::Infeasible => QpStatus::Infeasible,
        Truth::Solution(..) | Truth::Feasible => QpStatus::Solved,
    };
    if outcome.status != expected {
        let effort = outcome.iterations;
        return Some(format!("{:?} after {effort} changes, not {expected:?}", outcome.status));
    }
    if expected == QpStatus::Infeasible {
        return None;
    }
    let (residual, which) = residual(case, x, multipliers);
    if residual > RESIDUAL {
        return Some(format!("{which} {residual:.1e}"));
    }
    if let Truth::Solution(known, room) = &case.truth {
        let away = energy(case, &(x - known)) / size(case, known);
        if away > *room {
            return Some(format!("{away:.1e} from the solution"));
        }
    }
    None
}

/// The length that the cost gives to a step.
pub(crate) fn energy(case: &Case, step: &DVector<f64>) -> f64 {
    step.dot(&(&case.problem.hessian * step)).max(0.0).sqrt()
}

/// The lengths that rounding is relative to: of the solution, and of the way to it.
pub(crate) fn size(case: &Case, known: &DVector<f64>) -> f64 {
    let d = case.problem.hessian.diagonal().map(|h| 1.0 / h.sqrt());
    energy(case, known) + case.problem.f.component_mul(&d).norm() + f64::MIN_POSITIVE
}

/// The worst of the optimality conditions, each relative to the terms it is the sum of, in units
/// in which the Hessian has ones on its diagonal.
fn residual(case: &Case, x: &DVector<f64>, multipliers: &DVector<f64>) -> (f64, &'static str) {
    let problem = &case.problem;
    let d = problem.hessian.diagonal().map(|h| 1.0 / h.sqrt());
    let (mut gradient, mut terms) = (0.0_f64, f64::MIN_POSITIVE);
    let (mut length, mut way) = (f64::MIN_POSITIVE, f64::MIN_POSITIVE);
    for j in 0..problem.n() {
        let (mut sum, mut most) = (problem.f[j], problem.f[j].abs());
        let curved = problem.hessian.column(j).component_mul(x);
        let pull = problem.rows.column(j).component_mul(multipliers);
        for term in curved.iter().chain(&pull) {
            sum += term;
            most += term.abs();
        }
        gradient = gradient.max(d[j] * sum.abs());
        terms = terms.max(d[j] * most);
        length = length.max(x[j].abs() / d[j]);
        way = way.max(d[j] * problem.f[j].abs());
    }
    let mut worst = (gradient / terms, "stationarity");
    for i in 0..problem.m() {
        let row = problem.rows.row(i);
        let reach: f64 = row.iter().zip(&d).map(|(a, d)| (a * d).abs()).sum();
        let given = case.compliance[i] * multipliers[i];
        let value: f64 = row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>() - given;
        // Relative to bound and terms of the row itself; where both vanish, to rounding.
        let sizes: f64 = row.iter().zip(x).map(|(a, x)| (a * x).abs()).sum();
        let rounding = reach * (1e-6 * length + 1e-13 * way);
        let unit = |bound: f64| bound.abs() + sizes + given.abs() + rounding;
        for (bound, miss) in [
            (problem.lower[i], problem.lower[i] - value),
            (problem.upper[i], value - problem.upper[i]),
        ] {
            if bound.is_finite() && miss / unit(bound) > worst.0 {
                worst = (miss / unit(bound), "bound missed by");
            }
        }
        let held = if multipliers[i] > 0.0 { problem.upper[i] } else { problem.lower[i] };
        // How far a row lies off its bound shows beside the whole answer.
        let room = unit(held) + reach * length;
        let slack = if held.is_finite() { (held - value).abs() / room } else { f64::INFINITY };
        let idle = (multipliers[i].abs() * reach / terms).min(slack);
        if idle > worst.0 {
            worst = (idle, "complementarity");
        }
    }
    worst
}
