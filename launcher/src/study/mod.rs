//! `morphquad study`: what the control laws do over whole ranges of conditions.
//!
//! [`controllers`] compares all that fill the slots; [`morphing`] flies the figure eight through ever faster sweeps; [`stability`] maps where the
//! attitude loop is stable; [`worst_case`] certifies how much work a solve can be. All are functions
//! from a plan to data; reports make tables, pictures and files of it, and the command line is in
//! `cli/study.rs`.

pub mod controllers;
mod fan_out;
pub mod morphing;
pub mod stability;
pub mod worst_case;

pub use fan_out::{Progress, fan_out};
