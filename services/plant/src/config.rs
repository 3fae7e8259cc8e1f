//! Everything a plant is built from.

use crate::gate::{Gate, GateConfig, GateError, UnprovenRange};
use crate::sensors::SensorConfigs;
use nalgebra::Vector3;
use thiserror::Error;
use vehicle::{MorphAngle, RigidBodyState, VehicleParameters, Wrench};

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

/// How a vehicle moves at the start; at rest and at trim by default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Velocity \[m/s\].
    pub velocity_w_m_s: Vector3<f64>,
    /// Roll of the intrinsic z-y-x angles \[rad\].
    pub roll_rad: f64,
    /// Pitch \[rad\].
    pub pitch_rad: f64,
    /// Body rate \[rad/s\].
    pub body_rate_b_rad_s: Vector3<f64>,
    /// β̇ \[rad/s\].
    pub morph_rate_rad_s: f64,
    /// Thrust of each rotor, and what was last asked of it \[N\]; a quarter of the weight by default.
    pub rotor_thrust_n: Option<[f64; 4]>,
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            velocity_w_m_s: Vector3::zeros(),
            roll_rad: 0.0,
            pitch_rad: 0.0,
            body_rate_b_rad_s: Vector3::zeros(),
            morph_rate_rad_s: 0.0,
            rotor_thrust_n: None,
        }
    }
}

/// Everything a plant needs to be built.
#[derive(Debug, Clone)]
pub struct PlantConfig {
    /// The vehicle as it really is.
    pub vehicle: VehicleParameters,
    /// Equations of motion.
    pub model: ModelKind,
    pub sensors: SensorConfigs,
    /// Actuation gate.
    pub gate: GateConfig,
    /// What an owner that has not proven itself may ask for; none if no owner is watched, or if the slot's own laws
    /// may ask for as much as the rotors give.
    pub unproven: Option<UnprovenRange>,
    /// Start position \[m\].
    pub position_w_m: Vector3<f64>,
    /// Start heading \[rad\].
    pub yaw_rad: f64,
    /// Start morph angle.
    pub morph_angle: MorphAngle,
    /// Motion at the start.
    pub motion: Motion,
    /// Seed of all sensors.
    pub seed: u64,
}

impl PlantConfig {
    /// Where the vehicle is at the start, and how it moves.
    pub(crate) fn initial_state(&self) -> RigidBodyState {
        let hover = RigidBodyState::hover(&self.vehicle, self.position_w_m, self.morph_angle);
        let motion = &self.motion;
        let gamma_rad = Vector3::new(motion.roll_rad, motion.pitch_rad, self.yaw_rad);
        RigidBodyState {
            q_wb: vehicle::quaternion_from_euler(&gamma_rad),
            velocity_w: motion.velocity_w_m_s,
            omega_b: motion.body_rate_b_rad_s,
            beta_rate_rad_s: motion.morph_rate_rad_s,
            rotor_thrust_n: motion.rotor_thrust_n.unwrap_or(hover.rotor_thrust_n),
            ..hover
        }
    }

    /// The gate of a vehicle in this state: one that moves knows what is up and what was last commanded.
    pub(crate) fn initial_gate(&self, state: &RigidBodyState) -> Result<Gate, GateError> {
        let mut gate = Gate::new(&self.gate, &self.vehicle)?;
        if self.motion == Motion::default() {
            return Ok(gate);
        }
        let mut memory = gate.memory();
        memory.up_b = state.q_wb.inverse_transform_vector(&Vector3::z()).into();
        memory.rate_b_rad_s = state.omega_b.into();
        memory.morph_angle_rad = state.beta.rad();
        if let Some(thrusts_n) = &self.motion.rotor_thrust_n {
            let Wrench { thrust_n, torque_b_nm } =
                self.vehicle.allocator(state.beta).wrench(thrusts_n);
            memory.wrench = [thrust_n, torque_b_nm.x, torque_b_nm.y, torque_b_nm.z];
        }
        gate.restore(&memory);
        Ok(gate)
    }
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
