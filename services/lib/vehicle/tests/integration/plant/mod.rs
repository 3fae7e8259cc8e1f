//! The plants against closed forms, invariants and one another.

mod common;
mod ground;
mod linear;
mod nonlinear;
