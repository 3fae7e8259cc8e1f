//! The attitude LQR: its gains, and its law in flight.

#![allow(clippy::unwrap_used, reason = "a set-up that fails is a failed test")]

#[path = "../loops/mod.rs"]
mod loops;

mod flight;
mod riccati;
