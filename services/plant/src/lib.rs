//! The simulated vehicle with its sensors and its actuation gate.
//!
//! [`component`] is the process (integrate, then look); [`gate`] decides which command reaches the
//! rotors; [`sensors`] turn truth into readings. The plant is the only owner of the truth: it
//! leaves for the recorder and for nothing else.

pub mod component;
mod config;
mod effects;
pub mod gate;
mod memory;
pub mod ports;
pub mod sensors;
pub mod settings;

pub use component::Plant;
pub use config::{ModelKind, Motion, PlantConfig, PlantError};
pub use memory::{InEffect, PlantMemory};
