//! Attitude LQR: attitude setpoint and state estimate in, wrench command out.
//!
//! The prediction model of the attitude MPC (rotor lag and command delay included) under a quadratic
//! cost over an endless horizon, without constraints: what remains of model predictive control if
//! bounds are left to clipping. [`LqrLaw`] is the pure law; open `law.rs` next (one step), then
//! `design.rs` (model, cost, gains over the morph angle), `riccati.rs` and `settings.rs` (every number
//! with its reason). \[Kwakernaak, Sivan\] is the textbook; equation numbers are those of \[Zhao\].

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

mod design;
mod law;
mod riccati;
pub mod settings;

pub use controller::OutOfRange;
pub use controller::attitude::{AttitudeController, AttitudeLoop, Timing};
pub use design::{GainTable, LqrConfig, STATES};
pub use law::{LqrError, LqrLaw, Memory};
pub use riccati::{doubling, gain};

/// The service.
pub type AttitudeLqr = AttitudeController<LqrLaw>;
