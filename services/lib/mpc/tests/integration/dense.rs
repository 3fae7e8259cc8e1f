//! The program against the matrices of (10), (11), (14) and (16) as printed, built naively.
#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use crate::common::exponential::exponential;
use crate::common::{HORIZON, boxes, design, engine, moving, operating};
use mpc::{Basis, Design, Horizon, Measured, QpStatus};
use nalgebra::{DMatrix, DVector, Matrix5, Vector3};
use qp::{ActiveSet, QpSolver, Settings};

/// (A, B) of x = [y, y', a, u(k-1)] for one axis, by the matrix exponential of its two phases.
fn sampled(gain: f64, lag_s: f64, delay_s: f64, period_s: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let phase = |driver: usize, time: f64| {
        let mut m = Matrix5::zeros();
        m[(0, 1)] = 1.0;
        if lag_s > 0.0 {
            m[(1, 2)] = gain;
            m[(2, 2)] = -1.0 / lag_s;
            m[(2, driver)] = 1.0 / lag_s;
        } else {
            m[(1, driver)] = gain;
        }
        exponential(m * time)
    };
    let mut all = phase(4, period_s - delay_s) * phase(3, delay_s);
    all.set_row(3, &nalgebra::RowVector5::new(0.0, 0.0, 0.0, 0.0, 1.0));
    if lag_s == 0.0 {
        all.set_row(2, &nalgebra::RowVector5::new(0.0, 0.0, 0.0, 0.0, 1.0));
    }
    let a = DMatrix::from_fn(4, 4, |i, j| all[(i, j)]);
    (a, DMatrix::from_fn(4, 1, |i, _| all[(i, 4)]))
}

/// The whole law in matrices: x = [x1; x2; x3], time by time, then axis.
struct Naive {
    f: DMatrix<f64>,
    h: DMatrix<f64>,
    q: DMatrix<f64>,
    prediction: usize,
}

impl Naive {
    /// With `moves` increments of each input.
    fn new(design: &Design<3>, gain: &Vector3<f64>, moves: usize) -> Self {
        let (mut a, mut b) = (DMatrix::zeros(12, 12), DMatrix::zeros(12, 3));
        let mut c = DMatrix::zeros(3, 12);
        for (i, axis) in design.axes.iter().enumerate() {
            let (one, input) = sampled(gain[i], axis.lag_s, axis.delay_s, design.period_s);
            a.view_mut((4 * i, 4 * i), (4, 4)).copy_from(&one);
            b.view_mut((4 * i, i), (4, 1)).copy_from(&input);
            c[(i, 4 * i)] = 1.0;
        }
        let mut big_a = DMatrix::<f64>::identity(15, 15);
        big_a.view_mut((0, 0), (12, 12)).copy_from(&a);
        big_a.view_mut((12, 0), (3, 12)).copy_from(&(&c * &a));
        let mut big_b = DMatrix::zeros(15, 3);
        big_b.view_mut((0, 0), (12, 3)).copy_from(&b);
        big_b.view_mut((12, 0), (3, 3)).copy_from(&(&c * &b));
        let mut big_c = DMatrix::zeros(3, 15);
        big_c.view_mut((0, 12), (3, 3)).copy_from(&DMatrix::identity(3, 3));

        let prediction = design.horizon.prediction;
        let mut f = DMatrix::zeros(3 * prediction, 15);
        let mut h = DMatrix::zeros(3 * prediction, 3 * moves);
        let mut power = DMatrix::identity(15, 15); // A^i
        for i in 0..prediction {
            let block = &big_c * &power * &big_b;
            for j in i..prediction {
                if j - i < moves {
                    h.view_mut((3 * j, 3 * (j - i)), (3, 3)).copy_from(&block);
                }
            }
            power = &big_a * power;
            f.view_mut((3 * i, 0), (3, 15)).copy_from(&(&big_c * &power));
        }
        let q = DVector::from_fn(3 * prediction, |row, _| {
            let axis = &design.axes[row % 3];
            let last = row / 3 + 1 == prediction;
            axis.output_weight * if last { axis.terminal_factor } else { 1.0 }
        });
        Self { f, h, q: DMatrix::from_diagonal(&q), prediction }
    }

    /// ζ and η of (16) for increments Δu = Φ x with weights w.
    fn program(
        &self,
        phi: &DMatrix<f64>,
        w: &Vector3<f64>,
        now: &Measured<3>,
        reference: impl Fn(usize) -> Vector3<f64>,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let h = &self.h * phi;
        // Orthonormal over all time: Σ Δu² of an input is the sum of its coefficients' squares.
        let weights = DMatrix::from_diagonal(&DVector::from_fn(phi.ncols(), |column, _| {
            let moved = (0..phi.nrows()).find(|row| phi[(*row, column)] != 0.0);
            moved.map_or(0.0, |row| w[row % 3])
        }));
        let state = DVector::from_fn(15, |row, _| {
            if row >= 12 {
                return now.output[row - 12];
            }
            let parts = [
                &now.output_increment,
                &now.rate_increment,
                &now.actuator_increment,
                &now.input_increment,
            ];
            parts[row % 4][row / 4]
        });
        let rs = DVector::from_fn(3 * self.prediction, |row, _| reference(row / 3 + 1)[row % 3]);
        let zeta = (h.transpose() * &self.q * &h + weights) * 2.0;
        (zeta, h.transpose() * &self.q * (rs - &self.f * state) * -2.0)
    }
}

/// Φ by the definition: powers of the matrix `A_l`, input after input, time by time; 1/√n in a block of n samples.
fn functions(bases: &[Basis; 3], samples: usize) -> DMatrix<f64> {
    let unknowns = bases.iter().map(Basis::terms).sum();
    let mut phi = DMatrix::zeros(3 * samples, unknowns);
    let mut at = 0;
    for (i, basis) in bases.iter().copied().enumerate() {
        let (a, terms) = match basis {
            Basis::Laguerre { pole, terms } => (pole, terms),
            Basis::Blocks { terms, .. } => {
                assert_eq!(basis, BLOCKS);
                for (term, [from, to]) in BLOCK_SAMPLES.into_iter().enumerate() {
                    for m in from..to {
                        phi[(3 * m + i, at + term)] = 1.0 / ((to - from) as f64).sqrt();
                    }
                }
                at += terms;
                continue;
            }
        };
        let beta = 1.0 - a * a;
        let power = |n: usize| if n == 0 { 1.0 } else { (-a).powf(n as f64) };
        let a_l = DMatrix::from_fn(terms, terms, |r, c| match r.cmp(&c) {
            core::cmp::Ordering::Less => 0.0,
            core::cmp::Ordering::Equal => a,
            core::cmp::Ordering::Greater => power(r - c - 1) * beta,
        });
        let mut l = DVector::from_fn(terms, |r, _| beta.sqrt() * power(r));
        for m in 0..samples {
            phi.view_mut((3 * m + i, at), (1, terms)).copy_from(&l.transpose());
            l = &a_l * l;
        }
        at += terms;
    }
    phi
}

/// Of 1, 2, 5 and 9 samples: the factor by which they grow is 2.1.
const BLOCKS: Basis = Basis::Blocks { terms: 4, samples: 17 };
const BLOCK_SAMPLES: [[usize; 2]; 4] = [[0, 1], [1, 3], [3, 8], [8, 17]];

fn reference(ahead: usize) -> Vector3<f64> {
    Vector3::new(0.2, 0.01 * ahead as f64, -0.3)
}

#[test]
fn classic_and_laguerre_programs_are_those_of_equations_10_11_and_16() {
    let mixed = [
        Basis::Laguerre { pole: 0.5, terms: 3 },
        Basis::Laguerre { pole: 0.0, terms: 5 },
        Basis::Laguerre { pole: 0.85, terms: 1 },
    ];
    let long = Horizon { prediction: 100, control: 50 };
    for (horizon, bases) in [
        (HORIZON, [Basis::pulses(3); 3]),
        (long, [Basis::pulses(50); 3]),
        (HORIZON, mixed),
        (Horizon { prediction: 200, control: 12 }, mixed),
        (Horizon { prediction: 20, control: 17 }, [BLOCKS; 3]),
    ] {
        let mut design = design(horizon);
        for (axis, basis) in design.axes.iter_mut().zip(bases) {
            axis.basis = basis;
        }
        let mut mpc = engine(&design);
        mpc.step(&moving(), &operating(), reference, &boxes(1.0, 1.0), None);
        let samples = horizon.prediction;
        let naive = Naive::new(&design, &operating().gain, samples);
        let phi = functions(&bases, samples);
        let (zeta, eta) = naive.program(&phi, &operating().weight, &moving(), reference);
        let program = mpc.program();
        let (scale, slope) = (zeta.amax(), eta.amax());
        assert!((program.zeta - &zeta).amax() < 1e-11 * scale, "{horizon:?}");
        assert!((program.eta - &eta).amax() < 1e-10 * slope, "{horizon:?}");
        assert_eq!(program.zeta, &program.zeta.transpose());

        // (12)-(14): levels by time, then increments from the second move on; of blocks, the level at the end.
        let x = DVector::from_fn(phi.ncols(), |i, _| 0.01 * ((3 * i) % 7) as f64 - 0.02);
        let (du, rows) = (&phi * &x, program.rows * &x);
        let each: Vec<[usize; 2]> = (0..horizon.control).map(|m| [m, m + 1]).collect();
        let bounded = if bases[0] == BLOCKS { BLOCK_SAMPLES.to_vec() } else { each };
        let moves = 3 * bounded.len();
        assert_eq!(rows.len(), 2 * moves - 3);
        let mut level = [0.0; 3];
        for (m, [from, to]) in bounded.into_iter().enumerate() {
            for i in 0..3 {
                level[i] += (from..to).map(|sample| du[3 * sample + i]).sum::<f64>();
                assert!((rows[3 * m + i] - level[i]).abs() < 1e-12);
                if m > 0 {
                    assert!((rows[moves - 3 + 3 * m + i] - du[3 * from + i]).abs() < 1e-12);
                }
            }
        }
    }
}

#[test]
fn at_pole_zero_a_closed_loop_is_the_classic_one() {
    let design = design(HORIZON);
    let (gain, weight) = (operating().gain, operating().weight);
    let mut mpc = engine(&design);
    let naive = Naive::new(&design, &gain, HORIZON.control);
    // Constrained classic form: increments themselves are the unknowns, by time, then input.
    let phi = DMatrix::identity(9, 9);
    let rows = DMatrix::from_fn(18, 9, |row, column| match row {
        0..9 => f64::from(column <= row && (row - column).is_multiple_of(3)),
        _ => f64::from(column == row - 9),
    });
    let mut solver = ActiveSet::new(9, 18, Settings::default()).unwrap();
    let model: Vec<_> = (0..3)
        .map(|i| sampled(gain[i], design.axes[i].lag_s, design.axes[i].delay_s, design.period_s))
        .collect();
    let limits = boxes(0.05, 0.03);
    let mut states = vec![DVector::<f64>::zeros(4); 3];
    let mut previous = states.clone();
    let mut active = 0;
    for k in 0..60 {
        let part = |states: &[DVector<f64>], row: usize| Vector3::from_fn(|i, _| states[i][row]);
        let now = Measured {
            output: part(&states, 0),
            output_increment: part(&states, 0) - part(&previous, 0),
            rate: part(&states, 1),
            rate_increment: part(&states, 1) - part(&previous, 1),
            actuator_increment: part(&states, 2) - part(&previous, 2),
            input_increment: part(&states, 3) - part(&previous, 3),
            u_previous: part(&states, 3),
        };
        let aim = |_| Vector3::new(0.2, if k < 30 { 0.1 } else { -0.1 }, 0.3);
        let chosen = mpc.step(&now, &operating(), aim, &limits, None);
        assert_eq!(chosen.status, QpStatus::Solved);
        active += chosen.active;

        let (zeta, eta) = naive.program(&phi, &weight, &now, aim);
        solver.set_matrices(&((&zeta + zeta.transpose()) * 0.5), &rows).unwrap();
        let bound = |side: f64| {
            DVector::from_fn(18, |row, _| {
                if row < 9 { side * 0.05 - now.u_previous[row % 3] } else { side * 0.03 }
            })
        };
        assert_eq!(solver.solve(&eta, &bound(-1.0), &bound(1.0)).status, QpStatus::Solved);
        let classic = now.u_previous + solver.solution().fixed_rows::<3>(0);
        // Two roundings of one program, solved: 1e-12 of what is bounded by 0.05 is beyond both.
        assert!((classic - chosen.u).amax() < 1e-12, "{k}: {classic} {}", chosen.u);

        previous.clone_from(&states);
        for (i, state) in states.iter_mut().enumerate() {
            *state = &model[i].0 * &*state + &model[i].1 * chosen.u[i];
        }
    }
    assert!(active > 30, "the bounds took part: {active}");
}
