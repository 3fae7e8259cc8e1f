//! Everything an executable needs to be a process of a run.
//!
//! A controller of one's own is a [`runtime::Service`] and one line:
//!
//! ```no_run
//! # use host::{Config, Flight};
//! # use std::process::ExitCode;
//! # struct MyController;
//! # runtime::inputs! { pub struct Inputs { estimate: shared_types::StateEstimate = shared_types::topics::STATE_ESTIMATE } }
//! # runtime::outputs! { pub struct Outputs { command: shared_types::WrenchCommand = shared_types::topics::WRENCH_COMMAND } }
//! # shared_types::memory! { pub struct Memory { integral: f64 } }
//! # impl runtime::Service for MyController {
//! #     type Inputs = Inputs;
//! #     type Outputs = Outputs;
//! #     type Memory = Memory;
//! #     fn step(&mut self, _: u64, _: &Inputs, _: &mut Outputs) {}
//! #     fn memory(&self) -> Memory { Memory::default() }
//! #     fn restore(&mut self, _: &Memory) -> Result<(), String> { Ok(()) }
//! # }
//! # impl MyController {
//! #     fn new(_: &Flight, _: &Config) -> Result<Self, String> { Ok(Self) }
//! # }
//! fn main() -> ExitCode {
//!     host::controller("my-controller", |flight, config| MyController::new(flight, config))
//! }
//! ```
//!
//! The launcher starts it with [`PlaceArguments`] and has left a [`Flight`] in the run's folder;
//! [`Joined`] is a process between its start and its end. `morphquad new-controller` writes all of it.

#![warn(missing_docs)]

mod arguments;
mod config;
mod control_group;
mod controller;
mod error;
pub mod exit;
pub mod flight;
mod joined;
mod layout;
pub mod memory;
pub mod quota;
pub mod realtime;
mod staying;
pub mod tasks;
mod thread;

pub use arguments::PlaceArguments;
pub use config::Config;
pub use controller::controller;
pub use error::{BuildError, HostError, conclude};
pub use flight::Flight;
pub use joined::Joined;
pub use layout::{LAYOUT_ARGUMENT, layout_hash};
pub use staying::LOCKSTEP_GRACE_S;
pub use thread::{name_thread, stay_on};
