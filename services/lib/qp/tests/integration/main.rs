//! The solvers against references, certificates and recorded programs.

#[path = "../sequences/mod.rs"]
mod sequences;
#[path = "../support/mod.rs"]
mod support;

mod against_reference;
mod closed_loop;
mod contract;
mod hildreth;
mod laws;
mod random;
mod soft;
