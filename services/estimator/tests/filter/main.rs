//! Claims about the whole filter, on seeded sensor streams along known trajectories.

#![expect(clippy::print_stdout, reason = "the numbers reached are what the tests are read for")]

mod consistency;
mod delay;
mod faults;
mod heights;
mod morph;
mod robustness;
mod world;
