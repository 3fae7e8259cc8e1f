//! What the control laws do over whole ranges of conditions, and the paper's own tests.
//!
//! [`controllers`] compares all that fill the slots; [`morphing`] flies the figure eight through ever faster sweeps;
//! [`stability`] maps where the attitude loop is stable; [`worst_case`] certifies with [`certificate`] how much work a
//! solve can be; [`random`] flies vehicles and weather that no model knows; [`timing`] makes loops late and reports
//! what they bear; [`tuning`] draws sets of numbers for the position MPC and gives their Pareto front; [`paper`]
//! reproduces the paper's tests. All are functions from a plan to data; reports make tables, pictures and files of it.
//! The commands `morphquad study` and `morphquad paper` are in the crate `cli`.

pub mod certificate;
pub mod controllers;
pub mod morphing;
pub mod paper;
pub mod random;
pub mod stability;
pub mod timing;
pub mod tuning;
pub mod worst_case;
