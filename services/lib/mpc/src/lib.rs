//! Incremental constrained model predictive control of axes that share nothing but constraints.
//!
//! One engine, [`IncrementalMpc`], serves the attitude and the position law. A law gives it a
//! [`Design`] (horizons, actuators, bases of the moves, constraint sets) once, and gains, weights
//! and limits with each step; the engine embeds the integrator (10), predicts (11), condenses to
//! the quadratic program (16) and applies the first move.
//! Equation numbers are those of Zhao et al., "Attitude Control for Morphing Quadrotor through
//! Model Predictive Control with Constraints".
//!
//! Reads and writes nothing; no step allocates. Open `engine.rs` next, then `response.rs`
//! (prediction), `rows.rs` (constraints) and `model.rs` (what a law decides).

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

mod basis;
mod constraints;
mod discretization;
mod engine;
mod error;
mod model;
mod response;
mod rows;
mod sides;
mod status;

pub use basis::Basis;
pub use constraints::{Bounds, Coupled, FirstMove};
pub use discretization::LaggedAxis;
pub use engine::{IncrementalMpc, Measured, Move, Operating, Program, SolverKind};
pub use error::{MpcError, within};
pub use model::{AxisDesign, Constraints, Design, Hardness, Horizon};
pub use qp::QpStatus;
pub use rows::{Ahead, Limits};
pub use sides::{PackedSides, ROW_CAPACITY};
pub use status::LawStatus;
