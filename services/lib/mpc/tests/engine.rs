//! The engine on a double integrator: optimality, verdicts, scheduling, allocations.
#![allow(clippy::unwrap_used, reason = "a set-up that fails is a failed test")]
#![allow(clippy::float_cmp, reason = "where bits must agree, bits are compared")]

use mpc::{
    Bounds, Horizon, IncrementalMpc, Measured, Model, MpcError, QpStatus, SolverKind, Weights,
    double_integrator,
};
use nalgebra::{DVector, SVector, Vector3};
use qp::{ActiveSet, QpSolver, Settings, kkt_residuals};

const HORIZON: Horizon = Horizon { prediction: 20, control: 3 };

fn at(gain: f64) -> (Model<6, 3, 3>, Weights<3, 3>) {
    let model = double_integrator(&Vector3::repeat(gain), 0.01);
    (model, Weights::on_increments(Vector3::repeat(0.25)))
}

fn engine(horizon: Horizon, solver: SolverKind) -> IncrementalMpc<6, 3, 3> {
    let mut mpc = IncrementalMpc::new(horizon, solver).unwrap();
    assert!(mpc.schedule(1e4, 0.0, at));
    mpc
}

fn resting() -> Measured<6, 3, 3> {
    Measured {
        state_increment: SVector::zeros(),
        output: Vector3::zeros(),
        u_previous: Vector3::zeros(),
    }
}

fn bounds(level: f64, increment: f64) -> Bounds<3> {
    Bounds::symmetric(Vector3::repeat(level), Vector3::repeat(increment))
}

#[test]
fn every_solved_move_satisfies_the_optimality_conditions() {
    for horizon in [HORIZON, Horizon { prediction: 100, control: 50 }] {
        let mut mpc = engine(horizon, SolverKind::ActiveSet);
        let n = 3 * horizon.control;
        let rows = 3 * (2 * horizon.control - 1);
        let mut judge = ActiveSet::new(n, rows, Settings::default()).unwrap();
        for step in 0..12 {
            let target = Vector3::new(0.2, -0.05 * f64::from(step), 1e-3);
            let chosen = mpc.step(&resting(), |_| target, &bounds(0.11, 0.06));
            assert_eq!(chosen.status, QpStatus::Solved);
            assert!(chosen.violation <= 1e-9, "{}", chosen.violation);
            let p = mpc.program();
            judge.set_matrices(p.zeta, p.rows).unwrap();
            assert_eq!(judge.solve(p.eta, p.lower, p.upper).status, QpStatus::Solved);
            let (x, multipliers) = (judge.solution(), judge.multipliers());
            let residuals = kkt_residuals(p.zeta, p.rows, p.eta, p.lower, p.upper, x, multipliers);
            assert!(residuals.worst() < 1e-8, "{residuals:?}");
            let du = x.fixed_rows::<3>(0);
            assert!((du - chosen.du).amax() < 1e-9, "warm and cold start agree");
        }
    }
}

#[test]
fn without_active_bounds_the_move_is_the_least_squares_answer() {
    let mut mpc = engine(HORIZON, SolverKind::ActiveSet);
    let ramp = |ahead: usize| Vector3::repeat(1e-3 * ahead as f64);
    let chosen = mpc.step(&resting(), ramp, &bounds(1e3, 1e3));
    let p = mpc.program();
    let free: DVector<f64> = p.zeta.clone().cholesky().unwrap().solve(&-p.eta);
    assert!((free.fixed_rows::<3>(0) - chosen.du).amax() < 1e-12);
    assert_eq!(chosen.active, 0);
}

#[test]
fn the_papers_solver_agrees_once_it_is_swept_to_the_end() {
    let mut exact = engine(HORIZON, SolverKind::ActiveSet);
    let mut swept = engine(HORIZON, SolverKind::HildrethConverged);
    for step in 0..10 {
        let target = Vector3::new(0.2, 0.01 * f64::from(step), -0.1);
        let [a, b] = [&mut exact, &mut swept]
            .map(|mpc| mpc.step(&resting(), |_| target, &bounds(0.11, 0.06)));
        assert!((a.u - b.u).amax() < 1e-8, "{} {}", a.u, b.u);
    }
}

#[test]
fn an_unfinished_answer_is_clipped_used_and_visible() {
    // 38 sweeps do not suffice for bounds far tighter than the unconstrained answer.
    let mut mpc = engine(HORIZON, SolverKind::Hildreth);
    let tight = bounds(0.02, 0.01);
    let chosen = mpc.step(&resting(), |_| Vector3::repeat(5.0), &tight);
    assert_eq!(chosen.status, QpStatus::IterationLimit);
    assert!(chosen.is_fallback());
    assert!((chosen.u.abs() - tight.du_max).max() <= 0.0, "{}", chosen.u);
    assert!(chosen.u.amax() > 0.0, "it moves");
}

#[test]
fn without_a_model_or_with_nan_the_last_input_is_kept_within_its_bounds() {
    let mut blank = IncrementalMpc::<6, 3, 3>::new(HORIZON, SolverKind::ActiveSet).unwrap();
    let mut fed = engine(HORIZON, SolverKind::ActiveSet);
    let now = Measured { u_previous: Vector3::new(0.05, -0.3, 0.0), ..resting() };
    let moves = [
        blank.step(&now, |_| Vector3::repeat(1.0), &bounds(0.1, 0.1)),
        fed.step(&now, |_| Vector3::repeat(f64::NAN), &bounds(0.1, 0.1)),
    ];
    for chosen in moves {
        assert_eq!(chosen.status, QpStatus::NotFinite);
        assert_eq!(chosen.u, Vector3::new(0.05, -0.1, 0.0));
        assert!((chosen.relaxation - Vector3::new(0.0, 0.1, 0.0)).amax() < 1e-15);
    }
    assert_eq!(fed.step(&now, |_| now.output, &bounds(0.1, 0.1)).status, QpStatus::Solved);
}

#[test]
fn a_model_the_solver_cannot_take_is_a_verdict_and_the_next_one_flies_again() {
    let mut mpc = engine(HORIZON, SolverKind::ActiveSet);
    mpc.schedule(f64::INFINITY, 0.0, at);
    let lost = mpc.step(&resting(), |_| Vector3::repeat(0.2), &bounds(0.1, 0.1));
    assert_eq!((lost.status, lost.u), (QpStatus::NotFinite, Vector3::zeros()));
    mpc.schedule(1e4, 0.0, at);
    let found = mpc.step(&resting(), |_| Vector3::repeat(0.2), &bounds(0.1, 0.1));
    assert_eq!(found.status, QpStatus::Solved);
}

#[test]
fn a_parameter_within_the_tolerance_rebuilds_nothing() {
    let mut mpc = engine(HORIZON, SolverKind::ActiveSet);
    assert!(!mpc.schedule(1e4, 0.0, at), "exactly the same");
    assert!(!mpc.schedule(1.05e4, 1e3, at));
    assert_eq!(mpc.scheduled(), Some(1e4));
    assert!(mpc.schedule(1.05e4, 0.0, at));
    mpc.forget_schedule();
    assert!(mpc.schedule(1.05e4, 0.0, at));
}

#[test]
fn neither_a_step_nor_a_rebuild_allocates() {
    for solver in [SolverKind::ActiveSet, SolverKind::Hildreth] {
        let mut mpc = engine(Horizon { prediction: 60, control: 6 }, solver);
        let counted = allocation_counter::measure(|| {
            for step in 1..20 {
                mpc.schedule(1e4 / f64::from(step), 0.0, at);
                mpc.step(&resting(), |_| Vector3::repeat(0.2), &bounds(0.1, 0.05));
            }
        });
        assert_eq!(counted.count_total, 0, "{solver:?}");
    }
}

#[test]
fn a_horizon_that_makes_no_sense_is_refused_with_its_numbers() {
    let build = |prediction, control| {
        let horizon = Horizon { prediction, control };
        IncrementalMpc::<6, 3, 3>::new(horizon, SolverKind::ActiveSet).unwrap_err()
    };
    assert_eq!(build(3, 4), MpcError::ControlHorizon { control: 4, prediction: 3 });
    assert_eq!(build(20, 0), MpcError::ControlHorizon { control: 0, prediction: 20 });
    assert_eq!(build(101, 3), MpcError::PredictionHorizon { prediction: 101, limit: 100 });
}
