//! A service of the attitude slot around any law that answers a torque to a sample.
//!
//! Bounds are those of the attitude MPC: the torque that the rotors can give at the present thrust,
//! as level and as increment of one sample. Open `service.rs` for ports and judging of set points.

mod actuators;
mod service;

pub use actuators::{Actuators, Timing};
pub use service::{AttitudeController, Inputs, Outputs, applied, fresh_estimate, is_recovering};

use crate::Limited;
pub use crate::Setpoint;
use nalgebra::Vector3;
use runtime::arbiter::setpoints::{SetpointMemory, SetpointSlot};
use shared_types::wire::Wire;
use vehicle::{MorphAngle, VehicleParameters, euler_rate_matrix, wrap_pi};

/// A law of the attitude slot.
pub trait AttitudeLaw {
    /// Everything that evolves, [`Common`] included.
    type Memory: Wire;

    /// τ(k) \[N m\] in B, as the law would have it. What the bounds leave of it, and the rotors after
    /// them, is in the next sample's [`Sample::applied_nm`].
    fn torque(&mut self, sample: &Sample) -> Vector3<f64>;

    /// The whole memory.
    fn memory(&self, common: &Common) -> Self::Memory;

    /// Takes over a memory and gives back the common part.
    ///
    /// # Errors
    /// A reason, if it cannot be of this law.
    fn restore(&mut self, memory: &Self::Memory) -> Result<Common, String>;
}

/// What a law is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// γ(k) \[rad\].
    pub gamma_rad: Vector3<f64>,
    /// γ̇(k) \[rad/s\].
    pub gamma_rate_rad_s: Vector3<f64>,
    /// γ of the set point \[rad\].
    pub setpoint_rad: Vector3<f64>,
    /// γ − γ of the set point \[rad\], yaw the short way.
    pub error_rad: Vector3<f64>,
    /// β.
    pub morph_angle: MorphAngle,
    /// I(β) \[kg m²\] in B.
    pub inertia_kg_m2: Vector3<f64>,
    /// Bound on |τ| \[N m\].
    pub bound_nm: Vector3<f64>,
    /// Torque behind the rotors' lag \[N m\].
    pub torque_nm: Vector3<f64>,
    /// u(k−1) as applied \[N m\].
    pub applied_nm: Vector3<f64>,
    /// The sample of one period before was used.
    pub follows: bool,
    /// Another controller flies, and the law is to continue from what it applies.
    pub tracking: bool,
}

/// What is measured at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// γ = (φ, θ, ψ) \[rad\].
    pub gamma_rad: Vector3<f64>,
    /// ω \[rad/s\] in B.
    pub body_rate_rad_s: Vector3<f64>,
    /// Time since these were valid \[s\].
    pub age_s: f64,
    /// β.
    pub morph_angle: MorphAngle,
    /// Torque \[N m\] that the plant's allocation left of the command in effect before this sample.
    pub applied_nm: Option<Vector3<f64>>,
}

shared_types::memory! {
    /// Memory of what surrounds a law.
    #[derive(PartialEq)]
    pub struct Common {
        /// Set point in use: φ, θ, ψ \[rad\] and T \[N\].
        pub setpoint: [f64; 4],
        /// Sequence of the set point sample in use.
        pub setpoint_sequence: u64,
        /// The seat whose set point counts.
        pub slot: SetpointMemory,
        /// Torques given.
        pub actuators: Actuators,
        /// Last commanded thrust \[N\].
        pub thrust_n: f64,
        /// False before the first sample and after one that could not be used.
        pub primed: bool,
        /// Samples refused because they were not finite, or the pitch too steep.
        pub refused: u64,
    }
}

/// The command of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// τ with its bounds \[N m\].
    pub torque: Limited,
    /// T \[N\], the set point's within 0..=4 `F_max`.
    pub thrust_n: f64,
    /// False if the last command is held because the sample could not be used.
    pub is_new: bool,
}

/// A law with all that surrounds it, without ports.
#[derive(Debug)]
pub struct AttitudeLoop<L> {
    law: L,
    vehicle: VehicleParameters,
    timing: Timing,
    common: Common,
    tracking: bool,
}

impl<L: AttitudeLaw> AttitudeLoop<L> {
    /// At trim: level, at `yaw_rad`, hovering.
    #[must_use]
    pub fn new(law: L, vehicle: &VehicleParameters, timing: Timing, yaw_rad: f64) -> Self {
        let weight_n = vehicle.weight_n();
        let common = Common {
            setpoint: [0.0, 0.0, yaw_rad, weight_n],
            setpoint_sequence: 0,
            slot: SetpointSlot::new(weight_n, vehicle.gravity_m_s2).memory(),
            actuators: Actuators::at_rest(),
            thrust_n: weight_n,
            primed: false,
            refused: 0,
        };
        Self { law, vehicle: *vehicle, timing, common, tracking: false }
    }

    /// One sample.
    pub fn step(&mut self, measurement: &Measurement, setpoint: &Setpoint) -> Output {
        let axis = self.timing.axis();
        self.common.actuators.follow(measurement.applied_nm, &self.timing, &axis);
        let tracking = core::mem::take(&mut self.tracking);
        let Some(sample) = self.sample(measurement, setpoint, tracking) else {
            self.common.refused += 1;
            self.common.primed = false;
            let torque = Limited::held(&self.common.actuators.command_nm.into());
            self.common.actuators.command(&torque.input);
            return Output { torque, thrust_n: self.common.thrust_n, is_new: false };
        };
        let wish = self.law.torque(&sample);
        let bound = &sample.bound_nm;
        let torque = Limited::new(&wish, &sample.applied_nm, [&-bound, bound], bound);
        self.common.actuators.command(&torque.input);
        self.common.thrust_n = self.thrust_n(setpoint);
        self.common.primed = true;
        Output { torque, thrust_n: self.common.thrust_n, is_new: true }
    }

    /// γ brought from the instant of the estimate to this one, and all that goes with it;
    /// none beyond [`vehicle::MAX_PITCH_RAD`] or for numbers that are none.
    fn sample(
        &self,
        measurement: &Measurement,
        setpoint: &Setpoint,
        tracking: bool,
    ) -> Option<Sample> {
        let Measurement { gamma_rad: gamma, body_rate_rad_s: omega, age_s, .. } = measurement;
        let numbers = gamma.iter().chain(omega).chain(&setpoint.gamma_rad);
        if !numbers.chain([&setpoint.thrust_n, age_s]).all(|value| value.is_finite()) {
            return None;
        }
        // γ̇ = R₂(γ) ω   (5). From the instant of the estimate on it is taken as constant: with the torque
        // alone, without the load that it holds against, a resting vehicle would seem to turn.
        let rate = euler_rate_matrix(gamma)? * omega;
        let inertia = self.vehicle.inertia_kg_m2(measurement.morph_angle);
        let now = gamma + rate * age_s.clamp(0.0, self.timing.period_s);
        let mut error = now - setpoint.gamma_rad;
        error.z = wrap_pi(error.z);
        let thrust = self.thrust_n(setpoint);
        Some(Sample {
            gamma_rad: now,
            gamma_rate_rad_s: rate,
            setpoint_rad: setpoint.gamma_rad,
            error_rad: error,
            morph_angle: measurement.morph_angle,
            inertia_kg_m2: inertia,
            bound_nm: self.vehicle.torque_bound_nm(measurement.morph_angle, thrust),
            torque_nm: self.common.actuators.torque_nm.into(),
            applied_nm: self.common.actuators.applied_nm.into(),
            follows: self.common.primed,
            tracking,
        })
    }

    /// Thrust of a set point, as far as the rotors can give it \[N\].
    pub(super) fn thrust_n(&self, setpoint: &Setpoint) -> f64 {
        setpoint.thrust_n.clamp(0.0, 4.0 * self.vehicle.rotor_thrust_max_n)
    }

    /// Lets the next step continue from the torque and thrust that another controller has applied.
    pub fn track(&mut self, torque_nm: &Vector3<f64>, thrust_n: f64) {
        self.common.actuators.track(torque_nm, &self.timing);
        if thrust_n.is_finite() {
            self.common.thrust_n = thrust_n;
        }
        self.tracking = true;
    }

    /// So many samples without a step, for want of a usable estimate or of time: nothing was commanded, and the plant
    /// reports this torque, if it is known.
    pub fn leave_out(&mut self, samples: u64, reported: Option<Vector3<f64>>) {
        self.common.primed = false;
        self.common.actuators.pass(samples, reported, &self.timing);
    }

    /// What surrounds the law.
    #[must_use]
    pub fn common(&self) -> &Common {
        &self.common
    }

    pub(crate) fn common_mut(&mut self) -> &mut Common {
        &mut self.common
    }

    /// Times on the way of a command.
    #[must_use]
    pub fn timing(&self) -> &Timing {
        &self.timing
    }

    /// The vehicle as it is modelled.
    #[must_use]
    pub fn vehicle(&self) -> &VehicleParameters {
        &self.vehicle
    }

    /// The whole memory.
    #[must_use]
    pub fn memory(&self) -> L::Memory {
        self.law.memory(&self.common)
    }

    /// Takes over the memory of an instance with the same configuration; from here on both give the
    /// same bits.
    ///
    /// # Errors
    /// A reason, if it cannot be of this law.
    pub fn restore(&mut self, memory: &L::Memory) -> Result<(), String> {
        let common = self.law.restore(memory)?;
        let numbers = common.setpoint.iter().chain([&common.thrust_n]);
        if !(numbers.into_iter().all(|n| n.is_finite()) && common.actuators.is_finite()) {
            return Err("it holds a number that is not finite".to_owned());
        }
        self.common = common;
        Ok(())
    }
}
