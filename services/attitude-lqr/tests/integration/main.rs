//! The attitude LQR: its gains, and its law in flight.

#[path = "../loops/mod.rs"]
mod loops;

mod flight;
mod riccati;
