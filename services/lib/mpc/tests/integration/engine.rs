//! The engine: optimality, verdicts, refactoring, memory, allocations.
#![allow(clippy::float_cmp, reason = "where bits must agree, bits are compared")]

use crate::common::{HORIZON, bare, boxes, design, engine, moving, operating, resting, symmetric};
use mpc::{
    Basis, Constraints, Design, Hardness, Horizon, IncrementalMpc, Measured, MpcError, QpStatus,
    SolverKind,
};
use nalgebra::{DVector, Vector3};
use qp::{ActiveSet, QpSolver, Settings, kkt_residuals};

#[test]
fn every_solved_move_satisfies_the_optimality_conditions() {
    for horizon in [HORIZON, Horizon { prediction: 100, control: 50 }] {
        let mut mpc = engine(&bare(horizon));
        let n = 3 * horizon.control;
        let rows = 3 * (2 * horizon.control - 1);
        let mut judge = ActiveSet::new(n, rows, Settings::default()).unwrap();
        for step in 0..12 {
            let target = Vector3::new(0.2, -0.05 * f64::from(step), 1e-3);
            let limits = boxes(0.11, 0.06);
            let chosen = mpc.step(&resting(), &symmetric(1e4), |_| target, &limits, None);
            assert_eq!(chosen.status, QpStatus::Solved);
            assert!(chosen.violation <= 1e-9, "{}", chosen.violation);
            let p = mpc.program();
            judge.set_matrices(p.zeta, p.rows).unwrap();
            assert_eq!(judge.solve(p.eta, p.lower, p.upper).status, QpStatus::Solved);
            let (x, multipliers) = (judge.solution(), judge.multipliers());
            let residuals = kkt_residuals(p.zeta, p.rows, p.eta, p.lower, p.upper, x, multipliers);
            assert!(residuals.worst() < 1e-8, "{residuals:?}");
            for axis in 0..3 {
                let cold = x[axis * horizon.control];
                assert!((cold - chosen.du[axis]).abs() < 1e-9, "warm and cold start agree");
            }
        }
    }
}

#[test]
fn without_active_bounds_the_move_is_the_least_squares_answer() {
    let mut mpc = engine(&design(HORIZON));
    let ramp = |ahead: usize| Vector3::repeat(1e-3 * ahead as f64);
    let chosen = mpc.step(&moving(), &operating(), ramp, &boxes(1e3, 1e3), None);
    let p = mpc.program();
    let free: DVector<f64> = p.zeta.clone().cholesky().unwrap().solve(&-p.eta);
    for axis in 0..3 {
        assert!((free[3 * axis] - chosen.du[axis]).abs() < 1e-12);
    }
    assert_eq!(chosen.active, 0);
}

/// As the functions are cut off by the horizon, or more of them than it has samples.
#[test]
fn bases_that_the_horizon_cannot_distinguish_still_have_one_answer() {
    for (prediction, pole, terms) in
        [(20, 0.0, 21), (20, 0.5, 50), (20, 0.99, 20), (20, 0.98, 6), (200, 0.8, 50)]
    {
        let mut design = design(Horizon { prediction, control: 3 });
        for axis in &mut design.axes {
            axis.basis = Basis::Laguerre { pole, terms };
        }
        let mut mpc = engine(&design);
        let aim = |_| Vector3::new(0.2, -0.1, 0.3);
        let chosen = mpc.step(&moving(), &operating(), aim, &boxes(0.1, 0.1), None);
        assert_eq!(chosen.status, QpStatus::Solved, "{prediction} {pole} {terms}");
        let p = mpc.program();
        let mut judge = ActiveSet::new(3 * terms, p.rows.nrows(), Settings::default()).unwrap();
        judge.set_matrices(p.zeta, p.rows).unwrap();
        assert_eq!(judge.solve(p.eta, p.lower, p.upper).status, QpStatus::Solved);
        let (x, multipliers) = (mpc.solution(), judge.multipliers());
        let residuals = kkt_residuals(p.zeta, p.rows, p.eta, p.lower, p.upper, x, multipliers);
        assert!(residuals.worst() < 1e-8, "{prediction} {pole} {terms}: {residuals:?}");
    }
}

#[test]
fn the_papers_solver_agrees_once_it_is_swept_to_the_end() {
    let mut exact = engine(&bare(HORIZON));
    let mut swept = IncrementalMpc::new(&bare(HORIZON), SolverKind::HildrethConverged).unwrap();
    for step in 0..10 {
        let target = Vector3::new(0.2, 0.01 * f64::from(step), -0.1);
        let [a, b] = [&mut exact, &mut swept]
            .map(|mpc| mpc.step(&resting(), &symmetric(1e4), |_| target, &boxes(0.11, 0.06), None));
        assert!((a.u - b.u).amax() < 1e-8, "{} {}", a.u, b.u);
    }
}

#[test]
fn an_unfinished_answer_is_clipped_used_and_visible() {
    // 38 sweeps do not suffice for bounds far tighter than the unconstrained answer.
    let mut mpc = IncrementalMpc::new(&bare(HORIZON), SolverKind::Hildreth).unwrap();
    let tight = boxes(0.02, 0.01);
    let far = |_| Vector3::repeat(5.0);
    let chosen = mpc.step(&resting(), &symmetric(1e4), far, &tight, None);
    assert_eq!(chosen.status, QpStatus::IterationLimit);
    assert!(chosen.is_fallback());
    assert!((chosen.u.abs() - tight.inputs.du_max).max() <= 0.0, "{}", chosen.u);
    assert!(chosen.u.amax() > 0.0, "it moves");
}

#[test]
fn with_a_gain_or_a_reference_of_nan_the_last_input_is_kept_within_its_bounds() {
    let mut mpc = engine(&bare(HORIZON));
    let now = Measured { u_previous: Vector3::new(0.05, -0.3, 0.0), ..resting() };
    let limits = boxes(0.1, 0.1);
    for (gain, target) in [(f64::NAN, 1.0), (1e4, f64::NAN), (f64::INFINITY, 1.0)] {
        let aim = |_| Vector3::repeat(target);
        let chosen = mpc.step(&now, &symmetric(gain), aim, &limits, None);
        assert_eq!(chosen.status, QpStatus::NotFinite);
        assert_eq!(chosen.u, Vector3::new(0.05, -0.1, 0.0));
        assert!((chosen.relaxation - Vector3::new(0.0, 0.1, 0.0)).amax() < 1e-15);
        let next = mpc.step(&now, &symmetric(1e4), |_| now.output, &limits, None);
        assert_eq!(next.status, QpStatus::Solved, "and it recovers");
    }
}

#[test]
fn a_restored_engine_goes_on_with_the_same_bits() {
    let mut owner = engine(&design(HORIZON));
    let aim = |step: i32| move |_| Vector3::new(0.2, 0.02 * f64::from(step), -0.4);
    let limits = boxes(0.11, 0.06);
    for step in 0..5 {
        owner.step(&moving(), &operating(), aim(step), &limits, None);
    }
    let mut packed = [0; mpc::ROW_CAPACITY / 32];
    owner.pack_working_set(&mut packed);
    let mut heir = engine(&design(HORIZON));
    heir.restore(&packed).unwrap();
    for step in 5..9 {
        let [a, b] = [&mut owner, &mut heir]
            .map(|mpc| mpc.step(&moving(), &operating(), aim(step), &limits, None));
        assert_eq!(a, b);
    }
    assert!(heir.restore(&[u64::MAX; mpc::ROW_CAPACITY / 32]).is_err());
}

#[test]
fn no_step_allocates_whatever_changes() {
    let everything = Constraints {
        outputs: Some(Hardness::Soft { penalty: 1e3 }),
        rates: Some(Hardness::Soft { penalty: 1e3 }),
        ..Constraints::PAPER
    };
    let large =
        Design { constraints: everything, ..design(Horizon { prediction: 40, control: 6 }) };
    for (design, solver) in [
        (design(HORIZON), SolverKind::ActiveSet),
        (design(HORIZON), SolverKind::Hildreth),
        (large, SolverKind::ActiveSet),
    ] {
        let mut mpc = IncrementalMpc::new(&design, solver).unwrap();
        let counted = allocation_counter::measure(|| {
            for step in 1..20 {
                let operating = symmetric(1e4 / f64::from(step));
                let aim = |_| Vector3::repeat(0.2);
                mpc.step(&moving(), &operating, aim, &boxes(0.1, 0.05), None);
            }
        });
        assert_eq!(counted.count_total, 0, "{solver:?}");
    }
}

#[test]
fn a_design_that_makes_no_sense_is_refused_with_its_numbers() {
    type Spoil = fn(&mut Design<3>);
    let build =
        |design: &Design<3>| IncrementalMpc::new(design, SolverKind::ActiveSet).unwrap_err();
    let horizon = |prediction, control| build(&bare(Horizon { prediction, control }));
    assert_eq!(horizon(3, 4), MpcError::ControlHorizon { control: 4, prediction: 3 });
    assert_eq!(horizon(20, 0), MpcError::ControlHorizon { control: 0, prediction: 20 });
    assert_eq!(horizon(401, 3), MpcError::PredictionHorizon { prediction: 401, limit: 400 });
    assert_eq!(horizon(200, 51), MpcError::ControlLimit { control: 51, limit: 50 });
    let cases: [(&str, Spoil); 9] = [
        ("laguerre_pole = 1 ", |d| d.axes[1].basis = Basis::Laguerre { pole: 1.0, terms: 3 }),
        ("laguerre_pole = NaN", |d| d.axes[1].basis = Basis::Laguerre { pole: f64::NAN, terms: 3 }),
        ("laguerre_terms = 0", |d| d.axes[2].basis = Basis::Laguerre { pole: 0.5, terms: 0 }),
        ("output_weight = -1", |d| d.axes[0].output_weight = -1.0),
        ("terminal_factor = inf", |d| d.axes[0].terminal_factor = f64::INFINITY),
        ("lag_s = -0.1", |d| d.axes[0].lag_s = -0.1),
        ("delay_s = 0.02", |d| d.axes[0].delay_s = 0.02),
        ("drag_per_s = -1", |d| d.axes[0].drag_per_s = -1.0),
        ("penalty = -2", |d| d.constraints.levels = Some(Hardness::Soft { penalty: -2.0 })),
    ];
    for (message, spoil) in cases {
        let mut design = bare(HORIZON);
        spoil(&mut design);
        let error = build(&design).to_string();
        assert!(error.starts_with(message), "{error}");
    }
    let mut wide = bare(Horizon { prediction: 200, control: 3 });
    wide.constraints.outputs = Some(Hardness::Hard);
    wide.constraints.rates = Some(Hardness::Hard);
    assert_eq!(build(&wide), MpcError::Rows { rows: 15 + 1200, limit: 1024 });
}

#[test]
fn a_single_block_is_bounded_in_its_increment_and_in_the_level_at_its_end() {
    let mut design = bare(Horizon { prediction: 20, control: 5 });
    for axis in &mut design.axes {
        axis.basis = Basis::Blocks { terms: 1, samples: 5 };
    }
    for (level, increment, moved) in [(0.11, 0.06, 0.022), (0.11, 0.01, 0.01)] {
        let mut mpc = engine(&design);
        let limits = boxes(level, increment);
        let far = |_| Vector3::repeat(1e3);
        let chosen = mpc.step(&resting(), &symmetric(1e4), far, &limits, None);
        assert_eq!(chosen.status, QpStatus::Solved);
        assert!((chosen.du - Vector3::repeat(moved)).amax() < 1e-9, "{}", chosen.du);
    }
}
