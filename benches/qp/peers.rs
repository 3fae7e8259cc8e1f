//! Public solvers that build from crates alone. Their data is laid out before the clock starts,
//! and what they can keep between ticks is kept.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};
use nalgebra::{DMatrix, DVector};

use crate::contenders::{Contender, Verdict};
use crate::series::{Series, Tick};

/// Two-sided rows as `side aᵢ'x <= side bound`, equalities first, infinite bounds left out.
#[derive(Debug, Default, PartialEq)]
struct Sides {
    /// Row and side, +1 upper or -1 lower.
    list: Vec<(usize, f64)>,
    equalities: usize,
}

impl Sides {
    fn of(tick: &Tick) -> Self {
        let (lower, upper) = (&tick.lower, &tick.upper);
        let equal = |i: usize| lower[i] >= upper[i];
        let mut list: Vec<_> = (0..lower.len()).filter(|&i| equal(i)).map(|i| (i, 1.0)).collect();
        let equalities = list.len();
        for i in (0..lower.len()).filter(|&i| !equal(i)) {
            if upper[i] < f64::INFINITY {
                list.push((i, 1.0));
            }
            if lower[i] > f64::NEG_INFINITY {
                list.push((i, -1.0));
            }
        }
        Self { list, equalities }
    }

    fn bounds(&self, tick: &Tick, bounds: &mut Vec<f64>) {
        bounds.clear();
        bounds.extend(
            self.list.iter().map(
                |&(i, side)| {
                    if side > 0.0 { tick.upper[i] } else { -tick.lower[i] }
                },
            ),
        );
    }

    fn matrix(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(self.list.len(), rows.ncols(), |k, j| {
            let (i, side) = self.list[k];
            side * rows[(i, j)]
        })
    }

    fn multipliers(&self, one_sided: &[f64], m: usize) -> DVector<f64> {
        let mut multipliers = DVector::zeros(m);
        for (&(i, side), value) in self.list.iter().zip(one_sided) {
            multipliers[i] += side * value;
        }
        multipliers
    }
}

/// An interior-point method at its default tolerances. It cannot start warm; the symbolic
/// factorisation is kept between ticks, and only numbers are updated.
#[derive(Default)]
pub(crate) struct Clarabel {
    solver: Option<DefaultSolver<f64>>,
    sides: Sides,
    bounds: Vec<f64>,
    gradient: Vec<f64>,
    /// The upper triangle of a new Hessian, by columns.
    triangle: Vec<f64>,
    m: usize,
}

impl Clarabel {
    fn build(&mut self, series: &Series, tick: usize) {
        // A changing Hessian may fill in later, so that all of its triangle is kept then.
        let zeros = series.varies();
        let p = upper_triangle(series.hessian_at(tick), zeros);
        let a = sparse(&self.sides.matrix(&series.rows), |_, _, value| value != 0.0);
        let cones = [
            ZeroConeT(self.sides.equalities),
            NonnegativeConeT(self.sides.list.len() - self.sides.equalities),
        ];
        let settings = DefaultSettings {
            verbose: false,
            presolve_enable: false,
            input_sparse_dropzeros: false,
            ..DefaultSettings::default()
        };
        let q = series.ticks[tick].f.as_slice();
        let solver = DefaultSolver::new(&p, q, &a, &self.bounds, &cones, settings);
        self.solver = Some(solver.expect("the shapes agree"));
        self.m = series.m();
    }
}

impl Contender for Clarabel {
    fn rewind(&mut self, series: &Series) {
        self.sides = Sides::of(&series.ticks[0]);
        self.sides.bounds(&series.ticks[0], &mut self.bounds);
        self.build(series, 0);
    }

    fn load(&mut self, series: &Series, tick: usize) {
        let sides = Sides::of(&series.ticks[tick]);
        sides.bounds(&series.ticks[tick], &mut self.bounds);
        if sides != self.sides {
            self.sides = sides;
            self.build(series, tick);
        }
        self.gradient.clear();
        self.gradient.extend(series.ticks[tick].f.iter());
        self.triangle.clear();
        if let Some(hessian) = &series.ticks[tick].hessian {
            for (j, column) in hessian.column_iter().enumerate() {
                self.triangle.extend(column.iter().take(j + 1));
            }
        }
    }

    fn run(&mut self, _tick: &Tick) -> Verdict {
        let Some(solver) = &mut self.solver else { return Verdict::default() };
        // An empty triangle means no change.
        let taken = solver.update_P(&self.triangle).is_ok()
            && solver.update_q(&self.gradient).is_ok()
            && solver.update_b(&self.bounds).is_ok();
        solver.solve();
        let solved = taken && solver.solution.status == SolverStatus::Solved;
        Verdict { solved, iterations: solver.solution.iterations }
    }

    fn answer(&self) -> (DVector<f64>, DVector<f64>) {
        let Some(solver) = &self.solver else { return (DVector::zeros(0), DVector::zeros(0)) };
        let multipliers = self.sides.multipliers(&solver.solution.z, self.m);
        (DVector::from_column_slice(&solver.solution.x), multipliers)
    }
}

fn upper_triangle(matrix: &DMatrix<f64>, zeros: bool) -> CscMatrix<f64> {
    sparse(matrix, |i, j, value| i <= j && (zeros || value != 0.0))
}

fn sparse(matrix: &DMatrix<f64>, keep: impl Fn(usize, usize, f64) -> bool) -> CscMatrix<f64> {
    let (rows, columns) = matrix.shape();
    let (mut starts, mut index, mut values) = (vec![0], Vec::new(), Vec::new());
    for (j, column) in matrix.column_iter().enumerate() {
        for (i, &value) in column.iter().enumerate().filter(|&(i, value)| keep(i, j, *value)) {
            index.push(i);
            values.push(value);
        }
        starts.push(index.len());
    }
    CscMatrix::new(rows, columns, starts, index, values)
}
