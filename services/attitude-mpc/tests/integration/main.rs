//! The attitude MPC: its law against the paper, in flight, and as a component.

#![allow(clippy::unwrap_used, reason = "a set-up that fails is a failed test")]

#[path = "../rig/mod.rs"]
mod rig;

mod attitude_step;
mod authority;
mod effort;
mod laguerre;
mod paper;
mod robustness;
mod state;
mod track;
