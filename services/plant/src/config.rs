//! Everything a plant is built from.

use crate::gate::GateConfig;
use crate::sensors::{ImuConfig, MorphEncoderConfig, PoseFixConfig};
use nalgebra::Vector3;
use thiserror::Error;
use vehicle::{MorphAngle, VehicleParameters};

/// Which equations of motion to integrate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelKind {
    /// Eqs. (1), (2), (4), (5) with rotor lag, drag, servo and ground.
    Nonlinear {
        /// Whether there is a ground at z = 0.
        ground: bool,
    },
    /// The paper's linear model, eqs. (3) and (6); it takes the wrench itself.
    Linear,
}

/// Everything a plant needs to be built.
#[derive(Debug, Clone)]
pub struct PlantConfig {
    /// The vehicle as it really is.
    pub vehicle: VehicleParameters,
    /// Equations of motion.
    pub model: ModelKind,
    /// Inertial sensor.
    pub imu: ImuConfig,
    /// Pose tracker.
    pub pose_fix: PoseFixConfig,
    /// Morph encoder.
    pub morph_encoder: MorphEncoderConfig,
    /// Actuation gate.
    pub gate: GateConfig,
    /// Start position \[m\], at hover.
    pub position_w_m: Vector3<f64>,
    /// Start heading \[rad\].
    pub yaw_rad: f64,
    /// Start morph angle.
    pub morph_angle: MorphAngle,
    /// Seed of all sensors.
    pub seed: u64,
}

/// Why a plant cannot be built.
#[derive(Debug, Error)]
pub enum PlantError {
    /// The vehicle's numbers are impossible.
    #[error(transparent)]
    Vehicle(#[from] vehicle::ParameterError),
    /// A sensor's numbers are impossible.
    #[error(transparent)]
    Sensor(#[from] crate::sensors::SensorError),
    /// The gate's numbers are impossible.
    #[error(transparent)]
    Gate(#[from] crate::gate::GateError),
}
