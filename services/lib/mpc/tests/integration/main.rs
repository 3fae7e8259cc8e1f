//! The predictive controller against dense references.

#[path = "../common/mod.rs"]
mod common;

mod dense;
mod engine;
mod sets;
mod varying;
