//! Attitude PID: attitude setpoint and state estimate in, wrench command out.
//!
//! A cascade per axis: angle error to rate set point, rate error to angular acceleration, times the
//! inertia at the measured morph angle. [`PidLaw`] is the pure law; open `law.rs` next (one step), then
//! `settings.rs` (every number with its reason). The rate loop is tuned by \[Skogestad\].

#![cfg_attr(test, allow(clippy::float_cmp, reason = "where bits must agree, bits are compared"))]

mod law;
pub mod settings;

pub use controller::OutOfRange;
pub use controller::attitude::{AttitudeController, AttitudeLoop, Timing};
pub use law::{Memory, PidConfig, PidLaw};

/// The service.
pub type AttitudePid = AttitudeController<PidLaw>;
