//! Scripted wind, forces, torques and faults, and those ordered in flight.
//!
//! A script is a list of events; their sum at each step is the disturbance that the plant suffers.
//! The injector does not see the vehicle. Each event has its own noise, seeded by the scenario's
//! seed and the event's place in the script, so that appending an event leaves the others as they
//! were. Start with [`Event`] for what can be scripted, then [`Injector`].

pub mod component;
mod config;
mod event;
mod gust;
mod injector;
mod ordered;
mod player;
mod ranges;
pub mod settings;

pub use component::DisturbanceInjector;
pub use config::{InjectorConfig, InjectorError, MAX_EVENTS, MAX_RATE_HZ};
pub use event::{
    Constant, Event, Kick, Load, Payload, Pulse, Ramp, Rd, RotorEfficiency, Sine, Step, Wind,
};
pub use injector::{Injector, InjectorMemory};
pub use ordered::OrderedMemory;
pub use player::{Disturbance, EventMemory};
