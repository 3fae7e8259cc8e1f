//! Many flights in this process: campaigns over seeds and a grid of keys, and branches of a recorded flight.

pub mod branch;
pub mod campaign;
