//! The position MPC: its law in flight, and as a component.

#[path = "../cascade/mod.rs"]
mod cascade;

mod flight;
mod state;
mod track;
