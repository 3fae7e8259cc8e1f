//! The receding horizon: predict, solve, apply the first move.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use qp::{ActiveSet, Hildreth, HildrethSettings, QpOutcome, QpSolver, QpStatus, Settings};

use crate::constraints::{self, Bounds};
use crate::prediction::{StepResponse, free_errors};
use crate::{Horizon, Model, MpcError, Weights};

/// Which solver answers the quadratic program (16).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SolverKind {
    /// Exact and bounded: the one to fly.
    #[default]
    ActiveSet,
    /// The paper's (17) with the textbook's 38 sweeps, whatever accuracy they reach.
    Hildreth,
    /// The paper's (17), swept until it stops moving: for comparison, not for flight.
    HildrethConverged,
}

impl SolverKind {
    fn build(self, moves: usize, rows: usize) -> Result<Box<dyn QpSolver>, MpcError> {
        let settings = match self {
            Self::ActiveSet => {
                return Ok(Box::new(ActiveSet::new(moves, rows, Settings::default())?));
            }
            Self::Hildreth => HildrethSettings::textbook(),
            Self::HildrethConverged => HildrethSettings::converged(),
        };
        Ok(Box::new(Hildreth::new(moves, rows, settings)?))
    }
}

/// What the law knows at sample k.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured<const NX: usize, const NU: usize, const NY: usize> {
    /// Δx(k) = x(k) - x(k-1).
    pub state_increment: SVector<f64, NX>,
    /// y(k).
    pub output: SVector<f64, NY>,
    /// u(k-1), as applied.
    pub u_previous: SVector<f64, NU>,
}

/// The first move and how it came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move<const NU: usize> {
    /// u(k) = u(k-1) + Δu(k), always finite and within the bounds.
    pub u: SVector<f64, NU>,
    /// Δu(k), after clipping.
    pub du: SVector<f64, NU>,
    /// How far the bound on Δu(k) had to give way, see [`Bounds::first_move`].
    pub relaxation: SVector<f64, NU>,
    /// How far the solver's own Δu(k) was outside its bounds, before clipping.
    pub violation: f64,
    /// The solver's verdict.
    pub status: QpStatus,
    /// Changes of the working set, or sweeps.
    pub iterations: u32,
    /// Rows at a bound.
    pub active: u32,
}

/// The program min ½ xᵀ ζ x + ηᵀ x, lower <= A x <= upper, with x = ΔU by time, then input.
#[derive(Debug, Clone, Copy)]
pub struct Program<'a> {
    /// ζ, square of NU Nc.
    pub zeta: &'a DMatrix<f64>,
    /// η, NU Nc.
    pub eta: &'a DVector<f64>,
    /// A, NU (2 Nc - 1) by NU Nc: levels, then increments from the second move on.
    pub rows: &'a DMatrix<f64>,
    /// Lower bounds of the rows.
    pub lower: &'a DVector<f64>,
    /// Upper bounds of the rows.
    pub upper: &'a DVector<f64>,
}

impl<const NU: usize> Move<NU> {
    /// True if the move is not the optimum but what clipping left of an unfinished answer.
    #[must_use]
    pub fn is_fallback(&self) -> bool {
        self.status != QpStatus::Solved
    }
}

/// An incremental MPC with `NX` states, `NU` inputs and `NY` outputs.
///
/// Its whole evolving memory is the scheduling parameter and the solver's working set; the rest
/// is rebuilt from these, so that a restored instance continues bit for bit.
#[derive(Debug)]
pub struct IncrementalMpc<const NX: usize, const NU: usize, const NY: usize> {
    model: Model<NX, NU, NY>,
    weights: Weights<NU, NY>,
    scheduled: Option<f64>,
    response: StepResponse<NU, NY>,
    errors: Vec<SVector<f64, NY>>,
    zeta: DMatrix<f64>,
    rows: DMatrix<f64>,
    eta: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    solver: Box<dyn QpSolver>,
    matrices_accepted: bool,
}

impl<const NX: usize, const NU: usize, const NY: usize> IncrementalMpc<NX, NU, NY> {
    /// Reserves all memory. [`Self::schedule`] must supply a model before the first step.
    ///
    /// # Errors
    /// A horizon outside its range, or a shape the solver refuses.
    pub fn new(horizon: Horizon, solver: SolverKind) -> Result<Self, MpcError> {
        horizon.check()?;
        let moves = NU * horizon.control;
        let row_count = constraints::row_count(NU, horizon.control);
        Ok(Self {
            model: Model { a: SMatrix::zeros(), b: SMatrix::zeros(), c: SMatrix::zeros() },
            weights: Weights::on_increments(SVector::zeros()),
            scheduled: None,
            response: StepResponse::new(horizon.prediction),
            errors: vec![SVector::zeros(); horizon.prediction],
            zeta: DMatrix::zeros(moves, moves),
            rows: constraints::rows(NU, horizon.control),
            eta: DVector::zeros(moves),
            lower: DVector::zeros(row_count),
            upper: DVector::zeros(row_count),
            solver: solver.build(moves, row_count)?,
            matrices_accepted: false,
        })
    }

    /// Rebuilds prediction and cost if `parameter` moved by more than `tolerance` since the last
    /// rebuild (or if there was none); `at` gives model and weights there. True if it rebuilt.
    pub fn schedule(
        &mut self,
        parameter: f64,
        tolerance: f64,
        at: impl FnOnce(f64) -> (Model<NX, NU, NY>, Weights<NU, NY>),
    ) -> bool {
        if self.scheduled.is_some_and(|last| (parameter - last).abs() <= tolerance) {
            return false;
        }
        (self.model, self.weights) = at(parameter);
        self.scheduled = Some(parameter);
        self.response.rebuild(&self.model);
        self.response.hessian(&self.weights, &mut self.zeta);
        self.matrices_accepted = self.solver.set_matrices(&self.zeta, &self.rows).is_ok();
        true
    }

    /// Solves (16) and returns the first move.
    ///
    /// `reference(j)` is the desired output at k+j, j in 1..=Np. Whatever the solver's verdict,
    /// the move is finite and within `bounds`, as long as these and u(k-1) are finite.
    pub fn step(
        &mut self,
        now: &Measured<NX, NU, NY>,
        reference: impl Fn(usize) -> SVector<f64, NY>,
        bounds: &Bounds<NU>,
    ) -> Move<NU> {
        let u_previous = &now.u_previous;
        let first = bounds.first_move(u_previous);
        constraints::fill(bounds, &first, u_previous, &mut self.lower, &mut self.upper);
        let (increment, output) = (&now.state_increment, &now.output);
        free_errors(&self.model, increment, output, reference, &mut self.errors);
        self.response.gradient(&self.weights, &self.errors, &mut self.eta);

        let QpOutcome { status, iterations, active } = self.solve();
        let raw: SVector<f64, NU> = match status {
            QpStatus::Solved | QpStatus::IterationLimit => {
                self.solver.solution().fixed_rows::<NU>(0).into_owned()
            }
            QpStatus::Infeasible | QpStatus::NotFinite => SVector::zeros(),
        };
        let violation = (first.lower - raw).sup(&(raw - first.upper)).max().max(0.0);
        let du = first.clip(&raw);
        // Rounding of the sum may leave a level bound by its last bit.
        let u = (u_previous + du).sup(&bounds.u_min).inf(&bounds.u_max);
        Move { u, du, relaxation: first.relaxation, violation, status, iterations, active }
    }

    fn solve(&mut self) -> QpOutcome {
        if !self.matrices_accepted {
            return QpOutcome { status: QpStatus::NotFinite, iterations: 0, active: 0 };
        }
        self.solver.solve(&self.eta, &self.lower, &self.upper)
    }

    /// The parameter of the last rebuild.
    #[must_use]
    pub fn scheduled(&self) -> Option<f64> {
        self.scheduled
    }

    /// Forces the next [`Self::schedule`] to rebuild, as after a restore.
    pub fn forget_schedule(&mut self) {
        self.scheduled = None;
    }

    /// Which bound each row is held at, for the law's memory. Length NU (2 Nc - 1).
    #[must_use]
    pub fn working_set(&self) -> &[i8] {
        self.solver.working_set()
    }

    /// Warm-starts the next solve; the length is that of [`Self::working_set`].
    ///
    /// # Errors
    /// A set that is not of this solver; the old one then stays.
    pub fn set_working_set(&mut self, set: &[i8]) -> Result<(), MpcError> {
        Ok(self.solver.set_working_set(set)?)
    }

    /// The program (16) as last solved, for study and benchmarks.
    #[must_use]
    pub fn program(&self) -> Program<'_> {
        Program {
            zeta: &self.zeta,
            eta: &self.eta,
            rows: &self.rows,
            lower: &self.lower,
            upper: &self.upper,
        }
    }
}
