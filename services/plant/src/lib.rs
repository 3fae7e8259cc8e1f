//! The simulated vehicle with its sensors and its actuation gate.

pub mod sensors;
