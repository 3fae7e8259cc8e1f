//! Programs with a certificate by construction: built around a known solution, or around a
//! combination of rows that no point satisfies.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::support::{Problem, hessian, mpc, sample, vector};

/// What is known of a program.
#[derive(Debug, Clone)]
pub(crate) enum Truth {
    /// The one solution, and how far an answer may be from it, in the energy norm.
    Solution(DVector<f64>, f64),
    /// A solution exists.
    Feasible,
    /// A positive combination of its rows is contradictory.
    Infeasible,
}

#[derive(Debug, Clone)]
pub(crate) struct Case {
    pub(crate) kind: &'static str,
    pub(crate) problem: Problem,
    /// Per row, zero if hard.
    pub(crate) compliance: Vec<f64>,
    pub(crate) truth: Truth,
}

type Kind = (&'static str, fn(&mut ChaCha8Rng, usize) -> Case);

const KINDS: [Kind; 18] = [
    ("known solution", |random, n| Known::any(random, n).case(random)),
    ("ill-conditioned", |random, n| Known { digits: 8.0, ..Known::any(random, n) }.case(random)),
    ("degenerate", |random, n| {
        Known { active: 0.9, without_force: 0.5, ..Known::any(random, n) }.case(random)
    }),
    ("duplicates", |random, n| {
        let case = Known::with_rows(random, n).case(random);
        let copies = random.random_range(1..=n + 2);
        let problem = case.problem.with_duplicates(random, copies);
        let compliance = vec![0.0; problem.m()];
        Case { problem, compliance, ..case }
    }),
    ("nearly parallel", nearly_parallel),
    ("equalities", |random, n| Known { equal: 0.4, ..Known::any(random, n) }.case(random)),
    ("badly scaled", |random, n| {
        let case = Known::any(random, n).case(random);
        rescaled(random, case)
    }),
    ("badly scaled, degenerate", |random, n| {
        let known = Known { active: 0.8, without_force: 0.3, ..Known::any(random, n) };
        let case = known.case(random);
        rescaled(random, case)
    }),
    ("soft", |random, n| Known { soft: 0.5, ..Known::any(random, n) }.case(random)),
    ("contradiction", contradiction),
    ("badly scaled contradiction", |random, n| {
        let case = contradiction(random, n);
        rescaled(random, case)
    }),
    ("far free minimum", |random, n| {
        let known =
            Known { active: 0.6, push: magnitude(random, 3.0, 12.0), ..Known::any(random, n) };
        known.case(random)
    }),
    ("far free minimum of a box", |random, n| box_far_away(random, n)),
    ("far free minimum, badly scaled", |random, n| {
        let known =
            Known { active: 0.6, push: magnitude(random, 3.0, 12.0), ..Known::any(random, n) };
        let case = known.case(random);
        rescaled(random, case)
    }),
    ("polytope", |random, n| polytope(random, n.min(6), false)),
    ("empty polytope", |random, n| polytope(random, n.min(6), true)),
    ("tied control moves", |random, n| {
        let ratio = f64::from(random.random_range(1..5_u8));
        let problem = mpc(random, n.min(40), ratio);
        let compliance = vec![0.0; problem.m()];
        Case { kind: "", problem, compliance, truth: Truth::Feasible }
    }),
    ("tied control moves of several axes", |random, _| {
        let problem = several_axes(random);
        let compliance = vec![0.0; problem.m()];
        Case { kind: "", problem, compliance, truth: Truth::Feasible }
    }),
];

/// The case of a seed; small ones are as frequent as large ones, up to `n` = 60.
pub(crate) fn case(seed: u64) -> Case {
    let mut random = crate::support::generator(seed);
    let largest = [4, 12, 30, 60][random.random_range(0..4_usize)];
    let n = random.random_range(1..=largest);
    let (kind, build) = KINDS[random.random_range(0..KINDS.len())];
    Case { kind, ..build(&mut random, n) }
}

/// Axes without a common row, pushed against many of their bounds, variables and rows in any order.
fn several_axes(random: &mut ChaCha8Rng) -> Problem {
    let (axes, moves) = (random.random_range(1..=3_usize), random.random_range(5..=50_usize));
    let (n, m) = (axes * moves, 2 * axes * moves);
    let [columns, lines] = [n, m].map(|count| shuffled(random, count));
    let (mut hessian, mut rows) = (DMatrix::zeros(n, n), DMatrix::zeros(m, n));
    let (mut f, mut lower, mut upper) = (DVector::zeros(n), DVector::zeros(m), DVector::zeros(m));
    for axis in 0..axes {
        let ratio = f64::from(random.random_range(1..6_u8));
        let part = mpc(random, moves, ratio);
        let push = magnitude(random, -1.0, 3.0);
        let column = |j: usize| columns[axis * moves + j];
        for j in 0..moves {
            f[column(j)] = push * part.f[j];
            (0..moves).for_each(|k| hessian[(column(k), column(j))] = part.hessian[(k, j)]);
        }
        for i in 0..part.m() {
            let line = lines[axis * part.m() + i];
            (lower[line], upper[line]) = (part.lower[i], part.upper[i]);
            (0..moves).for_each(|j| rows[(line, column(j))] = part.rows[(i, j)]);
        }
    }
    Problem { hessian, rows, f, lower, upper }
}

/// The numbers below `count` in any order.
fn shuffled(random: &mut ChaCha8Rng, count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for k in (1..count).rev() {
        order.swap(k, random.random_range(0..=k));
    }
    order
}

fn chance(random: &mut ChaCha8Rng, share: f64) -> bool {
    random.random_range(0.0..1.0) < share
}

/// Ten to a power between the two.
fn magnitude(random: &mut ChaCha8Rng, least: f64, most: f64) -> f64 {
    10.0_f64.powf(random.random_range(least..most))
}

/// A program around a solution: rows, which of them hold it, and how strongly.
#[derive(Debug)]
struct Known {
    n: usize,
    m: usize,
    /// Condition of the Hessian, at most, in decimal digits.
    digits: f64,
    /// Shares of rows.
    active: f64,
    equal: f64,
    soft: f64,
    /// Share of active rows whose multiplier is zero.
    without_force: f64,
    /// Size of the multipliers, and so of the way to the free minimum, in the size of the solution.
    push: f64,
}

impl Known {
    fn any(random: &mut ChaCha8Rng, n: usize) -> Self {
        let m = random.random_range(0..=3 * n);
        let active = random.random_range(0.0..0.6);
        Self { n, m, digits: 4.0, active, equal: 0.03, soft: 0.0, without_force: 0.1, push: 1.0 }
    }

    fn with_rows(random: &mut ChaCha8Rng, n: usize) -> Self {
        let known = Self::any(random, n);
        Self { m: known.m.max(1), ..known }
    }

    fn case(&self, random: &mut ChaCha8Rng) -> Case {
        let (n, m) = (self.n, self.m);
        let cond = magnitude(random, 0.0, self.digits);
        let hessian = hessian(random, n, cond);
        let rows = rows(random, m, n);
        let x = vector(random, n) * 2.0;
        let values = &rows * &x;
        let (mut lower, mut upper) = (values.clone(), values);
        let (mut force, mut compliance) = (DVector::zeros(m), vec![0.0; m]);
        let strength = hessian.diagonal().mean();
        let mut equalities = 0;
        for i in 0..m {
            if equalities < n && chance(random, self.equal) {
                equalities += 1;
                force[i] = sample(random) * strength;
                continue;
            }
            let side = if chance(random, 0.5) { 1.0 } else { -1.0 };
            let room = if chance(random, 0.3) { f64::INFINITY } else { gap(random) };
            if chance(random, self.active) {
                if !chance(random, self.without_force) {
                    force[i] = side * strength * self.push * random.random_range(0.01..1.0);
                }
                if chance(random, self.soft) {
                    compliance[i] = magnitude(random, -4.0, 2.0) / strength;
                }
                let given = compliance[i] * force[i];
                (lower[i], upper[i]) = (lower[i] - given, upper[i] - given);
                if side > 0.0 { lower[i] -= room } else { upper[i] += room }
            } else {
                lower[i] -= if side > 0.0 { room } else { gap(random) };
                upper[i] += if side > 0.0 { gap(random) } else { room };
            }
        }
        let f = -(&hessian * &x + rows.tr_mul(&force));
        let problem = Problem { hessian, rows, f, lower, upper };
        Case { kind: "", problem, compliance, truth: Truth::Solution(x, 1e-6) }
    }
}

/// A box that the free minimum lies far outside of, as a controller meets it that asks for what no
/// actuator gives.
fn box_far_away(random: &mut ChaCha8Rng, n: usize) -> Case {
    let cond = magnitude(random, 0.0, 4.0);
    let hessian = hessian(random, n, cond);
    let rows = DMatrix::identity(n, n);
    let bound = DVector::from_fn(n, |_, _| gap(random));
    let f = &hessian * vector(random, n) * magnitude(random, 0.0, 12.0);
    let problem = Problem { hessian, rows, f, lower: -&bound, upper: bound };
    Case { kind: "", problem, compliance: vec![0.0; n], truth: Truth::Feasible }
}

fn gap(random: &mut ChaCha8Rng) -> f64 {
    magnitude(random, -3.0, 0.5)
}

/// Dense rows, boxes, running sums or mostly zeros.
fn rows(random: &mut ChaCha8Rng, m: usize, n: usize) -> DMatrix<f64> {
    let style = random.random_range(0..4_u8);
    let mut rows = DMatrix::zeros(m, n);
    for i in 0..m {
        let at = random.random_range(0..n);
        let style = if style == 3 { random.random_range(0..3_u8) } else { style };
        for j in 0..n {
            rows[(i, j)] = match style {
                0 => sample(random),
                1 => f64::from(u8::from(at == j)),
                _ if j == at => 1.0,
                _ if chance(random, 0.2) => sample(random),
                _ => 0.0,
            };
        }
    }
    rows
}

/// Rows that differ from others by angles down to 1e-12, about as tight as these. Their crossing
/// is as uncertain as rounding divided by the angle, so only the conditions are judged.
fn nearly_parallel(random: &mut ChaCha8Rng, n: usize) -> Case {
    let known = Known::with_rows(random, n.max(2));
    let Case { kind, problem, .. } = known.case(random);
    let Problem { hessian, mut rows, mut f, mut lower, mut upper } = problem;
    let (m, count) = (rows.nrows(), random.random_range(1..=4));
    let x = vector(random, known.n);
    rows = rows.resize_vertically(m + count, 0.0);
    lower = lower.resize_vertically(m + count, 0.0);
    upper = upper.resize_vertically(m + count, 0.0);
    for k in m..m + count {
        let source = random.random_range(0..m);
        let angle = magnitude(random, -12.0, -6.0);
        let turn = vector(random, known.n).transpose() * angle;
        let turned = rows.row(source) + turn;
        rows.set_row(k, &turned);
    }
    // All bounds anew around one point, so that the program stays feasible.
    let values = &rows * &x;
    // Enough that the point itself is feasible whatever the rounding of its row values.
    let rounding = rows.abs() * x.abs() * (f64::EPSILON * known.n as f64);
    for (i, value) in values.iter().enumerate() {
        let slack = |random: &mut ChaCha8Rng| match random.random_range(0..3_u8) {
            0 => 0.0,
            1 => magnitude(random, -12.0, -3.0),
            _ => gap(random),
        };
        lower[i] = value - slack(random) - rounding[i];
        upper[i] = value + slack(random) + rounding[i];
    }
    f += &hessian * vector(random, known.n);
    let problem = Problem { hessian, rows, f, lower, upper };
    let compliance = vec![0.0; m + count];
    Case { kind, problem, compliance, truth: Truth::Feasible }
}

/// One row is a positive combination of others and asked to be beyond what their bounds allow.
fn contradiction(random: &mut ChaCha8Rng, n: usize) -> Case {
    let known = Known::with_rows(random, n);
    let case = known.case(random);
    let mut problem = case.problem;
    let (m, at) = (problem.m(), random.random_range(0..problem.m()));
    let (mut row, mut most, mut size) = (problem.rows.row(at) * 0.0, 0.0, 0.0);
    for _ in 0..random.random_range(1..=n.min(m)) {
        let i = random.random_range(0..m);
        let (side, bound) = if problem.upper[i].is_finite() {
            (1.0, problem.upper[i])
        } else {
            (-1.0, problem.lower[i])
        };
        let weight = side * random.random_range(0.1..1.0);
        row += problem.rows.row(i) * weight;
        most += weight * bound;
        size += (weight * bound).abs() + weight.abs() * problem.rows.row(i).abs().sum();
    }
    let asked = most + size * magnitude(random, -5.0, 0.0);
    let sign = if chance(random, 0.5) { 1.0 } else { -1.0 };
    problem.rows = problem.rows.insert_row(at, 0.0);
    problem.rows.set_row(at, &(row * sign));
    let (low, high) = if sign > 0.0 { (asked, f64::INFINITY) } else { (f64::NEG_INFINITY, -asked) };
    problem.lower = problem.lower.insert_row(at, low);
    problem.upper = problem.upper.insert_row(at, high);
    Case { kind: "", problem, compliance: vec![0.0; m + 1], truth: Truth::Infeasible }
}

/// The point of a polytope that is nearest to another one, which is how a region is searched for a
/// point: a box and many half-spaces, several of them almost the same, around a small ball or none.
fn polytope(random: &mut ChaCha8Rng, n: usize, empty: bool) -> Case {
    let count = random.random_range(n + 1..12 * n + 2);
    let center = vector(random, n) * 0.9;
    let radius = magnitude(random, -7.0, -1.0);
    let mut rows = DMatrix::zeros(n + count, n);
    let (mut lower, mut upper) = (DVector::zeros(n + count), DVector::zeros(n + count));
    for i in 0..n {
        rows[(i, i)] = 1.0;
        (lower[i], upper[i]) = (-1.0, 1.0);
    }
    let mut sum = vector(random, n) * 0.0;
    for i in n..n + count {
        let mut normal = vector(random, n);
        if i > n && chance(random, 0.3) {
            let source = random.random_range(n..i);
            normal = normal * magnitude(random, -6.0, -1.0) + rows.row(source).transpose();
        }
        normal.normalize_mut();
        // The last of those that touch the ball closes it: weights add up to a zero normal.
        if i + 1 == n + count {
            normal = -&sum;
        } else if i < 2 * n {
            sum += &normal * random.random_range(0.1..1.0);
        }
        let slack = if i < 2 * n || i + 1 == n + count { 0.0 } else { gap(random) };
        let touch = if empty { -radius } else { radius };
        let room = if slack > 0.0 { slack } else { touch * normal.norm() };
        lower[i] = f64::NEG_INFINITY;
        upper[i] = normal.dot(&center) + room;
        rows.set_row(i, &normal.transpose());
    }
    let f = vector(random, n);
    let problem = Problem { hessian: DMatrix::identity(n, n), rows, f, lower, upper };
    let truth = if empty { Truth::Infeasible } else { Truth::Feasible };
    Case { kind: "", problem, compliance: vec![0.0; n + count], truth }
}

/// The same program in units that are up to 1e8 apart.
fn rescaled(random: &mut ChaCha8Rng, case: Case) -> Case {
    let scales = |random: &mut ChaCha8Rng, count: usize| {
        DVector::from_fn(count, |_, _| magnitude(random, -4.0, 4.0))
    };
    let (columns, rows) = (scales(random, case.problem.n()), scales(random, case.problem.m()));
    let truth = match case.truth {
        Truth::Solution(x, room) => Truth::Solution(x.component_mul(&columns), room),
        other => other,
    };
    Case { problem: case.problem.rescaled(&columns, &rows), truth, ..case }
}
