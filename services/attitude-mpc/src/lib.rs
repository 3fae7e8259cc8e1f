//! Attitude MPC: attitude setpoint and state estimate in, wrench command out.
//!
//! [`AttitudeLaw`] is the pure law: no clock, no topic. Open `law.rs` next (one step, in order),
//! then `config.rs` (every number with its reason) and `schedule.rs` (what changes with the
//! morph angle). Equation numbers are those of Zhao et al., "Attitude Control for Morphing
//! Quadrotor through Model Predictive Control with Constraints".

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

pub mod component;
mod config;
mod law;
mod memory;
mod preview;
mod ramp;
mod schedule;
pub mod settings;

pub use component::AttitudeMpc;
pub use config::{AttitudeLawConfig, ConfigError, HorizonChoice, TorqueBound};
pub use controller::Setpoint;
pub use law::{AttitudeLaw, Input, LawStatus, Output, Refusal};
pub use memory::{Counters, Memory};
pub use mpc::{Basis, Horizon, MpcError, QpStatus, SolverKind};
pub use preview::MorphPlan;
