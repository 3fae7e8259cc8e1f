//! Position PID: reference and state estimate in, attitude setpoint out.
//!
//! A cascade per axis: position error to velocity set point, velocity error to acceleration, and from
//! there to thrust and tilt, with velocity and acceleration of the reference fed forward. [`PositionPidLaw`]
//! is the pure law; open `law.rs` next (one step), then `settings.rs` (every number with its reason).
//! Bounds are those of the position MPC.

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

mod component;
mod law;
pub mod settings;

pub use component::PositionPid;
pub use controller::preview::{Landing, Target};
pub use controller::{OutOfRange, Setpoint};
pub use law::{Input, Memory, Output, PositionPidConfig, PositionPidLaw};
