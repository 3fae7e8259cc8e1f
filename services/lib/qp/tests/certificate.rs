//! The certified worst case against runs of the solver at sampled parameters.

mod support;

use nalgebra::{DMatrix, DVector};
use qp::certificate::{Affine, CertificateError, ParametricQp, ParametricRow, Start};
use qp::{ActiveSet, QpSolver, QpStatus, Settings};
use rand::RngExt;
use support::generator;

const PARAMETERS: usize = 4;

/// Angles at steps 1..=`count` that follow from the increments (angle, rate) `dx`, at 100 Hz.
fn angles(mut dx: DVector<f64>, count: usize) -> DVector<f64> {
    let mut angle = 0.0;
    DVector::from_fn(count, |_, _| {
        angle += dx[0];
        dx[0] += 0.01 * dx[1];
        angle
    })
}

/// One axis of the attitude law: a double integrator at 100 Hz, cost on the angle over
/// `prediction` steps and on `control` increments of the torque. Parameters: the predicted
/// increments of angle and rate, the error, the torque held. Bounds on torque and increments,
/// `ratio` of these to a full torque.
fn axis(prediction: usize, control: usize, ratio: f64) -> ParametricQp {
    let (gain, rate_bound) = (1.0 / 3e-4, 0.01);
    let level_bound = ratio * rate_bound;
    let impulse = angles(DVector::from_vec(vec![0.5e-4 * gain, 1e-2 * gain]), prediction);
    let forced =
        DMatrix::from_fn(prediction, control, |i, j| if i < j { 0.0 } else { impulse[i - j] });
    let mut free = DMatrix::zeros(prediction, PARAMETERS);
    free.set_column(0, &angles(DVector::from_vec(vec![1.0, 0.0]), prediction));
    free.set_column(1, &angles(DVector::from_vec(vec![0.0, 1.0]), prediction));
    free.set_column(2, &DVector::from_element(prediction, 1.0));
    let pull = forced.tr_mul(&free);
    let f =
        (0..control).map(|j| Affine { slope: pull.row(j).transpose(), constant: 0.0 }).collect();
    let to = DVector::from_vec(vec![0.02, 1.0, 0.3, level_bound]);
    ParametricQp {
        hessian: forced.tr_mul(&forced) + DMatrix::identity(control, control),
        f,
        rows: rows(control, rate_bound, level_bound),
        from: -&to,
        to,
    }
}

/// Increments, and running sums that start from the torque held.
fn rows(control: usize, rate_bound: f64, level_bound: f64) -> Vec<ParametricRow> {
    let rate = |constant: f64| Affine { slope: DVector::zeros(PARAMETERS), constant };
    let level = |constant: f64| {
        let slope = DVector::from_fn(PARAMETERS, |i, _| if i == 3 { -1.0 } else { 0.0 });
        Affine { slope, constant }
    };
    let mut rows = Vec::new();
    for k in 0..control {
        let normal = DVector::from_fn(control, |j, _| f64::from(u8::from(j == k)));
        let (mut lower, mut upper) = (vec![rate(-rate_bound)], vec![rate(rate_bound)]);
        if k == 0 {
            lower.push(level(-level_bound));
            upper.push(level(level_bound));
        } else {
            let normal = DVector::from_fn(control, |j, _| f64::from(u8::from(j <= k)));
            let (lower, upper) = (vec![level(-level_bound)], vec![level(level_bound)]);
            rows.push(ParametricRow { normal, lower, upper });
        }
        rows.push(ParametricRow { normal, lower, upper });
    }
    rows
}

/// Most changes that the solver needs at sampled parameters, cold and warm.
fn sampled(qp: &ParametricQp, samples: usize, seed: u64) -> (u32, u32) {
    let (n, m) = (qp.hessian.nrows(), qp.rows.len());
    let rows = DMatrix::from_fn(m, n, |i, j| qp.rows[i].normal[j]);
    let solver = || {
        let mut solver = ActiveSet::new(n, m, Settings::default()).expect("n > 0");
        solver.set_matrices(&qp.hessian, &rows).expect("strictly convex");
        solver
    };
    let (mut cold, mut warm) = (solver(), solver());
    let mut worst = (0, 0);
    let mut random = generator(seed);
    for _ in 0..samples {
        let share = DVector::from_fn(PARAMETERS, |_, _| match random.random_range(0..4_u8) {
            0 => {
                if random.random_range(0..2_u8) == 0 {
                    -1.0
                } else {
                    1.0
                }
            }
            1 => random.random_range(-0.1..0.1),
            _ => random.random_range(-1.0..1.0),
        });
        let at = |value: &Affine| value.constant + value.slope.dot(&share.component_mul(&qp.to));
        let f = DVector::from_fn(n, |j, _| at(&qp.f[j]));
        let lower = DVector::from_fn(m, |i, _| {
            qp.rows[i].lower.iter().map(at).fold(f64::NEG_INFINITY, f64::max)
        });
        let upper = DVector::from_fn(m, |i, _| {
            qp.rows[i].upper.iter().map(at).fold(f64::INFINITY, f64::min)
        });
        cold.clear();
        let first = cold.solve(&f, &lower, &upper);
        let next = warm.solve(&f, &lower, &upper);
        assert_eq!((first.status, next.status), (QpStatus::Solved, QpStatus::Solved));
        worst = (worst.0.max(first.iterations), worst.1.max(next.iterations));
    }
    worst
}

#[test]
fn no_sampled_solve_needs_more_changes_than_certified_and_some_need_as_many() {
    for (prediction, control, ratio) in [(10, 1, 3.0), (10, 2, 3.0), (20, 2, 1.5)] {
        let qp = axis(prediction, control, ratio);
        let certified = [Start::Cold, Start::Warm].map(|start| qp.certify(start, 100_000).unwrap());
        let (cold, warm) = sampled(&qp, 50_000, 7);
        println!("{prediction} {control}: {certified:?}, sampled {cold} and {warm}");
        for (certificate, sampled) in certified.iter().zip([cold, warm]) {
            assert!(sampled <= certificate.changes && sampled + 1 >= certificate.changes);
        }
    }
    let qp = axis(20, 3, 2.5);
    let certified = qp.certify(Start::Cold, 100_000).unwrap();
    let (cold, _) = sampled(&qp, 100_000, 7);
    println!("20 3: {certified:?}, sampled {cold}");
    assert!(cold <= certified.changes && cold + 1 >= certified.changes);
}

#[test]
fn a_program_that_cannot_be_certified_is_refused_with_the_reason() {
    let good = axis(10, 2, 3.0);
    let refusal = |change: fn(&mut ParametricQp)| {
        let mut qp = good.clone();
        change(&mut qp);
        qp.certify(Start::Cold, 100_000).unwrap_err()
    };
    let error = refusal(|qp| qp.f.truncate(1));
    assert_eq!(error, CertificateError::Length { what: "f", got: 1, expected: 2 });
    let error = refusal(|qp| qp.hessian[(0, 0)] = -1.0);
    assert_eq!(error, CertificateError::NotPositiveDefinite);
    let error = refusal(|qp| qp.rows[0].lower[0].constant = f64::NEG_INFINITY);
    assert_eq!(error, CertificateError::NotFinite { what: "f or a bound" });
    let error = refusal(|qp| qp.rows.push(qp.rows[1].clone()));
    assert_eq!(error, CertificateError::ParallelRows { first: 1, second: 3 });
    // The level held may be so far outside that no step of the bounded length leads back.
    let error = refusal(|qp| (qp.from[3], qp.to[3]) = (-10.0, 10.0));
    assert!(matches!(error, CertificateError::Infeasible { .. }), "{error}");
    let error = good.certify(Start::Cold, 3).unwrap_err();
    assert_eq!(error, CertificateError::TooManyPaths { most: 3 });
}
