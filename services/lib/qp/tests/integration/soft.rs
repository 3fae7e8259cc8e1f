//! Rows with a compliance: they give way by the book, and equal explicit slack variables.

use crate::support::{feasible, generator};
use nalgebra::{DMatrix, DVector};
use qp::{
    ActiveSet, Hildreth, HildrethSettings, QpError, QpSolver, QpStatus, Settings,
    soft_kkt_residuals,
};
use rand::RngExt;

#[test]
fn a_soft_row_gives_way_by_its_compliance_times_its_multiplier() {
    // min (x - 2)² / 2 + s² / (2 c), x - s <= 1: x = 1 + c multiplier, multiplier = 2 - x.
    let one = |value: f64| DVector::from_element(1, value);
    let h = DMatrix::identity(1, 1);
    let free = f64::NEG_INFINITY;
    for compliance in [0.0_f64, 0.25, 1.0, 4.0, 1e6] {
        let mut exact = ActiveSet::new(1, 1, Settings::default()).unwrap();
        let mut swept = Hildreth::new(1, 1, HildrethSettings::converged()).unwrap();
        let solvers: [&mut dyn QpSolver; 2] = [&mut exact, &mut swept];
        for solver in solvers {
            solver.set_matrices(&h, &h).unwrap();
            solver.set_compliance(&[compliance]).unwrap();
            let outcome = solver.solve(&one(-2.0), &one(free), &one(1.0));
            assert_eq!((outcome.status, outcome.active), (QpStatus::Solved, 1), "{solver:?}");
            let multiplier = 1.0 / (1.0 + compliance);
            assert!((solver.multipliers()[0] - multiplier).abs() < 1e-14);
            assert!((solver.solution()[0] - (2.0 - multiplier)).abs() < 1e-14);
        }
    }
}

#[test]
fn soft_rows_are_the_limit_of_explicit_slack_variables_and_never_infeasible() {
    let mut random = generator(31);
    for round in 0..200 {
        let (n, m) = (random.random_range(1..9), random.random_range(1..16));
        let mut problem = feasible(&mut random, n, m, 1e2).with_duplicates(&mut random, m / 2);
        let m = problem.m();
        // Two contradictory soft rows on top of feasible ones.
        let soft: Vec<f64> = (0..m)
            .map(|i| if i == 0 || random.random_range(0..3_u8) == 0 { 0.1 + i as f64 } else { 0.0 })
            .collect();
        (problem.lower[0], problem.upper[0]) = (5.0, 6.0);
        let mut solver = problem.active_set().unwrap();
        solver.set_compliance(&soft).unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        let extended = problem.with_slacks(&soft);
        let mut explicit = extended.active_set().unwrap();
        let expected = explicit.solve(&extended.f, &extended.lower, &extended.upper);
        assert_eq!(outcome.status, expected.status, "round {round}");
        if outcome.status == QpStatus::Solved {
            let x = explicit.solution().rows(0, n).into_owned();
            assert!((solver.solution() - x).amax() < 1e-9, "round {round}");
            let residuals = soft_kkt_residuals(
                &problem.hessian,
                &problem.rows,
                &soft,
                &problem.f,
                &problem.lower,
                &problem.upper,
                solver.solution(),
                solver.multipliers(),
            );
            assert!(residuals.worst() < 1e-9, "round {round}: {residuals:?}");
        }
        solver.set_compliance(&vec![1e-3; m]).unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!(outcome.status, QpStatus::Solved, "round {round}, all rows soft");
    }
}

#[test]
fn wrong_compliances_are_refused_by_name() {
    let mut solver = ActiveSet::new(2, 3, Settings::default()).unwrap();
    let refusal = solver.set_compliance(&[1.0]).unwrap_err();
    assert_eq!(refusal, QpError::ComplianceLength { got: 1, expected: 3 });
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        let refusal = solver.set_compliance(&[0.0, bad, 1.0]).unwrap_err();
        assert!(refusal.to_string().contains("compliance of row 1"), "{refusal}");
    }
}
