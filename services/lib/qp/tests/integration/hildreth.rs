//! The paper's method: right when it may go on, far outside its bounds when cut off at 38 sweeps.

use crate::support::{Problem, feasible, generator, mpc};
use qp::{Hildreth, HildrethSettings, QpError, QpSolver, QpStatus};
use rand::RngExt;

fn swept(problem: &Problem, settings: HildrethSettings) -> Result<(Hildreth, QpStatus), QpError> {
    let mut solver = Hildreth::new(problem.n(), problem.m(), settings)?;
    solver.set_matrices(&problem.hessian, &problem.rows)?;
    let status = solver.solve(&problem.f, &problem.lower, &problem.upper).status;
    Ok((solver, status))
}

#[test]
fn converged_sweeps_agree_with_the_active_set() {
    let mut random = generator(41);
    let settings = HildrethSettings { max_sweeps: 20_000, ..HildrethSettings::converged() };
    let mut compared = 0;
    for round in 0..150 {
        let n = random.random_range(2..10);
        let problem = feasible(&mut random, n, n, 1e1);
        let (sweeping, status) = swept(&problem, settings).unwrap();
        if status != QpStatus::Solved {
            continue;
        }
        compared += 1;
        let mut exact = problem.active_set().unwrap();
        exact.solve(&problem.f, &problem.lower, &problem.upper);
        let error = (sweeping.solution() - exact.solution()).amax();
        assert!(error < 1e-7, "round {round}: {error:e}");
    }
    assert!(compared > 120, "only {compared} of 150 converged");
}

#[test]
fn the_textbook_sweep_count_can_leave_the_bounds_and_reports_it() {
    let mut random = generator(42);
    let (mut worst, mut unsolved) = (0.0_f64, 0);
    for _ in 0..100 {
        let problem = mpc(&mut random, 3, 3.0);
        let (solver, status) = swept(&problem, HildrethSettings::textbook()).unwrap();
        let values = &problem.rows * solver.solution();
        let outside = (&values - &problem.upper).max().max((&problem.lower - &values).max());
        if status != QpStatus::Solved {
            unsolved += 1;
            worst = worst.max(outside);
        }
        assert!(status != QpStatus::Solved || outside < 1e-7, "an unsafe point called solved");
        let mut exact = problem.active_set().unwrap();
        assert_eq!(
            exact.solve(&problem.f, &problem.lower, &problem.upper).status,
            QpStatus::Solved
        );
    }
    // The increments are bounded by one: the cut-off point misses by a large part of that.
    assert!(worst > 0.3 && unsolved > 10, "worst {worst}, unsolved {unsolved}");
}

#[test]
fn unconstrained_problems_need_one_sweep() {
    let mut problem = feasible(&mut generator(43), 7, 9, 1e3);
    problem.lower.fill(f64::NEG_INFINITY);
    problem.upper.fill(f64::INFINITY);
    let mut solver = Hildreth::new(7, 9, HildrethSettings::textbook()).unwrap();
    solver.set_matrices(&problem.hessian, &problem.rows).unwrap();
    let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
    assert_eq!((outcome.status, outcome.iterations, outcome.active), (QpStatus::Solved, 1, 0));
    let exact = problem.hessian.clone().lu().solve(&-&problem.f).unwrap();
    assert!((solver.solution() - exact).amax() < 1e-11);
}
