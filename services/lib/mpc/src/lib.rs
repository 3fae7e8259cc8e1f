//! Incremental constrained model predictive control, for laws of any size.
//!
//! One engine, [`IncrementalMpc`], serves the attitude and the position law. A law gives it a
//! discrete model (9), weights (15) and bounds (13)-(14); the engine embeds the integrator (10),
//! predicts (11), condenses to the quadratic program (16) and applies the first move.
//! Equation numbers are those of Zhao et al., "Attitude Control for Morphing Quadrotor through
//! Model Predictive Control with Constraints".
//!
//! Reads and writes nothing; no step allocates. Open `engine.rs` next, then `prediction.rs`.

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

mod constraints;
mod discretization;
mod engine;
mod error;
mod model;
mod prediction;

pub use constraints::{Bounds, FirstMove};
pub use discretization::{LaggedAxis, double_integrator, lagged_double_integrator};
pub use engine::{IncrementalMpc, Measured, Move, Program, SolverKind};
pub use error::MpcError;
pub use model::{Horizon, Model, Weights};
pub use qp::QpStatus;
