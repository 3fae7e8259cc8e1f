//! The receding horizon: predict, solve, apply the first move.

use nalgebra::{DMatrix, DVector, SVector};
use qp::{ActiveSet, Hildreth, HildrethSettings, QpOutcome, QpSolver, QpStatus, Settings};

use crate::constraints::{Coupled, FirstMove};
use crate::response::{AxisResponse, STATE};
use crate::rows::{Ahead, Limits, Rows, Step};
use crate::sides::{PackedSides, pack, unpack};
use crate::{Design, MpcError};

/// Which solver answers the quadratic program (16).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
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
                let settings = Settings { max_work: Some(MAX_WORK), ..Settings::default() };
                return Ok(Box::new(ActiveSet::new(moves, rows, settings)?));
            }
            Self::Hildreth => HildrethSettings::textbook(),
            Self::HildrethConverged => {
                // With soft rows a row has an entry of its own beside those of the moves.
                let sweep = 2 * rows.max(1) as u64 * (moves + rows) as u64;
                let sweeps = u32::try_from(MAX_WORK / sweep).unwrap_or(u32::MAX);
                let converged = HildrethSettings::converged();
                let most = converged.max_sweeps.min(sweeps);
                let least = HildrethSettings::textbook().max_sweeps;
                HildrethSettings { max_sweeps: most.max(least), ..converged }
            }
        };
        Ok(Box::new(Hildreth::new(moves, rows, settings)?))
    }
}

/// Multiply-adds of one solve, some tens of milliseconds of one core: how many changes of the working
/// set or sweeps that is falls with the size of the program. Those that fly need a hundredth; a
/// process that computes for seconds is taken for one that hangs.
const MAX_WORK: u64 = 40_000_000;

/// Violation of a soft bound, relative to half of what lies between it and its counterpart, from
/// which it counts.
const YIELDED: f64 = 1e-6;

/// Price of leaving a state bound that cannot be kept, over that of an output error of weight 1.
const FALLBACK_PENALTY: f64 = 1e3;

/// What the law knows at sample k, axis by axis. Inputs are in the units the law chose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured<const N: usize> {
    /// y(k).
    pub output: SVector<f64, N>,
    /// y(k) − y(k−1).
    pub output_increment: SVector<f64, N>,
    /// y'(k); used by bounds on the rate only.
    pub rate: SVector<f64, N>,
    /// y'(k) − y'(k−1).
    pub rate_increment: SVector<f64, N>,
    /// a(k) − a(k−1), the actuator.
    pub actuator_increment: SVector<f64, N>,
    /// u(k−1) − u(k−2), as applied.
    pub input_increment: SVector<f64, N>,
    /// u(k−1), as applied.
    pub u_previous: SVector<f64, N>,
}

/// What the schedule decides at sample k. Where neither changes, nothing is factored anew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operating<const N: usize> {
    /// g of y'' = g a, per unit of input; not 0.
    pub gain: SVector<f64, N>,
    /// Diagonal of W on increments; unit (output unit / input unit)².
    pub weight: SVector<f64, N>,
}

/// The first move and how it came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move<const N: usize> {
    /// u(k) = u(k−1) + Δu(k), always finite and within the hard bounds.
    pub u: SVector<f64, N>,
    /// Δu(k), after clipping.
    pub du: SVector<f64, N>,
    /// How far the bound on Δu(k) had to give way because the level bounds shrank.
    pub relaxation: SVector<f64, N>,
    /// How far the solver's own Δu(k) was outside its bounds, before clipping.
    pub violation: f64,
    /// The solver's verdict.
    pub status: QpStatus,
    /// Changes of the working set, or sweeps.
    pub iterations: u32,
    /// Rows at a bound.
    pub active: u32,
    /// Soft rows beyond their bound, by more than a millionth of what it allows.
    pub yielded: u32,
}

impl<const N: usize> Move<N> {
    /// True if the move is not the optimum but what clipping left of an unfinished answer.
    #[must_use]
    pub fn is_fallback(&self) -> bool {
        self.status != QpStatus::Solved
    }
}

/// The program min ½ xᵀ ζ x + ηᵀ x, lower <= A x <= upper, with x the coefficients of each input's
/// functions, input after input.
#[derive(Debug, Clone, Copy)]
pub struct Program<'a> {
    /// ζ, square.
    pub zeta: &'a DMatrix<f64>,
    /// η.
    pub eta: &'a DVector<f64>,
    /// A: levels, increments, coupled rows, outputs, rates, each by time.
    pub rows: &'a DMatrix<f64>,
    /// Lower bounds of the rows.
    pub lower: &'a DVector<f64>,
    /// Upper bounds of the rows.
    pub upper: &'a DVector<f64>,
}

/// An incremental MPC of `N` axes that share nothing but constraints.
///
/// Its whole evolving memory is the solver's working set; the rest is a function of the arguments
/// of a step, so that a restored instance continues bit for bit.
#[derive(Debug)]
pub struct IncrementalMpc<const N: usize> {
    axes: [AxisResponse; N],
    rows: Rows<N>,
    /// What the matrices were made for; `None` if for a changing gain, or not at all.
    operating: Option<Operating<N>>,
    /// The axes are those of a changing gain.
    varied: bool,
    /// The solver has A.
    rows_taken: bool,
    matrices_accepted: bool,
    errors: Vec<SVector<f64, N>>,
    zeta: DMatrix<f64>,
    a: DMatrix<f64>,
    eta: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    compliance: Vec<f64>,
    sides: Vec<i8>,
    solver: Box<dyn QpSolver>,
}

impl<const N: usize> IncrementalMpc<N> {
    /// Reserves all memory and computes the responses of the axes.
    ///
    /// # Errors
    /// A number outside its range, or more rows than [`PackedSides`] holds.
    pub fn new(design: &Design<N>, solver: SolverKind) -> Result<Self, MpcError> {
        design.check()?;
        let rows = Rows::new(design);
        let count = rows.count();
        let horizon = design.horizon;
        let axes = core::array::from_fn(|i| {
            let axis = &design.axes[i];
            AxisResponse::new(axis, horizon.prediction, design.period_s)
        });
        let terms = design.axes.iter().map(|axis| axis.basis.terms()).sum();
        Ok(Self {
            axes,
            rows,
            operating: None,
            varied: false,
            rows_taken: false,
            matrices_accepted: false,
            errors: vec![SVector::zeros(); horizon.prediction],
            zeta: DMatrix::zeros(terms, terms),
            a: DMatrix::zeros(count, terms),
            eta: DVector::zeros(terms),
            lower: DVector::zeros(count),
            upper: DVector::zeros(count),
            compliance: vec![0.0; count],
            sides: vec![0; count],
            solver: solver.build(terms, count)?,
        })
    }

    /// Solves (16) and returns the first move.
    ///
    /// `reference(j)` is the desired output at k+j, j in 1..=Np; `ahead` describes how gains and
    /// limits go on, if they do not stay as they are. Whatever the solver's verdict, the move is
    /// finite and within the hard limits, as long as these and u(k−1) are finite.
    pub fn step(
        &mut self,
        now: &Measured<N>,
        operating: &Operating<N>,
        reference: impl Fn(usize) -> SVector<f64, N>,
        limits: &Limits<'_, N>,
        ahead: Option<&Ahead<'_, N>>,
    ) -> Move<N> {
        let mut bounds = limits.inputs;
        if self.rows.has_soft_levels() {
            bounds.u_min.fill(f64::NEG_INFINITY);
            bounds.u_max.fill(f64::INFINITY);
        }
        if !self.rows.has_hard_increments() {
            bounds.du_max.fill(f64::INFINITY);
        }
        let coupled = if self.rows.has_hard_coupled() { limits.coupled } else { Coupled::NONE };
        let now = &Measured { u_previous: bounds.with_rounding_taken_off(&now.u_previous), ..*now };
        let first = FirstMove::new(&bounds, &coupled, &now.u_previous);

        self.prepare(operating, ahead);
        self.gradient(now, operating, &reference, ahead);
        let z = core::array::from_fn(|i| increments(now, operating, i));
        let step = Step { limits, first: &first, now, gain: &operating.gain, z: &z, ahead };
        let (lower, upper) = (self.lower.as_mut_slice(), self.upper.as_mut_slice());
        self.rows.fill(&step, &mut self.axes, lower, upper);

        let QpOutcome { status, iterations, active } = if self.matrices_accepted {
            self.solver.solve(&self.eta, &self.lower, &self.upper)
        } else {
            QpOutcome { status: QpStatus::NotFinite, iterations: 0, active: 0 }
        };
        let usable = match status {
            QpStatus::Solved => true,
            QpStatus::Infeasible => self.solve_with_soft_state_bounds(&operating.gain),
            QpStatus::IterationLimit => {
                self.solve_with_soft_state_bounds(&operating.gain);
                true
            }
            QpStatus::NotFinite => false,
        };
        let raw = if usable { self.first_increment() } else { SVector::zeros() };
        let wanted = now.u_previous + raw;
        let outside = (first.lower - raw).sup(&(raw - first.upper)).max();
        let violation = outside.max(coupled.excess(&wanted)).max(0.0);
        // Rounding of the sum may leave a level bound by its last bit.
        let level = first.level(&raw, &now.u_previous, &coupled);
        let u = level.sup(&bounds.u_min).inf(&bounds.u_max);
        let (du, relaxation) = (u - now.u_previous, first.relaxation);
        let yielded = if usable && self.rows.has_soft() { self.yielded() } else { 0 };
        Move { u, du, relaxation, violation, status, iterations, active, yielded }
    }

    /// Soft rows that the solution leaves: a row at its bound misses it by compliance times
    /// multiplier.
    fn yielded(&self) -> u32 {
        let bounds = self.lower.iter().zip(&self.upper);
        let rows = self.compliance.iter().zip(self.solver.multipliers()).zip(bounds);
        rows.fold(0, |count, ((compliance, multiplier), (lower, upper))| {
            let slack = compliance * multiplier.abs();
            count + u32::from(slack > 0.0 && slack > YIELDED * 0.5 * (upper - lower))
        })
    }

    /// A state that no input can bring within its bounds in time, or that it takes too long to bring
    /// there, must not stop the input: solves once more with these bounds soft. False if there was nothing to soften or that failed too.
    fn solve_with_soft_state_bounds(&mut self, gain: &SVector<f64, N>) -> bool {
        if !self.rows.yield_states(Some(FALLBACK_PENALTY), gain, &mut self.compliance) {
            return false;
        }
        let softened = self.solver.set_compliance(&self.compliance);
        let outcome = self.solver.solve(&self.eta, &self.lower, &self.upper);
        self.rows.yield_states(None, gain, &mut self.compliance);
        let hardened = self.solver.set_compliance(&self.compliance);
        self.matrices_accepted = hardened.is_ok();
        softened.is_ok() && matches!(outcome.status, QpStatus::Solved | QpStatus::IterationLimit)
    }

    /// Brings the matrices to this step's gains and weights; nothing if they have not changed.
    fn prepare(&mut self, operating: &Operating<N>, ahead: Option<&Ahead<'_, N>>) {
        if ahead.is_none() && self.operating.as_ref() == Some(operating) {
            return;
        }
        let varying = ahead.is_some();
        if varying || self.varied {
            for (i, axis) in self.axes.iter_mut().enumerate() {
                match ahead {
                    Some(ahead) => axis.vary(|j| ahead.gain[j][i]),
                    None => axis.vary(|_| 1.0),
                }
            }
        }
        let mut at = 0;
        for (i, axis) in self.axes.iter().enumerate() {
            axis.hessian(operating.gain[i], operating.weight[i], at, &mut self.zeta);
            at += axis.terms;
        }
        let rows_change = (varying || self.varied) && self.rows.vary();
        let taken = if rows_change || !self.rows_taken {
            let coupling =
                |m: usize| ahead.map_or(SVector::repeat(1.0), |ahead| *ahead.coupling_at(m));
            self.rows.write(&self.axes, coupling, &mut self.a);
            let taken = self.solver.set_matrices(&self.zeta, &self.a);
            self.rows_taken = taken.is_ok();
            taken
        } else {
            self.solver.set_hessian(&self.zeta)
        };
        let soft = self.rows.compliance(&operating.gain, &operating.weight, &mut self.compliance);
        let soft = if soft { self.solver.set_compliance(&self.compliance) } else { Ok(()) };
        self.matrices_accepted = taken.is_ok() && soft.is_ok();
        self.varied = varying;
        self.operating = (self.matrices_accepted && !varying).then_some(*operating);
    }

    fn gradient(
        &mut self,
        now: &Measured<N>,
        operating: &Operating<N>,
        reference: &impl Fn(usize) -> SVector<f64, N>,
        ahead: Option<&Ahead<'_, N>>,
    ) {
        for (j, error) in self.errors.iter_mut().enumerate() {
            *error = now.output - reference(j + 1);
        }
        let eta = self.eta.as_mut_slice();
        let mut at = 0;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let (gain, z) = (operating.gain[i], increments(now, operating, i));
            let errors = self.errors.iter().map(|error| error[i]);
            let eta = &mut eta[at..at + axis.terms];
            match ahead {
                Some(ahead) => axis.gradient_varied(gain, errors, &z, |j| ahead.gain[j][i], eta),
                None => axis.gradient(gain, errors, &z, eta),
            }
            at += axis.terms;
        }
    }

    /// Δu(k) = L(0)ᵀ η of each input.
    fn first_increment(&self) -> SVector<f64, N> {
        let solution = self.solver.solution();
        let mut at = 0;
        SVector::from_fn(|i, _| {
            let axis = &self.axes[i];
            let own = &solution.as_slice()[at..at + axis.terms];
            at += axis.terms;
            axis.moves.iter().zip(own).map(|(l, eta)| l * eta).sum()
        })
    }

    /// Which bound each row was held at, for the law's memory.
    pub fn pack_working_set(&self, packed: &mut PackedSides) {
        pack(self.solver.working_set(), packed);
    }

    /// Warm-starts the next solve and forgets the matrices, as after a restore.
    ///
    /// # Errors
    /// A set that no solver can have; the old one then stays.
    pub fn restore(&mut self, packed: &PackedSides) -> Result<(), MpcError> {
        unpack(packed, &mut self.sides);
        self.solver.set_working_set(&self.sides)?;
        self.operating = None;
        Ok(())
    }

    /// The program (16) as last solved, for study and benchmarks.
    #[must_use]
    pub fn program(&self) -> Program<'_> {
        Program {
            zeta: &self.zeta,
            eta: &self.eta,
            rows: &self.a,
            lower: &self.lower,
            upper: &self.upper,
        }
    }

    /// The unknowns of (16) as last solved.
    #[must_use]
    pub fn solution(&self) -> &DVector<f64> {
        self.solver.solution()
    }
}

/// z(0) of an axis: increments of output, rate, actuator and input, the last two times the gain.
fn increments<const N: usize>(
    now: &Measured<N>,
    operating: &Operating<N>,
    i: usize,
) -> [f64; STATE] {
    let gain = operating.gain[i];
    [
        now.output_increment[i],
        now.rate_increment[i],
        gain * now.actuator_increment[i],
        gain * now.input_increment[i],
    ]
}
