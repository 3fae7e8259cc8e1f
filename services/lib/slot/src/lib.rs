//! Which process commands a slot, and how command changes hands in flight: pure code, without clock, transport
//! or file, the same for the processes that fly and for the supervisor.
//!
//! A *slot* (position, attitude) has [`SEATS`] seats; one of them owns it. The supervisor writes
//! [`Record`]s, which name an owner, perhaps a fallback, and the instant from which they count.
//!
//! * [`record`]: the record and the authority it gives each writer. Open it first.
//! * [`consumer`]: which record is in effect, and the consumer's own move from owner to fallback.
//! * [`command_buffer`]: the commands of a consumer: what each may still be used for, and which one counts now.
//! * [`limiter`]: takes the step out of a change of kind.
//! * [`gate`]: whether a shadow may fly.
//! * [`supervisor`]: the state machine of a slot: events in, actions out.
//!
//! `tests/integration/model/` searches every interleaving of plant, controllers and launcher through this code.

#![warn(missing_docs)]

pub mod command_buffer;
pub mod consumer;
pub mod gate;
pub mod limiter;
pub mod record;
pub mod supervisor;

pub use command_buffer::{Choice, Command, CommandBuffer, CommandBufferMemory};
pub use consumer::{
    Consumer, ConsumerMemory, Counters, REJECTED_AFTER_TRIP_NS, Source, Taken, Tripped, Turn,
};
pub use gate::{Axis, Gate, GateFigures, GateLimits, Pair, Refusal};
pub use limiter::{Limiter, LimiterMemory};
pub use record::{Authority, Record, SEATS, Seat};
pub use supervisor::message;
pub use supervisor::{
    Action, Clock, Event, Fault, Instance, Now, Outcome, Program, Progress, Reason,
    RehearsalRefusal, Rehearsed, Report, Request, SlotConfig, SlotMachine, Step, SwapTerms, Target,
};
