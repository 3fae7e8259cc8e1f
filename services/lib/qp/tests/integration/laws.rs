//! Laws of a convex QP, on arbitrary data.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use crate::support::{feasible, generator};
use nalgebra::DVector;
use proptest::prelude::{ProptestConfig, any, prop_assert, prop_assert_eq, proptest};
use qp::{QpSolver, QpStatus};

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn a_solved_problem_satisfies_the_optimality_conditions(
        seed in any::<u64>(), n in 1_usize..12, m in 0_usize..30, digits in 0_i32..7,
    ) {
        let problem = feasible(&mut generator(seed), n, m, 10.0_f64.powi(digits));
        let mut solver = problem.active_set().unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        prop_assert_eq!(outcome.status, QpStatus::Solved);
        prop_assert!(problem.residual(&solver) < 1e-9);
    }

    #[test]
    fn mirroring_the_problem_mirrors_the_answer_bit_for_bit(
        seed in any::<u64>(), n in 1_usize..8, m in 1_usize..16,
    ) {
        let problem = feasible(&mut generator(seed), n, m, 1e2);
        let mut solver = problem.active_set().unwrap();
        solver.solve(&problem.f, &problem.lower, &problem.upper);
        let mut mirror = problem.active_set().unwrap();
        mirror.solve(&-&problem.f, &-&problem.upper, &-&problem.lower);
        prop_assert_eq!(mirror.solution(), &-solver.solution());
    }

    #[test]
    fn no_cheaper_feasible_point_exists_nearby(
        seed in any::<u64>(), n in 1_usize..8, m in 1_usize..16,
    ) {
        let mut random = generator(seed);
        let problem = feasible(&mut random, n, m, 1e2);
        let mut solver = problem.active_set().unwrap();
        solver.solve(&problem.f, &problem.lower, &problem.upper);
        let best = problem.cost(solver.solution());
        for _ in 0..20 {
            let step: DVector<f64> = crate::support::vector(&mut random, n) * 0.1;
            let other = solver.solution() + step;
            let values = &problem.rows * &other;
            let inside = (0..m).all(|i| problem.lower[i] <= values[i] && values[i] <= problem.upper[i]);
            prop_assert!(!inside || problem.cost(&other) >= best - 1e-9 * (1.0 + best.abs()));
        }
    }
}
