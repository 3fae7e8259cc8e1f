//! The slots of a flight: which process commands them, which may take over and what is done when a process is lost.
//!
//! [`Slots`] runs the protocol of the crate `slot` for each slot of a flight and has [`Posts`] do what it decides:
//! processes under a supervisor, or components in one thread. Open `slots` for the events and decisions,
//! [`orders`] for what users ask for, [`child`] and [`post`] for the processes.

pub mod child;
mod drain;
mod last_stderr;
mod order_sinks;
pub mod orders;
mod output_pipe;
mod owners;
pub mod post;
mod post_event;
mod post_note;
mod rehearsal_spec;
mod relay;
pub mod services;
mod slots;
pub mod standard_error;
mod standstill;

pub use order_sinks::OrderSinks;
pub use owners::{RegistryWriter, SlotOwner};
pub use post_event::{FlightError, PostEvent};
pub use post_note::PostNote;
pub use rehearsal_spec::RehearsalSpec;
pub use slots::{
    FAULT, News, Posts, Script, Seen, SlotContext, SlotWatch, Slots, SwapEnd, SwapReport,
    write_table,
};
pub use standstill::Standstill;
