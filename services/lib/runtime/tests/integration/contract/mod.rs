//! The rules of one component: what its inputs mean, what its state holds, when it may not run.

mod deviations;
mod inputs;
mod state;
mod wiring;
