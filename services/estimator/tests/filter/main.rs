//! Claims about the whole filter, on seeded sensor streams along known trajectories.

mod consistency;
mod delay;
mod faults;
mod morph;
mod robustness;
mod world;
