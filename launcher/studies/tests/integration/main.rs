//! The certified worst case against runs of the solver at sampled parameters.

use nalgebra::{DMatrix, DVector};
use qp::{ActiveSet, QpSolver, QpStatus, Settings};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use studies::certificate::{Affine, CertificateError, ParametricQp, ParametricRow, Start};

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

struct Solves<'a> {
    qp: &'a ParametricQp,
    solver: ActiveSet,
}

impl<'a> Solves<'a> {
    fn of(qp: &'a ParametricQp) -> Self {
        let (n, m) = (qp.hessian.nrows(), qp.rows.len());
        let rows = DMatrix::from_fn(m, n, |i, j| qp.rows[i].normal[j]);
        let mut solver = ActiveSet::new(n, m, Settings::default()).expect("n > 0");
        solver.set_matrices(&qp.hessian, &rows).expect("strictly convex");
        Self { qp, solver }
    }

    /// Changes of the working set that the solver makes from the given one.
    fn changes(&mut self, parameters: &DVector<f64>, from: &[i8]) -> u32 {
        let (qp, m) = (self.qp, from.len());
        let at = |value: &Affine| value.constant + value.slope.dot(parameters);
        let f = DVector::from_fn(qp.f.len(), |j, _| at(&qp.f[j]));
        let lower = |i: usize| qp.rows[i].lower.iter().map(at).fold(f64::NEG_INFINITY, f64::max);
        let upper = |i: usize| qp.rows[i].upper.iter().map(at).fold(f64::INFINITY, f64::min);
        let (lower, upper) =
            (DVector::from_fn(m, |i, _| lower(i)), DVector::from_fn(m, |i, _| upper(i)));
        self.solver.set_working_set(from).expect("a set of this solver");
        let outcome = self.solver.solve(&f, &lower, &upper);
        assert_eq!(outcome.status, QpStatus::Solved);
        outcome.iterations
    }
}

/// Most changes at sampled parameters, cold and from the sets that other samples ended in, rare
/// ones as often as common ones.
fn sampled(qp: &ParametricQp, samples: usize, seed: u64) -> [u32; 2] {
    let mut solves = Solves::of(qp);
    let mut sets = vec![vec![0_i8; qp.rows.len()]];
    let mut worst = [0; 2];
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..samples {
        let share = DVector::from_fn(PARAMETERS, |_, _| match random.random_range(0..4_u8) {
            0 => f64::from(random.random_range(0..2_u8) * 2) - 1.0,
            1 => random.random_range(-0.1..0.1),
            _ => random.random_range(-1.0..1.0),
        });
        let parameters = share.component_mul(&qp.to);
        worst[0] = worst[0].max(solves.changes(&parameters, &sets[0]));
        let ended = solves.solver.working_set().to_vec();
        let from = &sets[random.random_range(0..sets.len())];
        worst[1] = worst[1].max(solves.changes(&parameters, from));
        if !sets.contains(&ended) {
            sets.push(ended);
        }
    }
    worst
}

fn check(qp: &ParametricQp, start: Start, sampled: u32) {
    let certificate = qp.certify(start, 100_000).expect("it has solutions everywhere");
    assert!(sampled <= certificate.changes, "{sampled} changes sampled: {certificate:?}");
    let reached = Solves::of(qp).changes(&certificate.at, &certificate.from);
    assert_eq!(reached, certificate.changes, "at the worst parameters: {certificate:?}");
}

#[test]
fn no_sampled_solve_needs_more_changes_than_certified_and_the_worst_needs_as_many() {
    for (prediction, control, ratio) in [(10, 1, 3.0), (10, 2, 3.0), (20, 2, 1.5)] {
        let qp = axis(prediction, control, ratio);
        let [cold, warm] = sampled(&qp, 50_000, 7);
        check(&qp, Start::Cold, cold);
        check(&qp, Start::Warm, warm);
    }
    let qp = axis(20, 3, 2.5);
    check(&qp, Start::Cold, sampled(&qp, 50_000, 7)[0]);
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
