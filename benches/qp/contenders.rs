//! The solvers in one form: what is prepared untimed, and the call that is timed.

use nalgebra::{DMatrix, DVector};
use qp::{ActiveSet, Hildreth, HildrethSettings, QpError, QpSolver, QpStatus, Settings};

use crate::peers::Clarabel;
use crate::series::{Series, Tick};

/// How one call ended.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Verdict {
    pub(crate) solved: bool,
    pub(crate) iterations: u32,
}

/// A solver under measurement.
pub(crate) trait Contender {
    /// Back to the start of a series: its first Hessian, nothing known of any solution.
    fn rewind(&mut self, series: &Series);
    /// Puts the data of a tick into the solver's own layout, where that needs more than a borrow.
    fn load(&mut self, series: &Series, tick: usize);
    /// The timed part: takes a new Hessian if there is one, and solves.
    fn run(&mut self, tick: &Tick) -> Verdict;
    /// Point and row multipliers of the last run.
    fn answer(&self) -> (DVector<f64>, DVector<f64>);
}

/// Name, and how to make one for a series.
pub(crate) type Entry = (&'static str, fn(&Series) -> Box<dyn Contender>);

/// Every solver, ours first.
pub(crate) const ALL: [Entry; 4] = [
    ("active-set", |series| {
        Box::new(Ours::new(series, ActiveSet::new(series.n(), series.m(), Settings::default())))
    }),
    ("clarabel", |_| Box::new(Clarabel::default())),
    ("hildreth-38", |series| Box::new(hildreth(series, HildrethSettings::textbook()))),
    ("hildreth", |series| {
        // The default million of sweeps would take hours on the hardest programs.
        let settings = HildrethSettings { max_sweeps: 20_000, ..HildrethSettings::converged() };
        Box::new(hildreth(series, settings))
    }),
];

fn hildreth(series: &Series, settings: HildrethSettings) -> Ours<Hildreth> {
    Ours::new(series, Hildreth::new(series.n(), series.m(), settings))
}

/// A solver of this project.
struct Ours<S> {
    solver: S,
    rows: DMatrix<f64>,
}

impl<S: QpSolver> Ours<S> {
    fn new(series: &Series, solver: Result<S, QpError>) -> Self {
        Self { solver: solver.expect("a series has variables"), rows: series.rows.clone() }
    }
}

impl<S: QpSolver> Contender for Ours<S> {
    fn rewind(&mut self, series: &Series) {
        let accepted = self.solver.set_matrices(&series.hessian, &self.rows);
        accepted.expect("every series is strictly convex");
        self.solver.clear();
    }

    fn load(&mut self, _series: &Series, _tick: usize) {}

    fn run(&mut self, tick: &Tick) -> Verdict {
        let taken = match &tick.hessian {
            Some(hessian) => self.solver.set_hessian(hessian).is_ok(),
            None => true,
        };
        let outcome = self.solver.solve(&tick.f, &tick.lower, &tick.upper);
        let solved = taken && outcome.status == QpStatus::Solved;
        Verdict { solved, iterations: outcome.iterations }
    }

    fn answer(&self) -> (DVector<f64>, DVector<f64>) {
        (self.solver.solution().clone(), self.solver.multipliers().clone())
    }
}

/// Does nothing: what is left is the harness.
pub(crate) struct Null;

impl Contender for Null {
    fn rewind(&mut self, _series: &Series) {}
    fn load(&mut self, _series: &Series, _tick: usize) {}
    fn run(&mut self, _tick: &Tick) -> Verdict {
        Verdict::default()
    }
    fn answer(&self) -> (DVector<f64>, DVector<f64>) {
        (DVector::zeros(0), DVector::zeros(0))
    }
}
