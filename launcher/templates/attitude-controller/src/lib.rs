//! my-attitude-controller: thrust and attitude set point in, thrust and torque out.
//!
//! A cascade: the angle error asks for a body rate, the rate error for a torque, and an integral holds
//! what is constantly missing. Change `Controller::torque`; the rest is what any attitude
//! controller needs.

use host::{Config, Flight, HostError};
use nalgebra::{UnitQuaternion, Vector3};
use runtime::{Link, Service, SetpointMemory, SetpointSlot, inputs, outputs};
use serde::Deserialize;
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeReport, AttitudeSetpoint, GateMode, OwnerRecord,
    Reference, Role, StateEstimate, Trip, WrenchCommand, topics,
};
use vehicle::{MorphAngle, VehicleParameters, rotation};

/// An estimate older than this, and than two periods, is not flown on \[ns\].
const STALE_NS: u64 = 20_000_000;

/// What can be tuned, with `--config FILE`.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Gains {
    /// Body rate per angle error, for roll, pitch and yaw \[1/s\].
    pub angle_per_s: [f64; 3],
    /// Angular acceleration per rate error \[1/s\].
    pub rate_per_s: [f64; 3],
    /// Integral time of the rate error \[s\].
    pub integral_s: f64,
}

impl Default for Gains {
    /// For 15 ms of rotor lag and 100 Hz.
    fn default() -> Self {
        Self { angle_per_s: [16.0; 3], rate_per_s: [50.0, 50.0, 55.0], integral_s: 0.5 }
    }
}

inputs! {
    /// What the controller reads; its commands descend from the first.
    pub struct Inputs {
        /// Believed state.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// What the position loop asks for.
        attitude_setpoint: AttitudeSetpoint = topics::ATTITUDE_SETPOINT,
        /// The last command of the rotors, from the controller that commands.
        applied_command: AppliedCommand = topics::APPLIED_COMMAND,
        /// The owner of the position slot, whose set points count.
        position_owner: OwnerRecord = topics::POSITION_OWNER,
        /// Owners that are not to be followed any more.
        trip: Trip = topics::TRIP,
        /// What is followed while no set point counts.
        reference: Reference = topics::REFERENCE,
    }
}

outputs! {
    /// What the controller writes.
    pub struct Outputs {
        /// Thrust and torque asked of the rotors.
        wrench_command: WrenchCommand = topics::WRENCH_COMMAND,
        /// The set point that it tracks, for the position loop.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// Bounds and command, for the summary.
        attitude_report: AttitudeReport = topics::ATTITUDE_REPORT,
    }
}

shared_types::memory! {
    /// Everything that evolves. A successor restores it and goes on bit for bit.
    #[derive(PartialEq)]
    pub struct Memory {
        /// Integral of the rate error \[N m\].
        pub integral_nm: [f64; 3],
        /// Last torque \[N m\].
        pub torque_nm: [f64; 3],
        /// Set point in use: φ, θ, ψ [rad] and T [N].
        pub setpoint: [f64; 4],
        /// Its sequence; 0 before the first.
        pub setpoint_sequence: u64,
        /// Whose set points count.
        pub slot: SetpointMemory,
    }
}

/// The controller.
#[derive(Debug)]
pub struct Controller {
    gains: Gains,
    vehicle: VehicleParameters,
    period_s: f64,
    memory: Memory,
    slot: SetpointSlot,
    /// The coming step is a shadow's that follows the controller that commands.
    tracking: bool,
}

/// What the law knows at a step.
#[derive(Debug, Clone, Copy)]
struct Sample {
    /// Attitude, body to world.
    q_wb: UnitQuaternion<f64>,
    /// Body rate \[rad/s\].
    rate_rad_s: Vector3<f64>,
    /// Inertia at the present morph angle \[kg m²\].
    inertia_kg_m2: Vector3<f64>,
    /// Largest torque that the rotors can give at this thrust \[N m\].
    bound_nm: Vector3<f64>,
    thrust_n: f64,
}

impl Controller {
    /// At trim: level, at the start's heading, until the first set point.
    ///
    /// # Errors
    /// The configuration cannot be read.
    pub fn new(flight: &Flight, config: &Config) -> Result<Self, HostError> {
        let rate_hz = flight.rate_hz(Role::Attitude).ok_or(HostError::NoSuchLoop("attitude"))?;
        let vehicle = flight.vehicle();
        Ok(Self::at_trim(config.read()?, vehicle, 1.0 / rate_hz, flight.start_yaw_rad))
    }

    /// Two control periods: how long a command, and the estimate it is made from, are good \[ns\].
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
    fn validity_ns(&self) -> u64 {
        (2e9 * self.period_s).ceil() as u64
    }

    fn at_trim(gains: Gains, vehicle: VehicleParameters, period_s: f64, yaw_rad: f64) -> Self {
        let setpoint = [0.0, 0.0, yaw_rad, vehicle.weight_n()];
        let memory = Memory { setpoint, ..Memory::default() };
        let slot = SetpointSlot::new(vehicle.weight_n(), vehicle.gravity_m_s2);
        Self { gains, vehicle, period_s, memory, slot, tracking: false }
    }

    /// Takes the set point that counts, or what stands in for one; the last one stays if there is neither.
    fn take_setpoint(&mut self, now_ns: u64, inputs: &Inputs) {
        let taken = self.slot.take(
            now_ns,
            &inputs.position_owner,
            &inputs.attitude_setpoint,
            &inputs.trip,
            (&inputs.state_estimate, &inputs.reference),
        );
        if let Some(command) = taken {
            let [thrust_n, roll_rad, pitch_rad, yaw_rad] = command.value;
            self.memory.setpoint = [roll_rad, pitch_rad, yaw_rad, thrust_n];
            self.memory.setpoint_sequence = command.sequence;
        } else if let Some(sample) = inputs.attitude_setpoint.latest()
            && self.tracking
            && self.memory.setpoint_sequence == 0
        {
            // A shadow that has just come: the first set point of its own is yet to be sent.
            self.memory.setpoint =
                [sample.roll_rad, sample.pitch_rad, sample.yaw_rad, sample.thrust_n];
        }
    }

    /// What is known now; `None` if the estimate is too old to fly on.
    fn sample(&self, now_ns: u64, inputs: &Inputs) -> Option<Sample> {
        let limit_ns = self.validity_ns().max(STALE_NS);
        let Link::Fresh(estimate) = inputs.state_estimate.link(now_ns, limit_ns) else {
            return None;
        };
        let beta = MorphAngle::saturating_from_rad(estimate.morph_angle_rad)?;
        let thrust_n = self.memory.setpoint[3].clamp(0.0, 4.0 * self.vehicle.rotor_thrust_max_n);
        // Two rotors give m g / 2 at most beside the thrust, and the other two no less than nothing.
        let lever_n = (0.5 * self.vehicle.weight_n()).min(0.5 * thrust_n);
        let tilt_nm = self.vehicle.geometry.arm_length_m(beta) * lever_n;
        let yaw_nm = self.vehicle.yaw_coefficient_m * self.vehicle.weight_n();
        Some(Sample {
            q_wb: rotation(estimate.q_wb.to_array()),
            rate_rad_s: estimate.body_rate_b_rad_s.into(),
            inertia_kg_m2: self.vehicle.inertia_kg_m2(beta),
            bound_nm: Vector3::new(tilt_nm, tilt_nm, yaw_nm),
            thrust_n,
        })
    }

    /// The law, without its integral: torque \[N m\] and rate error \[rad/s\].
    fn torque(&self, sample: &Sample) -> (Vector3<f64>, Vector3<f64>) {
        let [roll_rad, pitch_rad, yaw_rad, _] = self.memory.setpoint;
        let wanted = vehicle::quaternion_from_euler(&Vector3::new(roll_rad, pitch_rad, yaw_rad));
        // Twice the vector part of the error is its angle, near zero, the short way round.
        let error = sample.q_wb.conjugate() * wanted;
        let angle_rad = 2.0 * error.w.signum() * error.vector();
        let rate = angle_rad.component_mul(&Vector3::from(self.gains.angle_per_s));
        let rate_error = rate - sample.rate_rad_s;
        let acceleration = rate_error.component_mul(&Vector3::from(self.gains.rate_per_s));
        (sample.inertia_kg_m2.component_mul(&acceleration), rate_error)
    }

    fn integrate(&mut self, sample: &Sample, rate_error: &Vector3<f64>, cut: &Vector3<f64>) {
        let share = self.period_s / self.gains.integral_s;
        for axis in 0..3 {
            let gain = sample.inertia_kg_m2[axis] * self.gains.rate_per_s[axis];
            let further = share * gain * rate_error[axis];
            // Beyond a bound it only comes back.
            if cut[axis] * further >= 0.0 {
                self.memory.integral_nm[axis] += further;
            }
        }
    }
}

impl Service for Controller {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = Memory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take_setpoint(now_ns, inputs);
        let tracking = core::mem::take(&mut self.tracking);
        let Some(sample) = self.sample(now_ns, inputs) else {
            // The command lapses, and the plant's gate holds and levels by itself.
            return;
        };
        let (law_nm, rate_error) = self.torque(&sample);
        let applied = inputs.applied_command.latest().filter(|a| a.command_sequence > 0);
        // What the actuation guard commands, to bring the vehicle back, is not what any law would.
        let continues = |a: &&AppliedCommand| tracking && a.mode != GateMode::Recover;
        if let Some(applied) = applied.filter(continues) {
            // The integral takes the difference of the applied command and the law's: the command continues
            // from there, and a change of hands is not felt.
            self.memory.integral_nm = (Vector3::from(applied.torque_b_nm) - law_nm).into();
        }
        let wish_nm = law_nm + Vector3::from(self.memory.integral_nm);
        let torque_nm = wish_nm.sup(&-sample.bound_nm).inf(&sample.bound_nm);
        self.integrate(&sample, &rate_error, &(torque_nm - wish_nm));
        let [roll_rad, pitch_rad, yaw_rad, _] = self.memory.setpoint;
        outputs.wrench_command.write(WrenchCommand {
            thrust_n: sample.thrust_n,
            torque_b_nm: torque_nm.into(),
            validity_ns: self.validity_ns(),
            ..WrenchCommand::default()
        });
        outputs.applied_setpoint.write(AppliedSetpoint {
            setpoint_sequence: self.memory.setpoint_sequence,
            thrust_n: sample.thrust_n,
            roll_rad,
            pitch_rad,
            yaw_rad,
            ..self.slot.applied()
        });
        outputs.attitude_report.write(AttitudeReport {
            torque_b_nm: torque_nm.into(),
            previous_torque_b_nm: self.memory.torque_nm,
            torque_min_b_nm: (-sample.bound_nm).into(),
            torque_max_b_nm: sample.bound_nm.into(),
            torque_increment_max_b_nm: [f64::INFINITY; 3],
            thrust_n: sample.thrust_n,
            ..AttitudeReport::default()
        });
        self.memory.torque_nm = torque_nm.into();
    }

    fn track(&mut self, _now_ns: u64, _inputs: &Inputs) {
        self.tracking = true;
    }

    fn memory(&self) -> Memory {
        Memory { slot: self.slot.memory(), ..self.memory }
    }

    fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        let numbers = memory.integral_nm.iter().chain(&memory.setpoint);
        if !numbers.copied().all(f64::is_finite) {
            return Err("it holds a number that is not finite".to_owned());
        }
        self.memory = *memory;
        self.slot.restore(&memory.slot);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controller() -> Controller {
        Controller::at_trim(Gains::default(), VehicleParameters::default(), 0.01, 0.0)
    }

    fn inputs(roll_rad: f64, applied_nm: [f64; 3]) -> Inputs {
        let mut inputs = Inputs::default();
        let q = vehicle::quaternion_from_euler(&Vector3::new(roll_rad, 0.0, 0.0));
        inputs.state_estimate.offer(StateEstimate {
            q_wb: shared_types::Quaternion::from_array(vehicle::components(q)),
            morph_angle_rad: 1.0,
            ..StateEstimate::default()
        });
        inputs.applied_command.offer(AppliedCommand {
            command_sequence: 1,
            torque_b_nm: applied_nm,
            ..AppliedCommand::default()
        });
        inputs.state_estimate.accept(0, None);
        inputs.applied_command.accept(0, None);
        inputs
    }

    fn torque(controller: &mut Controller, inputs: &Inputs) -> [f64; 3] {
        let mut outputs = Outputs::default();
        controller.step(0, inputs, &mut outputs);
        controller.memory.torque_nm
    }

    #[test]
    fn a_roll_is_answered_against_it_and_never_beyond_the_bound() {
        for roll_rad in [0.01, -0.01, 1.0, -1.0] {
            let inputs = inputs(roll_rad, [0.0; 3]);
            let mut controller = controller();
            let bound_nm = controller.sample(0, &inputs).expect("fresh").bound_nm;
            let [x, y, z] = torque(&mut controller, &inputs);
            assert!(x * roll_rad < 0.0 && x.abs() <= bound_nm.x, "{roll_rad}: {x}");
            assert!(y.abs() < 1e-12 && z.abs() < 1e-12);
        }
    }

    #[test]
    fn after_tracking_the_next_torque_is_the_applied_one() {
        let applied_nm = [0.004, -0.003, 0.001];
        let inputs = inputs(0.02, applied_nm);
        let mut controller = controller();
        controller.track(0, &inputs);
        let next_nm = torque(&mut controller, &inputs);
        for (next, applied) in next_nm.iter().zip(applied_nm) {
            assert!((next - applied).abs() < 1e-12, "{next_nm:?}");
        }
    }

    #[test]
    fn a_restored_successor_goes_on_bit_for_bit() {
        let inputs = inputs(0.02, [0.0; 3]);
        let mut first = controller();
        torque(&mut first, &inputs);
        let mut successor = controller();
        successor.restore(&first.memory()).expect("finite");
        let both = [torque(&mut successor, &inputs), torque(&mut first, &inputs)];
        let [ours, theirs] = both.map(|torque_nm| torque_nm.map(f64::to_bits));
        assert_eq!(ours, theirs);
        assert_eq!(successor.memory(), first.memory());
    }
}
