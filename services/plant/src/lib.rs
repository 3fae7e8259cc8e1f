//! The simulated vehicle with its sensors and its actuation gate.

pub mod gate;
pub mod sensors;
