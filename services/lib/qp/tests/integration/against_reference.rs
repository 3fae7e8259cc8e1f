//! The active-set solver against an interior-point solver and against the optimality conditions.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use crate::support::{Problem, feasible, generator, mpc, sample};
use nalgebra::DVector;
use qp::{QpSolver, QpStatus};
use rand::RngExt;

/// Residual that every solved problem must reach.
const RESIDUAL: f64 = 1e-9;
/// Relative agreement of the cost; the interior-point solver stops at a gap of about 1e-11, on
/// ill-conditioned problems somewhat above.
const COST: f64 = 1e-7;

/// Solves and demands optimality and the cost of the reference; returns the residual.
fn verify(problem: &Problem, label: &str) -> f64 {
    let mut solver = problem.active_set().expect("the problem was built solvable");
    let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
    assert_eq!(outcome.status, QpStatus::Solved, "{label}: {outcome:?}");
    let residual = problem.residual(&solver);
    assert!(residual < RESIDUAL, "{label}: residual {residual:e}");
    let reference = problem.reference().expect("the problem was built feasible");
    let (ours, theirs) = (problem.cost(solver.solution()), problem.cost(&reference));
    let scale = 1e-3 + ours.abs() + solver.solution().dot(&problem.f).abs();
    assert!((ours - theirs).abs() < COST * scale, "{label}: cost {ours} against {theirs}");
    residual
}

#[test]
fn random_feasible_problems_are_solved_to_optimality() {
    let mut random = generator(1);
    for round in 0..250 {
        let n = random.random_range(1..25);
        let m = random.random_range(0..60);
        verify(&feasible(&mut random, n, m, 1e3), &format!("round {round}, n {n}, m {m}"));
    }
}

#[test]
fn duplicate_and_tied_rows_do_no_harm() {
    let mut random = generator(2);
    for round in 0..150 {
        let (n, m) = (random.random_range(2..15), random.random_range(2..30));
        let base = feasible(&mut random, n, m, 1e2);
        verify(&base.with_duplicates(&mut random, m), &format!("round {round}, n {n}, m {m}"));
    }
}

#[test]
fn more_rows_than_variables_may_meet_in_the_solution() {
    let mut random = generator(3);
    for round in 0..100 {
        let n = random.random_range(2..12);
        let mut problem = feasible(&mut random, n, 5 * n, 1e2);
        // Every upper bound passes through one point, towards which the cost pulls.
        let vertex = crate::support::vector(&mut random, n);
        problem.upper = &problem.rows * &vertex;
        problem.lower.fill(f64::NEG_INFINITY);
        let weights = DVector::from_fn(5 * n, |_, _| sample(&mut random).max(0.0));
        problem.f = -(&problem.hessian * &vertex) - problem.rows.tr_mul(&weights);
        let mut solver = problem.active_set().unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!(outcome.status, QpStatus::Solved, "round {round}");
        let error = (solver.solution() - &vertex).amax();
        assert!(error < 1e-9, "round {round}: {error:e} from the vertex");
    }
}

#[test]
fn mpc_shaped_problems_with_exact_ties_are_solved() {
    let mut random = generator(4);
    for round in 0..150 {
        let moves = random.random_range(2..12);
        let ratio = f64::from(random.random_range(1..4_u8));
        verify(&mpc(&mut random, moves, ratio), &format!("round {round}, {moves} moves"));
    }
}

#[test]
fn condition_numbers_up_to_1e8_keep_the_residual() {
    let mut random = generator(5);
    for round in 0..100 {
        let (n, m) = (random.random_range(3..20), random.random_range(2..40));
        let problem = feasible(&mut random, n, m, 1e8);
        let mut solver = problem.active_set().unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!(outcome.status, QpStatus::Solved, "round {round}: {outcome:?}");
        let residual = problem.residual(&solver);
        assert!(residual < RESIDUAL, "round {round}: {residual:e}");
    }
}

#[test]
fn units_of_variables_and_rows_do_not_change_the_answer() {
    let mut random = generator(6);
    for round in 0..100 {
        let (n, m) = (random.random_range(2..12), random.random_range(2..24));
        let problem = feasible(&mut random, n, m, 1e2);
        let mut scale =
            |size: usize| DVector::from_fn(size, |_, _| 1e6_f64.powf(sample(&mut random)));
        let (columns, rows) = (scale(n), scale(m));
        let rescaled = problem.rescaled(&columns, &rows);
        let (mut plain, mut other) =
            (problem.active_set().unwrap(), rescaled.active_set().unwrap());
        plain.solve(&problem.f, &problem.lower, &problem.upper);
        let outcome = other.solve(&rescaled.f, &rescaled.lower, &rescaled.upper);
        assert_eq!(outcome.status, QpStatus::Solved, "round {round}");
        assert!(rescaled.residual(&other) < RESIDUAL, "round {round}");
        let back = other.solution().component_div(&columns);
        let error = (back - plain.solution()).amax();
        assert!(error < 1e-8, "round {round}: {error:e}");
    }
}

#[test]
fn nearly_parallel_rows_are_survived_at_every_angle() {
    let mut random = generator(7);
    for exponent in 3..17 {
        for round in 0..20 {
            let (n, m) = (random.random_range(2..10), random.random_range(2..12));
            let base = feasible(&mut random, n, m, 1e2);
            let mut problem = base.with_duplicates(&mut random, m);
            for entry in &mut problem.rows.rows_mut(m, m) {
                *entry += 10.0_f64.powi(-exponent) * sample(&mut random) * entry.abs();
            }
            let mut solver = problem.active_set().unwrap();
            let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
            let label = format!("angle 1e-{exponent}, round {round}: {outcome:?}");
            // Tilted equalities may contradict each other: any verdict but a false one.
            if outcome.status == QpStatus::Solved {
                assert!(problem.residual(&solver) < RESIDUAL, "{label}");
            } else {
                assert!((0..m).any(|i| problem.lower[i] >= problem.upper[i]), "{label}");
            }
            assert!(solver.solution().iter().all(|x| x.is_finite()), "{label}");
        }
    }
}

#[test]
fn a_large_problem_is_solved() {
    let mut random = generator(8);
    let residual = verify(&feasible(&mut random, 150, 600, 1e4), "n 150, m 600");
    assert!(residual < 1e-11, "{residual:e}");
}

#[test]
fn contradictions_are_always_detected() {
    let mut random = generator(9);
    for round in 0..300 {
        let (n, m) = (random.random_range(1..15), random.random_range(1..30));
        let cond = 10.0_f64.powi(round % 9);
        let mut problem = feasible(&mut random, n, m, cond);
        // A combination of rows with non-negative weights is asked to exceed what the rows allow.
        for i in 0..m {
            problem.upper[i] = problem.upper[i].min(problem.lower[i].max(-2.0) + 4.0);
        }
        let weights = DVector::from_fn(m, |_, _| random.random_range(0.0..1.0_f64));
        let most = weights.dot(&problem.upper);
        let row = weights.transpose() * &problem.rows;
        let excess = 10.0_f64.powf(-4.0 * random.random_range(0.0..1.0));
        problem.rows = problem.rows.clone().insert_row(m, 0.0);
        problem.rows.set_row(m, &row);
        problem.lower = problem.lower.clone().insert_row(m, most + excess);
        problem.upper = problem.upper.clone().insert_row(m, f64::INFINITY);
        let mut solver = problem.active_set().unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!(outcome.status, QpStatus::Infeasible, "round {round}, n {n}, m {m}");
        assert!(solver.solution().iter().all(|x| x.is_finite()));
        if round % 10 == 0 {
            assert!(problem.reference().is_none(), "round {round}: the reference disagrees");
        }
    }
}

#[test]
fn verdicts_on_integer_rows_agree_with_the_reference() {
    let mut random = generator(10);
    let mut infeasible = 0;
    for round in 0..300 {
        let (n, m) = (random.random_range(1..8), random.random_range(1..16));
        let mut problem = feasible(&mut random, n, m, 1e2);
        // Small integers give many dependent rows, touching bounds and ties.
        problem.rows =
            nalgebra::DMatrix::from_fn(m, n, |_, _| f64::from(random.random_range(-1..2_i8)));
        for i in 0..m {
            problem.lower[i] = f64::from(random.random_range(-3..2_i8));
            problem.upper[i] = problem.lower[i] + f64::from(random.random_range(0..4_u8));
        }
        let mut solver = problem.active_set().unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        let expected = match problem.reference() {
            Some(_) => QpStatus::Solved,
            None => QpStatus::Infeasible,
        };
        assert_eq!(outcome.status, expected, "round {round}, n {n}, m {m}");
        infeasible += u32::from(expected == QpStatus::Infeasible);
        if outcome.status == QpStatus::Solved {
            assert!(problem.residual(&solver) < RESIDUAL, "round {round}");
        }
    }
    assert!((50..250).contains(&infeasible), "{infeasible} of 300 infeasible");
}
