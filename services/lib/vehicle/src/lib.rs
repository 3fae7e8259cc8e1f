//! The morphing quadrotor: geometry, inertia, dynamics, control allocation.
//!
//! Four rotors sit on arms whose length and inertia follow one morph angle β. This crate holds the
//! physics that the plant integrates and that the controllers and the estimator model; it reads no
//! clock and no topic. World frame W is ENU, body frame B is FLU, `q_wb` is a Hamilton quaternion
//! that turns body vectors into world. Equation numbers refer to the paper that the vehicle is from.
//!
//! Start with [`VehicleParameters`], then [`Allocator`] (wrench to
//! rotors), [`PlantModel`] (what can be flown) and [`NonlinearModel`].

#![warn(missing_docs)]

mod actuators;
mod agility;
mod allocation;
mod attitude;
mod contact;
mod dynamics;
mod geometry;
mod integrator;
mod linear;
mod model;
mod nonlinear;
mod parameter_error;
mod parameters;
mod state;

pub use agility::Agility;
pub use allocation::{Allocation, Allocator, Wrench};
pub use attitude::{
    MAX_PITCH_RAD, body_rate_matrix, canonical, components, euler_from_quaternion,
    euler_rate_matrix, quaternion_from_euler, rotation, wrap_pi,
};
pub use contact::GroundContact;
pub use geometry::{Geometry, MorphAngle, Quadratic};
pub use linear::LinearModel;
pub use model::{Actuation, PlantInputs, PlantModel, StepStatus};
pub use nonlinear::{MAX_NONLINEAR_STEP_S, NonlinearModel};
pub use parameter_error::ParameterError;
pub use parameters::VehicleParameters;
pub use state::{Disturbance, MODEL_MEMORY_LEN, RigidBodyState, Truth};
