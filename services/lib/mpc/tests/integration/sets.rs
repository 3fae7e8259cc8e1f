//! Constraint sets in every combination, against an interior-point solver, and under change.

use crate::common::{HORIZON, boxes, design, engine, moving, operating, resting};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use mpc::{
    Basis, Bounds, Constraints, Coupled, Hardness, IncrementalMpc, Limits, Measured, Program,
    QpStatus,
};
use nalgebra::{DVector, Vector3};

static SHARED: [[f64; 3]; 4] =
    [[0.0, -1.0, -1.0], [1.0, 0.0, 1.0], [0.0, 1.0, -1.0], [-1.0, 0.0, 1.0]];

/// The optimum by another method; `price[i]` s² for leaving row i by s, 0 forbids it.
fn interior_point(program: &Program<'_>, price: &[f64]) -> DVector<f64> {
    let (m, n) = program.rows.shape();
    let soft: Vec<usize> = (0..m).filter(|row| price[*row] > 0.0).collect();
    let width = n + soft.len();
    let mut p = vec![vec![0.0; width]; width];
    for (i, row) in p.iter_mut().enumerate().take(n) {
        for (j, entry) in row.iter_mut().enumerate().take(n) {
            *entry = if j >= i { program.zeta[(i, j)] } else { 0.0 };
        }
    }
    for (s, row) in soft.iter().enumerate() {
        p[n + s][n + s] = 2.0 * price[*row];
    }
    // A row that is always met: the solver wants at least one.
    let (mut a, mut b) = (vec![vec![0.0; width]], vec![1.0]);
    for row in 0..m {
        for (sign, bound) in [(1.0, program.upper[row]), (-1.0, -program.lower[row])] {
            if bound.is_infinite() {
                continue;
            }
            let mut line = vec![0.0; width];
            for (j, entry) in line.iter_mut().enumerate().take(n) {
                *entry = sign * program.rows[(row, j)];
            }
            if let Some(s) = soft.iter().position(|r| *r == row) {
                line[n + s] = -sign;
            }
            a.push(line);
            b.push(bound);
        }
    }
    let mut q = vec![0.0; width];
    q[..n].copy_from_slice(program.eta.as_slice());
    let cones = [SupportedConeT::NonnegativeConeT(b.len())];
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: 1e-12,
        tol_gap_rel: 1e-12,
        tol_feas: 1e-12,
        ..DefaultSettings::default()
    };
    let (p, a) = (CscMatrix::from(&p), CscMatrix::from(&a));
    let mut solver = DefaultSolver::new(&p, &q, &a, &b, &cones, settings).unwrap();
    solver.solve();
    let done = [SolverStatus::Solved, SolverStatus::AlmostSolved];
    assert!(done.contains(&solver.solution.status), "{:?}", solver.solution.status);
    DVector::from_column_slice(&solver.solution.x[..n])
}

fn limits<'a>(lower: &'a [f64; 4], upper: &'a [f64; 4]) -> Limits<'a, 3> {
    Limits {
        inputs: Bounds::symmetric(Vector3::repeat(0.05), Vector3::repeat(0.04)),
        coupled: Coupled { normals: &SHARED, lower, upper },
        output_min: Vector3::repeat(-0.4),
        output_max: Vector3::repeat(0.23),
        rate_max: Vector3::repeat(4.0),
    }
}

#[test]
fn every_combination_of_sets_hard_and_soft_has_its_optimum() {
    let soft = Hardness::Soft { penalty: 30.0 };
    let choices = [None, Some(Hardness::Hard), Some(soft)];
    let (lower, upper) = ([-0.03; 4], [0.04; 4]);
    let mut decided = 0;
    for combination in 0..3 * 3 * 3 * 4 {
        let pick = |place: usize| choices[combination / place % 3];
        // Outputs and rates hard may be infeasible, which is another test.
        let outputs = [None, Some(soft), None, Some(soft)][combination / 27];
        let rates = [None, None, Some(soft), Some(soft)][combination / 27];
        let coupled = pick(9).map(|hardness| (&SHARED[..], hardness));
        let mut design = design(HORIZON);
        design.constraints =
            Constraints { levels: pick(1), increments: pick(3), coupled, outputs, rates };
        let mut mpc = engine(&design);
        let limits = limits(&lower, &upper);
        let aim = |_| Vector3::new(0.3, -0.2, 0.5);
        let now = Measured { u_previous: Vector3::new(0.01, 0.0, -0.02), ..moving() };
        let chosen = mpc.step(&now, &operating(), aim, &limits, None);
        assert_eq!(chosen.status, QpStatus::Solved, "{:?}", design.constraints);

        let rows = mpc.program().rows.nrows();
        let mut price = Vec::with_capacity(rows);
        let merged = pick(1) == Some(Hardness::Hard) && pick(3) == Some(Hardness::Hard);
        let (weight, gain) = (operating().weight, operating().gain);
        let mean = weight.mean();
        let priced = |set: Option<Hardness>, scale: f64| match set {
            Some(Hardness::Soft { penalty }) => penalty * scale,
            _ => 0.0,
        };
        let by_axis = |i: usize, set: Option<Hardness>, of: &Vector3<f64>| priced(set, of[i % 3]);
        if pick(1).is_some() {
            price.extend((0..9).map(|i| by_axis(i, pick(1), &weight)));
        }
        if pick(3).is_some() {
            price.extend((0..if merged { 6 } else { 9 }).map(|i| by_axis(i, pick(3), &weight)));
        }
        if pick(9).is_some() {
            price.extend([priced(pick(9), mean); 12]);
        }
        let squared = gain.component_mul(&gain);
        for set in [outputs, rates].into_iter().flatten() {
            price.extend((0..60).map(|i| by_axis(i, Some(set), &squared)));
        }
        assert_eq!(price.len(), rows);
        let expected = interior_point(&mpc.program(), &price);
        let error = (mpc.solution() - &expected).amax();
        assert!(error < 1e-7, "{:?}: {error}", design.constraints);
        decided += u32::from(chosen.active > 0);
    }
    assert!(decided > 80, "{decided}");
}

#[test]
fn an_angle_bound_is_kept_if_hard_and_priced_if_soft() {
    let peak = |outputs: Option<Hardness>| {
        let mut design = design(HORIZON);
        design.constraints.outputs = outputs;
        let mut mpc = engine(&design);
        let end = Vector3::repeat(0.1);
        let limits = Limits { output_min: -end, output_max: end, ..boxes(0.2, 0.2) };
        let aim = |_| Vector3::new(0.2, 0.0, 0.0);
        let chosen = mpc.step(&resting(), &operating(), aim, &limits, None);
        assert_eq!(chosen.status, QpStatus::Solved);
        let is_soft = outputs.is_some_and(|hardness| !hardness.is_hard());
        assert_eq!(chosen.yielded > 0, is_soft, "a soft bound that gives way is reported");
        let still = mpc.step(&resting(), &operating(), |_| Vector3::zeros(), &limits, None);
        assert_eq!(still.yielded, 0);
        mpc.step(&resting(), &operating(), aim, &limits, None);
        let program = mpc.program();
        // Highest predicted roll, from the rows of a bounded twin.
        let mut twin = crate::common::design(HORIZON);
        twin.constraints.outputs = Some(Hardness::Hard);
        let mut twin = engine(&twin);
        twin.step(&resting(), &operating(), aim, &limits, None);
        let rows = twin.program().rows * mpc.solution();
        let start = rows.len() - 60;
        assert!(program.zeta.nrows() == 9);
        (0..20).map(|j| rows[start + 3 * j] * operating().gain.x).fold(0.0, f64::max)
    };
    let free = peak(None);
    let hard = peak(Some(Hardness::Hard));
    let [dear, cheap] = [100.0, 0.1].map(|penalty| peak(Some(Hardness::Soft { penalty })));
    assert!(free > 0.19 && hard <= 0.1 + 1e-9, "{free} {hard}");
    assert!(hard < dear && dear < cheap && cheap < free, "{hard} {dear} {cheap} {free}");
}

#[test]
fn what_cannot_be_met_is_a_verdict_and_the_move_stays_in_its_bounds() {
    let mut design = design(HORIZON);
    design.constraints.outputs = Some(Hardness::Hard);
    let mut mpc = engine(&design);
    let limits = Limits { output_max: Vector3::repeat(-1.0), ..boxes(0.05, 0.03) };
    let now = Measured { u_previous: Vector3::new(0.06, 0.0, -0.02), ..moving() };
    let chosen = mpc.step(&now, &operating(), |_| Vector3::zeros(), &limits, None);
    assert_eq!(chosen.status, QpStatus::Infeasible);
    assert!(chosen.is_fallback());
    assert!(chosen.u.amax() <= 0.05, "{}", chosen.u);
}

/// A gust may throw a state out of its bounds faster than any input can bring it back.
#[test]
fn a_state_that_cannot_be_kept_in_its_bounds_is_brought_back_as_if_they_were_soft() {
    let step = |hardness: Hardness| {
        let mut design = design(HORIZON);
        design.constraints.outputs = Some(hardness);
        design.constraints.rates = Some(hardness);
        let mut mpc = engine(&design);
        let limits = Limits {
            output_max: Vector3::repeat(0.2),
            output_min: Vector3::repeat(-0.2),
            rate_max: Vector3::repeat(2.0),
            ..boxes(0.05, 0.03)
        };
        let thrown = Measured {
            output: Vector3::repeat(0.3),
            rate: Vector3::repeat(4.0),
            rate_increment: Vector3::repeat(1.0),
            output_increment: Vector3::repeat(0.04),
            ..resting()
        };
        let first = mpc.step(&thrown, &operating(), |_| Vector3::zeros(), &limits, None);
        // Back inside, the bounds are as hard as before.
        let later = mpc.step(&resting(), &operating(), |_| Vector3::repeat(0.1), &limits, None);
        (first, later)
    };
    let (hard, later) = step(Hardness::Hard);
    let (soft, later_soft) = step(Hardness::Soft { penalty: 1e3 });
    assert_eq!((hard.status, soft.status), (QpStatus::Infeasible, QpStatus::Solved));
    assert!((hard.u - soft.u).amax() < 1e-12, "{} {}", hard.u, soft.u);
    assert!(hard.u.component_mul(&operating().gain).max() < 0.0, "it pushes back: {}", hard.u);
    assert_eq!((later.status, later_soft.status), (QpStatus::Solved, QpStatus::Solved));
}

/// Steps an engine on coupled rows whose bounds jump, and checks each move against them.
fn under_jumping_bounds(mpc: &mut IncrementalMpc<3>, mut judge: impl FnMut(QpStatus)) -> u32 {
    let mut u = Vector3::zeros();
    let mut relaxed = 0;
    for k in 0..400_u32 {
        // Thrust and scale of the rows as a rough flight would have them.
        let share = 0.3 * f64::from(k * 7919 % 101) / 100.0;
        let (lower, upper) = ([-share; 4], [0.3 - share; 4]);
        let room = share.min(0.3 - share);
        let tight = Vector3::new(2.0 * room, 2.0 * room, 2.0 * room);
        let limits = Limits {
            inputs: Bounds::symmetric(tight, Vector3::repeat(0.08)),
            coupled: Coupled { normals: &SHARED, lower: &lower, upper: &upper },
            ..boxes(1.0, 1.0)
        };
        let wave = |phase: u32| 0.4 * (f64::from(k * 31 % 17 + phase) - 9.0) / 9.0;
        let now = Measured {
            output: Vector3::new(wave(0), wave(3), wave(5)),
            u_previous: u * (1.0 + 0.2 * wave(1)),
            ..resting()
        };
        let chosen = mpc.step(&now, &operating(), |_| Vector3::zeros(), &limits, None);
        judge(chosen.status);
        for (normal, (low, high)) in SHARED.iter().zip(lower.iter().zip(upper)) {
            let value: f64 = normal.iter().zip(&chosen.u).map(|(n, u)| n * u).sum();
            assert!(value >= low - 1e-9 && value <= high + 1e-9, "{k}: {value} {low} {high}");
        }
        let excess = (chosen.u - now.u_previous).abs() - limits.inputs.du_max - chosen.relaxation;
        assert!(excess.max() <= 1e-9, "{k}: {excess}");
        relaxed += u32::from(chosen.relaxation.amax() > 0.0);
        u = chosen.u;
    }
    relaxed
}

#[test]
fn jumping_bounds_on_shared_rows_are_always_met_and_never_infeasible() {
    let mut design = design(HORIZON);
    design.constraints = Constraints {
        levels: None,
        coupled: Some((&SHARED, Hardness::Hard)),
        ..Constraints::PAPER
    };
    let mut mpc = engine(&design);
    let relaxed = under_jumping_bounds(&mut mpc, |status| assert_eq!(status, QpStatus::Solved));
    assert!(relaxed > 20, "{relaxed}");
}

#[test]
fn with_laguerre_functions_they_are_met_too_and_what_is_infeasible_is_reported() {
    let mut design = design(HORIZON);
    design.constraints = Constraints {
        levels: None,
        coupled: Some((&SHARED, Hardness::Hard)),
        ..Constraints::PAPER
    };
    for axis in &mut design.axes {
        axis.basis = Basis::Laguerre { pole: 0.6, terms: 2 };
    }
    let mut mpc = engine(&design);
    let mut solved = 0;
    under_jumping_bounds(&mut mpc, |status| {
        assert!(matches!(status, QpStatus::Solved | QpStatus::Infeasible), "{status:?}");
        solved += u32::from(status == QpStatus::Solved);
    });
    assert!(solved > 200, "{solved}");
}
