//! Small dense strictly convex quadratic programs for model predictive control:
//!
//! `min 1/2 x'Hx + f'x` subject to `lower <= A x <= upper`.
//!
//! [`ActiveSet`] is the solver to fly; [`Hildreth`] is the paper's method, kept for comparison.
//! Both implement [`QpSolver`] (`solver.rs`, the file to open next). [`kkt_residuals`] judges an
//! answer independently of the solver that gave it.

#![warn(missing_docs)]

mod active_set;
mod goldfarb;
mod hildreth;
mod kkt;
mod linear;
mod real;
mod scaled;
mod solver;
mod work;

pub use active_set::{ActiveSet, Settings};
pub use hildreth::{Hildreth, HildrethSettings};
pub use kkt::{KktResiduals, kkt_residuals, soft_kkt_residuals};
pub use solver::{QpError, QpOutcome, QpSolver, QpStatus};
