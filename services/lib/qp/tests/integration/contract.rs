//! What `QpSolver` promises beyond the answer: no allocation, the same bits, refusals, no NaN.

use crate::support::{self, Problem, feasible, generator, matrix, mpc, vector};
use nalgebra::{DMatrix, DVector};
use qp::{
    ActiveSet, Hildreth, HildrethSettings, QpError, QpSolver, QpStatus, Settings, kkt_residuals,
};
use rand::RngExt;

fn bits(solver: &impl QpSolver) -> Vec<u64> {
    solver.solution().iter().chain(solver.multipliers()).map(|value| value.to_bits()).collect()
}

/// A sequence of gradients as a closed loop would make them: small steps, now and then a jump.
fn gradients(problem: &Problem, seed: u64, ticks: usize) -> Vec<DVector<f64>> {
    let mut random = generator(seed);
    let mut f = problem.f.clone();
    (0..ticks)
        .map(|tick| {
            let size = if tick % 7 == 6 { 3.0 } else { 0.2 };
            f += &problem.hessian * vector(&mut random, problem.n()) * size;
            f.clone()
        })
        .collect()
}

#[test]
fn setting_matrices_and_solving_allocate_nothing() {
    let mut random = generator(21);
    let problem = feasible(&mut random, 12, 40, 1e3);
    let (f, lower, upper) = (&problem.f, &problem.lower, &problem.upper);
    let steps = gradients(&problem, 22, 20);
    let mut exact = problem.active_set().unwrap();
    let settings = HildrethSettings { max_sweeps: 200, tolerance: 1e-13 };
    let mut sweeping = Hildreth::new(12, 40, settings).unwrap();
    let solvers: [&mut dyn QpSolver; 2] = [&mut exact, &mut sweeping];
    let control = allocation_counter::measure(|| drop(core::hint::black_box(vec![0_u8; 64])));
    assert_eq!(control.count_total, 1, "the counter does not count");
    let contradiction = upper.map(|_| f64::INFINITY);
    for solver in solvers {
        let counted = allocation_counter::measure(|| {
            let _ = solver.set_matrices(&problem.hessian, &problem.rows);
            for f in &steps {
                let _ = solver.solve(f, lower, upper);
            }
            let _ = solver.solve(f, &contradiction, upper);
            let set = [1; 40];
            let _ = solver.set_working_set(&set);
            let _ = solver.solve(f, lower, upper);
            solver.clear();
        });
        assert_eq!(counted.count_total, 0, "{solver:?}");
    }
}

#[test]
fn a_fresh_solver_with_the_working_set_continues_bit_for_bit() {
    let mut random = generator(23);
    for round in 0..20 {
        let problem = if round % 2 == 0 {
            feasible(&mut random, 10, 30, 1e3).with_duplicates(&mut random, 10)
        } else {
            mpc(&mut random, 8, 3.0)
        };
        let mut veteran = problem.active_set().unwrap();
        for f in gradients(&problem, round, 40) {
            let mut heir = problem.active_set().unwrap();
            heir.set_working_set(veteran.working_set()).unwrap();
            let theirs = heir.solve(&f, &problem.lower, &problem.upper);
            let ours = veteran.solve(&f, &problem.lower, &problem.upper);
            assert_eq!(ours, theirs, "round {round}");
            assert_eq!(bits(&veteran), bits(&heir), "round {round}");
            assert_eq!(veteran.working_set(), heir.working_set(), "round {round}");
        }
    }
}

#[test]
fn any_warm_start_leads_to_the_same_answer() {
    let mut random = generator(24);
    for round in 0..200 {
        let (n, m) = (random.random_range(2..15), random.random_range(2..40));
        let problem = feasible(&mut random, n, m, 1e2).with_duplicates(&mut random, m / 2);
        let mut solver = problem.active_set().unwrap();
        solver.solve(&problem.f, &problem.lower, &problem.upper);
        let cold = solver.solution().clone();
        let set: Vec<i8> = (0..problem.m()).map(|_| random.random_range(-1..2_i8)).collect();
        solver.set_working_set(&set).unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!(outcome.status, QpStatus::Solved, "round {round}");
        assert!((solver.solution() - &cold).amax() < 1e-9, "round {round}");
    }
}

#[test]
fn a_repeated_solve_changes_no_row() {
    let mut random = generator(25);
    for round in 0..100 {
        let problem = feasible(&mut random, 9, 27, 1e3);
        let mut solver = problem.active_set().unwrap();
        solver.solve(&problem.f, &problem.lower, &problem.upper);
        let again = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!((again.status, again.iterations), (QpStatus::Solved, 0), "round {round}");
    }
}

#[test]
fn inputs_that_are_not_numbers_are_a_verdict_and_leave_the_warm_start() {
    let problem = feasible(&mut generator(26), 6, 12, 1e2);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        let mut solver = problem.active_set().unwrap();
        solver.solve(&problem.f, &problem.lower, &problem.upper);
        let set = solver.working_set().to_vec();
        let mut f = problem.f.clone();
        f[3] = bad;
        let outcome = solver.solve(&f, &problem.lower, &problem.upper);
        assert_eq!(outcome.status, QpStatus::NotFinite, "f with {bad}");
        assert!(solver.solution().iter().all(|x| *x == 0.0));
        assert_eq!(solver.working_set(), set);
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!((outcome.status, outcome.iterations), (QpStatus::Solved, 0));
    }
    let mut solver = problem.active_set().unwrap();
    let holes = problem.lower.map(|_| f64::NAN);
    assert_eq!(solver.solve(&problem.f, &holes, &problem.upper).status, QpStatus::NotFinite);
    let short = DVector::zeros(5);
    assert_eq!(solver.solve(&short, &problem.lower, &problem.upper).status, QpStatus::NotFinite);
    let mut unset = ActiveSet::new(6, 12, Settings::default()).unwrap();
    let outcome = unset.solve(&problem.f, &problem.lower, &problem.upper);
    assert_eq!(outcome.status, QpStatus::NotFinite);
}

#[test]
fn bounds_that_exclude_every_value_are_infeasible() {
    let problem = feasible(&mut generator(27), 4, 6, 1e2);
    let cases =
        [(1.0, 0.5), (f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY)];
    for (lower, upper) in cases {
        let mut other = problem.clone();
        (other.lower[2], other.upper[2]) = (lower, upper);
        let mut solver = other.active_set().unwrap();
        let outcome = solver.solve(&other.f, &other.lower, &other.upper);
        assert_eq!(outcome.status, QpStatus::Infeasible, "{lower} <= row <= {upper}");
    }
    let mut empty_row = problem;
    empty_row.rows.row_mut(2).fill(0.0);
    (empty_row.lower[2], empty_row.upper[2]) = (0.5, 1.0);
    let mut solver = empty_row.active_set().unwrap();
    let outcome = solver.solve(&empty_row.f, &empty_row.lower, &empty_row.upper);
    assert_eq!(outcome.status, QpStatus::Infeasible, "a zero row asked for 0.5");
}

#[test]
fn huge_and_tiny_inputs_never_give_a_number_that_is_none() {
    let mut random = generator(28);
    let extremes = [0.0, 1e-320, 1e-200, 1e-30, 1.0, 1e30, 1e130, 1e200, 1e308, f64::INFINITY];
    for round in 0..3000 {
        let mut problem = feasible(&mut random, 4, 8, 1e2);
        for _ in 0..3 {
            let value = extremes[random.random_range(0..10_usize)];
            let at = random.random_range(0..8_usize);
            match random.random_range(0..4_u8) {
                0 => problem.f[at % 4] = value,
                1 => problem.upper[at] = value,
                2 => problem.lower[at] = -value,
                _ => problem.rows[(at, at % 4)] = value.min(1e308),
            }
        }
        let mut solver = problem.active_set().unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        let numbers = solver.solution().iter().chain(solver.multipliers());
        assert!(numbers.into_iter().all(|x| x.is_finite()), "round {round}: {outcome:?}");
    }
}

#[test]
fn the_iteration_bound_holds_and_is_reported() {
    let problem = feasible(&mut generator(29), 20, 80, 1e3);
    let settings = Settings { max_iterations: Some(3), ..Settings::default() };
    let mut solver = ActiveSet::new(20, 80, settings).unwrap();
    solver.set_matrices(&problem.hessian, &problem.rows).unwrap();
    let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
    assert_eq!(outcome.status, QpStatus::IterationLimit);
    assert!(outcome.iterations <= 3 + 20, "{outcome:?}");
    assert!(solver.solution().iter().all(|x| x.is_finite()));
    // The next solves go on from there, so they arrive.
    let finished = (0..60).any(|_| {
        solver.solve(&problem.f, &problem.lower, &problem.upper).status == QpStatus::Solved
    });
    assert!(finished && problem.residual(&solver) < 1e-9);
}

#[test]
fn the_work_bound_ends_every_solve_with_a_number_and_later_solves_go_on_from_there() {
    for seed in 0..20 {
        let problem = feasible(&mut generator(31 + seed), 40, 160, 1e3);
        let bounded = |most: u64| {
            let settings = Settings { max_work: Some(most), ..Settings::default() };
            let mut solver = ActiveSet::new(40, 160, settings).unwrap();
            solver.set_matrices(&problem.hessian, &problem.rows).unwrap();
            solver
        };
        let solve =
            |solver: &mut ActiveSet| solver.solve(&problem.f, &problem.lower, &problem.upper);
        let mut free = problem.active_set().unwrap();
        let whole = solve(&mut free).iterations;
        let mut ample = bounded(u64::MAX / 2);
        assert_eq!(solve(&mut ample).status, QpStatus::Solved);
        assert_eq!(bits(&ample), bits(&free), "a bound that is not met changes nothing");

        let mut narrow = bounded(400_000);
        let first = solve(&mut narrow);
        assert_eq!(first.status, QpStatus::IterationLimit, "{whole} changes are needed");
        assert!(first.iterations > 0 && first.iterations < whole, "{first:?} of {whole}");
        assert!(narrow.solution().iter().all(|x| x.is_finite()));
        // A successor with its working set goes on to the same bits.
        let mut successor = bounded(400_000);
        successor.set_working_set(narrow.working_set()).unwrap();
        assert_eq!(solve(&mut narrow), solve(&mut successor));
        assert_eq!(bits(&narrow), bits(&successor));

        let mut none = bounded(0);
        assert_eq!(solve(&mut none).status, QpStatus::IterationLimit);
        assert!(none.solution().iter().all(|x| x.is_finite()));
    }
}

#[test]
fn refused_matrices_leave_the_old_ones_in_force() {
    let problem = feasible(&mut generator(30), 5, 8, 1e2);
    let mut solver = problem.active_set().unwrap();
    // Twice: the reference is a warm-started solve, as the one after the refusals will be.
    solver.solve(&problem.f, &problem.lower, &problem.upper);
    solver.solve(&problem.f, &problem.lower, &problem.upper);
    let (answer, rows) = (bits(&solver), &problem.rows);
    let mut indefinite = problem.hessian.clone();
    indefinite[(4, 4)] *= -1.0;
    let singular = DMatrix::from_element(5, 5, 1.0);
    for h in [indefinite, singular] {
        let refusal = solver.set_matrices(&h, rows);
        assert!(matches!(refusal, Err(QpError::NotPositiveDefinite { .. })), "{refusal:?}");
    }
    let mut skew = problem.hessian.clone();
    skew[(1, 3)] += 0.1;
    let refusal = solver.set_matrices(&skew, rows);
    assert!(matches!(refusal, Err(QpError::NotSymmetric { row: 1, column: 3, .. })));
    let mut holed = rows.clone();
    holed[(7, 2)] = f64::NAN;
    let refusal = solver.set_matrices(&problem.hessian, &holed).unwrap_err();
    assert_eq!(refusal.to_string(), "rows[7, 2] = NaN is not a finite number");
    let refusal = solver.set_matrices(&problem.hessian, &rows.transpose()).unwrap_err();
    assert_eq!(refusal.to_string(), "rows is 5 x 8, the solver was made for 8 x 5");
    solver.solve(&problem.f, &problem.lower, &problem.upper);
    assert_eq!(bits(&solver), answer);
}

#[test]
fn wrong_set_ups_are_refused_by_name() {
    let refusal = ActiveSet::new(0, 3, Settings::default()).unwrap_err();
    assert_eq!(refusal, QpError::NoVariables);
    let settings = Settings { tolerance: f64::NAN, ..Settings::default() };
    assert!(ActiveSet::new(2, 3, settings).unwrap_err().to_string().contains("tolerance = NaN"));
    let settings = HildrethSettings { max_sweeps: 0, ..HildrethSettings::textbook() };
    assert!(Hildreth::new(2, 3, settings).unwrap_err().to_string().contains("max_sweeps"));
    let mut solver = ActiveSet::new(2, 3, Settings::default()).unwrap();
    let refusal = solver.set_working_set(&[1, 0]);
    assert_eq!(refusal, Err(QpError::WorkingSetLength { got: 2, expected: 3 }));
    let refusal = solver.set_working_set(&[1, 0, 2]);
    assert_eq!(refusal, Err(QpError::WorkingSetEntry { row: 2, value: 2 }));
    assert_eq!(solver.working_set(), [0, 0, 0]);
}

#[test]
fn residuals_name_the_condition_that_is_broken() {
    // min (x - 2)² / 2 with x <= 1: x = 1, multiplier 1.
    let one = |value: f64| DVector::from_element(1, value);
    let h = DMatrix::identity(1, 1);
    let judge = |x, multiplier| {
        kkt_residuals(
            &h,
            &h,
            &one(-2.0),
            &one(f64::NEG_INFINITY),
            &one(1.0),
            &one(x),
            &one(multiplier),
        )
    };
    assert!(judge(1.0, 1.0).worst() < 1e-15);
    assert!(judge(1.0, 0.9).stationarity > 0.01);
    assert!(judge(2.0, 0.0).primal > 0.1);
    assert!(judge(3.0, -1.0).dual > 0.1);
    assert!(judge(0.5, 1.5).complementarity > 0.1);
    assert!(judge(f64::NAN, 1.0).worst().is_infinite());
}

#[test]
fn a_new_hessian_alone_is_as_good_as_both_matrices() {
    let mut random = generator(32);
    let mut fresh = ActiveSet::new(6, 14, Settings::default()).unwrap();
    let first = feasible(&mut random, 6, 14, 1e2);
    assert_eq!(fresh.set_hessian(&first.hessian), Err(QpError::NoRows));
    let mut solver = first.active_set().unwrap();
    for round in 0..50 {
        let hessian = crate::support::hessian(&mut random, 6, 1e3);
        let next = Problem { hessian, ..first.clone() };
        let mut other = next.active_set().unwrap();
        other.set_working_set(solver.working_set()).unwrap();
        solver.set_hessian(&next.hessian).unwrap();
        let outcome = solver.solve(&next.f, &next.lower, &next.upper);
        assert_eq!(outcome, other.solve(&next.f, &next.lower, &next.upper), "round {round}");
        assert_eq!(bits(&solver), bits(&other), "round {round}");
    }
}

/// Three axes of `moves` increments each that share nothing, one after the other in every step.
fn three_axes(random: &mut rand_chacha::ChaCha8Rng, moves: usize) -> (Problem, [Problem; 3]) {
    let axes = [2.0, 3.0, 2.5].map(|ratio| mpc(random, moves, ratio));
    let (n, m) = (3 * moves, 6 * moves);
    let part = |i: usize, j: usize, pick: fn(&Problem) -> &DMatrix<f64>| {
        if i % 3 == j % 3 { pick(&axes[i % 3])[(i / 3, j / 3)] } else { 0.0 }
    };
    let problem = Problem {
        hessian: DMatrix::from_fn(n, n, |i, j| part(i, j, |axis| &axis.hessian)),
        rows: DMatrix::from_fn(m, n, |i, j| part(i, j, |axis| &axis.rows)),
        f: DVector::from_fn(n, |i, _| axes[i % 3].f[i / 3]),
        lower: DVector::from_fn(m, |i, _| axes[i % 3].lower[i / 3]),
        upper: DVector::from_fn(m, |i, _| axes[i % 3].upper[i / 3]),
    };
    (problem, axes)
}

#[test]
fn axes_that_share_nothing_are_solved_as_if_alone_warm_restored_and_relinearised() {
    let mut random = generator(33);
    for moves in [1, 2, 3, 4, 6, 8, 12] {
        let (problem, axes) = three_axes(&mut random, moves);
        let mut veteran = problem.active_set().unwrap();
        let mut alone = axes.clone().map(|axis| axis.active_set().unwrap());
        for (tick, f) in gradients(&problem, 34, 30).iter().enumerate() {
            // The coupled Hessian of every third tick undoes and redoes the blocks.
            if tick % 3 == 0 {
                let mut coupled = problem.hessian.clone();
                (coupled[(0, 1)], coupled[(1, 0)]) = (1e-9, 1e-9);
                veteran.set_hessian(&coupled).unwrap();
                veteran.solve(f, &problem.lower, &problem.upper);
                veteran.set_hessian(&problem.hessian).unwrap();
            }
            let mut heir = problem.active_set().unwrap();
            heir.set_working_set(veteran.working_set()).unwrap();
            let expected = heir.solve(f, &problem.lower, &problem.upper);
            let outcome = veteran.solve(f, &problem.lower, &problem.upper);
            assert_eq!(outcome, expected, "{moves} moves, tick {tick}");
            assert_eq!(bits(&veteran), bits(&heir), "{moves} moves, tick {tick}");
            assert_eq!(outcome.status, QpStatus::Solved);
            for (axis, solver) in alone.iter_mut().enumerate() {
                let own = DVector::from_fn(moves, |i, _| f[3 * i + axis]);
                solver.solve(&own, &axes[axis].lower, &axes[axis].upper);
                for i in 0..moves {
                    let apart = solver.solution()[i] - veteran.solution()[3 * i + axis];
                    assert!(apart.abs() < 1e-9, "{moves} moves, tick {tick}, axis {axis}");
                }
            }
        }
    }
}

#[test]
fn rows_that_meet_in_one_point_but_for_rounding_are_solved() {
    for seed in 0..200 {
        let mut random = generator(seed);
        // Sums of decaying sequences, as the levels of an input at its bound, beside one of ordinary size.
        let mut levels = matrix(&mut random, 18, 4);
        for m in 1..18 {
            for j in 0..4 {
                let step = levels[(m, j)] * libm::pow(0.6, m as f64);
                levels[(m, j)] = levels[(m - 1, j)] + step;
            }
        }
        let mut rows = DMatrix::zeros(19, 5);
        rows.view_mut((0, 0), (18, 4)).copy_from(&levels);
        rows[(18, 4)] = 1.0;
        let mut hessian = DMatrix::identity(5, 5);
        hessian.view_mut((0, 0), (4, 4)).copy_from(&support::hessian(&mut random, 4, 1e3));
        let outwards = levels.row_sum().transpose();
        let f = DVector::from_fn(5, |j, _| if j < 4 { -0.1 * outwards[j] } else { -0.4 });
        let upper = DVector::from_fn(19, |i, _| if i < 18 { 7.1e-15 } else { 0.2 });
        let lower = upper.map(|_| -1.5);
        let problem = Problem { hessian, rows, f, lower, upper };
        let mut solver = problem.active_set().unwrap();
        let outcome = solver.solve(&problem.f, &problem.lower, &problem.upper);
        assert_eq!(outcome.status, QpStatus::Solved, "seed {seed}");
    }
}
