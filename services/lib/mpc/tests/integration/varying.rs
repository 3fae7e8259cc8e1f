//! A gain that changes along the horizon, against a simulation of what it means.
#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use crate::common::{HORIZON, boxes, design, engine, moving, operating};
use mpc::{Ahead, Bounds, Constraints, Design, Hardness, Limits, Measured, Operating};
use nalgebra::{DVector, SVector, Vector3};

const NP: usize = HORIZON.prediction;
const NC: usize = HORIZON.control;

/// Inertia over that at k, at each sample and in each period.
struct Path {
    gain: Vec<Vector3<f64>>,
    gain_at: Vec<Vector3<f64>>,
    inputs: Vec<Bounds<3>>,
    coupling: Vec<Vector3<f64>>,
}

impl Path {
    fn new(at: impl Fn(f64) -> f64) -> Self {
        let ratio = |t: f64| Vector3::new(at(t), at(0.5 * t), 1.0 / at(t));
        let bounds = |j: usize| {
            let level = Vector3::repeat(0.11 / (1.0 + 0.2 * j as f64));
            Bounds::symmetric(level, level)
        };
        Self {
            gain: (0..NP).map(|j| ratio(j as f64 + 0.5)).collect(),
            gain_at: (1..=NP).map(|j| ratio(j as f64)).collect(),
            inputs: (0..NC).map(bounds).collect(),
            coupling: vec![Vector3::repeat(1.0); NC],
        }
    }

    fn ahead(&self) -> Ahead<'_, 3> {
        Ahead {
            gain: &self.gain,
            gain_at: &self.gain_at,
            inputs: &self.inputs,
            coupling: &self.coupling,
        }
    }
}

/// Absolute state of one axis: the torque behind the lag, its past command, the momentum per
/// gain, the disturbance; by explicit integration of h' = a + d, y' = g(t) h.
struct Axis {
    y: f64,
    momentum: f64,
    actuator: f64,
    command: f64,
    disturbance: f64,
    lag_s: f64,
    delay_s: f64,
}

impl Axis {
    /// One period under `command` and a constant `gain`, with tiny steps. Returns y'.
    fn advance(&mut self, command: f64, gain: f64, period_s: f64) {
        for (time, input) in [(self.delay_s, self.command), (period_s - self.delay_s, command)] {
            let steps = 4000;
            let h = time / f64::from(steps);
            for _ in 0..steps {
                // Lag exactly, the two integrals by Simpson's rule.
                let at = |t: f64| {
                    let decay = if self.lag_s > 0.0 { (-t / self.lag_s).exp() } else { 0.0 };
                    input + (self.actuator - input) * decay + self.disturbance
                };
                let (a0, a1, a2) = (at(0.0), at(0.5 * h), at(h));
                let a0 = if self.lag_s > 0.0 { a0 } else { a1 };
                let middle = self.momentum + h / 24.0 * (5.0 * a0 + 8.0 * a1 - a2);
                let end = self.momentum + h / 6.0 * (a0 + 4.0 * a1 + a2);
                self.y += gain * h / 6.0 * (self.momentum + 4.0 * middle + end);
                self.momentum = end;
                self.actuator = a2 - self.disturbance;
            }
        }
        self.command = command;
    }
}

/// Simulates the period before k, so that the increments belong to a real past.
fn history(design: &Design<3>, operating: &Operating<3>) -> (Vec<Axis>, Measured<3>) {
    let mut axes: Vec<Axis> = (0..3)
        .map(|i| Axis {
            y: 0.1 * i as f64,
            momentum: 2e-4,
            actuator: 0.01,
            command: -0.02,
            disturbance: 0.013,
            lag_s: design.axes[i].lag_s,
            delay_s: design.axes[i].delay_s,
        })
        .collect();
    let part = |axes: &[Axis], of: fn(&Axis) -> f64| Vector3::from_fn(|i, _| of(&axes[i]));
    let rate = |axes: &[Axis]| part(axes, |a| a.momentum).component_mul(&operating.gain);
    let before = [part(&axes, |a| a.y), rate(&axes), part(&axes, |a| a.actuator)];
    let command = part(&axes, |a| a.command);
    for (i, axis) in axes.iter_mut().enumerate() {
        axis.advance(0.015, operating.gain[i], design.period_s);
    }
    let now = Measured {
        output: part(&axes, |a| a.y),
        output_increment: part(&axes, |a| a.y) - before[0],
        rate: rate(&axes),
        rate_increment: rate(&axes) - before[1],
        actuator_increment: part(&axes, |a| a.actuator) - before[2],
        input_increment: part(&axes, |a| a.command) - command,
        u_previous: part(&axes, |a| a.command),
    };
    (axes, now)
}

fn target(ahead: usize) -> Vector3<f64> {
    Vector3::new(0.2, 0.01 * ahead as f64, -0.1)
}

/// Outputs and rates at every sample for the unknowns x.
fn simulate(
    design: &Design<3>,
    operating: &Operating<3>,
    path: &Path,
    x: &DVector<f64>,
) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let (mut axes, now) = history(design, operating);
    let mut u = now.u_previous;
    (0..NP)
        .map(|j| {
            for (i, axis) in axes.iter_mut().enumerate() {
                u[i] += if j < NC { x[NC * i + j] } else { 0.0 };
                axis.advance(u[i], operating.gain[i] * path.gain[j][i], design.period_s);
            }
            let gain = operating.gain.component_mul(&path.gain_at[j]);
            let momentum = Vector3::from_fn(|i, _| axes[i].momentum);
            (Vector3::from_fn(|i, _| axes[i].y), momentum.component_mul(&gain))
        })
        .collect()
}

/// (15) with its weights.
fn cost(
    design: &Design<3>,
    operating: &Operating<3>,
    simulated: &[(Vector3<f64>, Vector3<f64>)],
    x: &DVector<f64>,
) -> f64 {
    let of_sample = |(j, (y, _)): (usize, &(Vector3<f64>, Vector3<f64>))| {
        let error = y - target(j + 1);
        let of_axis = |i: usize| {
            let axis = &design.axes[i];
            let last = if j + 1 == NP { axis.terminal_factor } else { 1.0 };
            last * axis.output_weight * error[i] * error[i]
        };
        (0..3).map(of_axis).sum::<f64>()
    };
    let errors: f64 = simulated.iter().enumerate().map(of_sample).sum();
    errors + (0..9).map(|n| operating.weight[n / NC] * x[n] * x[n]).sum::<f64>()
}

#[test]
fn cost_and_rows_are_those_of_a_simulated_future_with_a_constant_disturbance() {
    let mut design = design(HORIZON);
    design.constraints = Constraints {
        outputs: Some(Hardness::Hard),
        rates: Some(Hardness::Hard),
        ..Constraints::PAPER
    };
    let operating = operating();
    let path = Path::new(|t| 1.0 / (1.0 + 0.15 * t));
    let mut mpc = engine(&design);
    let (_, now) = history(&design, &operating);
    let limits = Limits {
        output_min: Vector3::repeat(-3.0),
        output_max: Vector3::repeat(5.0),
        rate_max: Vector3::repeat(70.0),
        ..boxes(0.11, 0.11)
    };
    mpc.step(&now, &operating, target, &limits, Some(&path.ahead()));
    let program = mpc.program();

    let simulate = |x: &DVector<f64>| simulate(&design, &operating, &path, x);
    let cost = |x: &DVector<f64>| cost(&design, &operating, &simulate(x), x);
    let still = DVector::zeros(9);
    for sample in 0..4 {
        let x = DVector::from_fn(9, |n, _| 0.02 * ((n * (sample + 2)) % 5) as f64 - 0.04);
        let expected = cost(&x) - cost(&still);
        let model = 0.5 * x.dot(&(program.zeta * &x)) + program.eta.dot(&x);
        assert!((model - expected).abs() < 1e-9 * cost(&x), "{model} {expected}");
        // Rows are in units of the gain at k: the distance to a bound must be the simulated one.
        let rows = program.rows * &x;
        let start = rows.len() - 6 * NP;
        for (j, (y, rate)) in simulate(&x).iter().enumerate() {
            for i in 0..3 {
                let gain = operating.gain[i];
                let row = start + 3 * j + i;
                let end = if gain > 0.0 { program.upper[row] } else { program.lower[row] };
                let room = (end - rows[row]) * gain;
                assert!((room - (5.0 - y[i])).abs() < 1e-9, "output {j} {i}: {room}");
                let row = row + 3 * NP;
                let end = if gain > 0.0 { program.upper[row] } else { program.lower[row] };
                let room = (end - rows[row]) * gain * path.gain_at[j][i];
                assert!((room - (70.0 - rate[i])).abs() < 1e-8, "rate {j} {i}: {room}");
            }
        }
    }
}

#[test]
fn a_gain_that_stays_gives_the_move_and_the_program_of_a_constant_one() {
    let design = design(HORIZON);
    let mut path = Path::new(|_| 1.0);
    let limits = boxes(0.11, 0.06);
    path.inputs = vec![limits.inputs; NC];
    let [mut plain, mut along] = [engine(&design), engine(&design)];
    let a = plain.step(&moving(), &operating(), target, &limits, None);
    let b = along.step(&moving(), &operating(), target, &limits, Some(&path.ahead()));
    assert!((a.u - b.u).amax() < 1e-12);
    let (p, q) = (plain.program(), along.program());
    assert!((p.zeta - q.zeta).amax() <= 1e-12 * p.zeta.amax());
    assert!((p.eta - q.eta).amax() <= 1e-12 * p.eta.amax());
    assert_eq!((p.rows, p.lower, p.upper), (q.rows, q.lower, q.upper));
}

#[test]
fn after_a_varied_step_a_plain_one_is_as_if_nothing_had_been() {
    let design = Design {
        constraints: Constraints { outputs: Some(Hardness::Hard), ..Constraints::PAPER },
        ..design(HORIZON)
    };
    let limits = Limits { output_max: SVector::repeat(9.0), ..boxes(0.11, 0.06) };
    let [mut fresh, mut used] = [engine(&design), engine(&design)];
    let path = Path::new(|t| 1.0 / (1.0 + 0.1 * t));
    used.step(&moving(), &operating(), target, &limits, Some(&path.ahead()));
    let mut packed = [0; mpc::ROW_CAPACITY / 32];
    used.pack_working_set(&mut packed);
    fresh.restore(&packed).unwrap();
    for _ in 0..2 {
        let [a, b] = [&mut fresh, &mut used]
            .map(|mpc| mpc.step(&moving(), &operating(), target, &limits, None));
        assert_eq!(a, b);
    }
    let counted = allocation_counter::measure(|| {
        used.step(&moving(), &operating(), target, &limits, Some(&path.ahead()));
    });
    assert_eq!(counted.count_total, 0);
}
