//! The predictive controller against dense references.

#![allow(clippy::unwrap_used, reason = "a set-up that fails is a failed test")]

#[path = "../common/mod.rs"]
mod common;

mod dense;
mod engine;
mod sets;
mod varying;
