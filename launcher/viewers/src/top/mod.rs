//! `morphquad top`: a running flight on one screen.
//!
//! What it shows comes from the control socket and from copies of topics that the launcher hands on, so
//! no loop has to do with it. [`gauges`] measures loops by what they publish, [`snapshot`] puts that beside
//! what the launcher reports, [`draw`] makes a screen of it, [`screen`] keeps the terminal and the keys.

pub mod draw;
pub mod gauges;
pub mod screen;
pub mod snapshot;
#[cfg(test)]
mod tests;

pub use snapshot::{Row, Snapshot};
