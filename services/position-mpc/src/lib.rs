//! Position MPC: reference and state estimate in, attitude setpoint out.
//!
//! [`PositionLaw`] is the pure law: no clock, no topic. Open `law.rs` next (one step, in order),
//! then `config.rs` (every number with its reason) and `thrust_vector.rs` (the inputs). Equation
//! numbers are those of Zhao et al., "Attitude Control for Morphing Quadrotor through Model
//! Predictive Control with Constraints".

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

pub mod component;
mod cone;
mod config;
mod law;
mod memory;
mod model;
pub mod settings;
mod takeover;
mod thrust_vector;
mod transport;

pub use component::PositionMpc;
pub use cone::TiltBound;
pub use config::{ConfigError, PositionLawConfig};
pub use controller::Setpoint;
pub use controller::preview::Landing;
pub use law::{Input, LawStatus, Output, PositionLaw, Refusal};
pub use memory::{Counters, Memory};
pub use mpc::{Basis, Horizon, MpcError, QpStatus, SolverKind};
