//! Everything that crosses a process boundary, and nothing else.
//!
//! * [`topics`] is the floor plan: one line per topic, from which ports, recorder, command line and
//!   documentation are derived. Open it first.
//! * One file per group of arrows holds the sample types: [`sensors`], [`estimate`], [`guidance`],
//!   [`control`], [`actuation`], [`disturbance`], [`order`], [`trip`],
//!   [`supervision`], [`loops`].
//! * [`slots`] has the roles whose process can be exchanged in flight, and what distinguishes them.
//! * [`time`] converts between seconds and nanoseconds.
//! * [`wire`] describes a sample's layout to readers (field names, kinds, offsets) and hashes it, so
//!   that two builds which disagree about a type refuse each other.
//!
//! Conventions: SI units named in the field, world frame ENU (`_w_`), body frame FLU (`_b_`),
//! Hamilton quaternions `q_wb` (body to world) with `w >= 0`.

#![warn(missing_docs)]

// Samples declared here name this crate as those do that other crates declare.
extern crate self as shared_types;

pub mod actuation;
pub mod control;
pub mod disturbance;
pub mod estimate;
pub mod guidance;
pub mod header;
pub mod loops;
mod macros;
pub mod order;
pub mod sensors;
pub mod slots;
pub mod supervision;
pub mod time;
pub mod topics;
pub mod trip;
pub mod wire;

pub use actuation::{ActuatorState, AppliedCommand, GateMode, Truth};
/// For [`sample!`], which other crates use without knowing what it derives.
#[doc(hidden)]
pub use bytemuck;
pub use control::{
    AppliedSetpoint, AttitudeReport, AttitudeSetpoint, BoundedInput, ControllerReport,
    PositionInput, PositionReport, SolveReport, SolveStatus, WrenchCommand,
};
pub use disturbance::Disturbance;
pub use estimate::StateEstimate;
pub use guidance::{MorphCommand, Reference, ReferencePoint};
pub use header::{Flag, Header, Quaternion, Sample};
pub use loops::{Deviation, DeviationKind, LoopStats, Seating, SeatingKind};
pub use order::{
    AngleDiversion, DISTURBANCE_ORDERS, DisturbanceKind, DisturbanceOrder, GuidanceOrder,
    OrderedDisturbance, PositionDiversion,
};
pub use sensors::{Barometer, Imu, MorphAngle, PoseFix, RangeFinder};
pub use slots::{PerSlot, Slot, SlotSpec};
pub use supervision::{
    ClockMode, ClockRecord, Handover, Hello, NO_SEAT, NodeId, OwnerRecord, Progress,
    REGISTRY_LINES, Registry, RegistryEntry, Role, SEATS, Seat,
};
pub use topics::{Edge, Topic, TopicInfo, TopicVisitor};
pub use trip::{Trip, TripCause};
