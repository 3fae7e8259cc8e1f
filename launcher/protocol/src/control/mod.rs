//! The control plane: a running flight answers questions and takes orders from outside.
//!
//! One socket per run, `control.sock` in the run's folder, readable and writable by its user alone.
//! A request is a line of JSON ([`Request`]), its answer one line or more ([`Reply`]), the last of
//! which is known by its kind. [`server`] is the launcher's end, a thread that holds no part of the
//! flight; [`client`] is the other end; [`runs`] finds the run that is meant.

pub mod client;
mod conversation;
pub mod load;
pub mod protocol;
pub mod runs;
pub mod server;
pub mod status;
#[cfg(test)]
mod tests;

pub use protocol::{Reason, Refusal, Reply, Request};

/// Name of the socket in a run's folder.
pub const SOCKET: &str = "control.sock";
