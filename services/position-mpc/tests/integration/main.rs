//! The position MPC: its law in flight, and as a component.

#![allow(clippy::unwrap_used, reason = "a set-up that fails is a failed test")]

#[path = "../cascade/mod.rs"]
mod cascade;

mod flight;
mod state;
mod track;
