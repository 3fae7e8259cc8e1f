//! The plant as a process: it owns what the controllers' model leaves out.
//!
//! The step at t integrates from the previous release to t, split wherever a command, disturbance
//! or owner takes effect, and then lets the sensors look. Its samples at t therefore depend only
//! on what was effective before t.

use crate::config::{ModelKind, PlantConfig, PlantError};
use crate::effects::{Effects, command, commanded_morph};
use crate::gate::{Command, Gate, GateInput, GateMemory, GateOutput, Mode};
use crate::ports::{Inputs, Outputs};
use crate::sensors::{
    Imu, ImuMemory, ImuSample, MorphEncoder, MorphEncoderMemory, Pose, PoseFix, PoseFixMemory,
};
use nalgebra::Vector3;
use runtime::Service;
use shared_types::{AppliedCommand, Flag, GateMode, NO_SEAT};
use vehicle::{
    Actuation, Allocation, GroundContact, LinearModel, MODEL_MEMORY_LEN, MorphAngle,
    NonlinearModel, PlantInputs, PlantModel, RigidBodyState, Truth, VehicleParameters, Wrench,
};

/// Longest integration step \[s\].
const MAX_STEP_S: f64 = 1e-3;
/// Commands that can take effect at one instant without reserving memory.
const COMMAND_CAPACITY: usize = runtime::graph::READER_CAPACITY;

shared_types::memory! {
    /// Everything that evolves.
    pub struct PlantMemory {
        /// Equations of motion.
        pub model: [f64; MODEL_MEMORY_LEN],
        /// Inertial sensor.
        pub imu: ImuMemory,
        /// Pose tracker with its delay line.
        pub pose_fix: PoseFixMemory,
        /// Morph encoder.
        pub morph_encoder: MorphEncoderMemory,
        /// Actuation gate.
        pub gate: GateMemory,
        /// Instant up to which the vehicle has been integrated \[ns\].
        pub integrated_ns: u64,
        /// Whether `reading` holds the inertial reading of that instant.
        pub has_reading: bool,
        /// Gyro \[rad/s\] and specific force \[m/s²\] of that reading.
        pub reading: [f64; 6],
        /// Last encoder reading \[rad\].
        pub measured_morph_rad: f64,
        /// Sequence of the last inertial sample.
        pub imu_sequence: u64,
        /// Sequence of the command in effect, its cause and its owner's epoch.
        pub in_effect: [u64; 3],
        /// Body-rate jump still to be applied \[rad/s\].
        pub kick_b_rad_s: [f64; 3],
    }
}

/// What the rotors are asked for over a stretch of time.
#[derive(Debug, Clone, Copy)]
struct Applied {
    actuation: Actuation,
    achieved: Wrench,
    rotor_thrust_n: [f64; 4],
    clipped: bool,
    mode: Mode,
}

/// The simulated vehicle between its ports.
#[derive(Debug)]
pub struct Plant {
    model: Box<dyn PlantModel>,
    linear: bool,
    vehicle: VehicleParameters,
    imu: Imu,
    pose_fix: PoseFix,
    morph_encoder: MorphEncoder,
    gate: Gate,
    start_morph: MorphAngle,
    commands: Vec<Command>,
    integrated_ns: u64,
    reading: Option<ImuSample>,
    measured_morph_rad: f64,
    imu_sequence: u64,
    in_effect: InEffect,
    kick_b_rad_s: Vector3<f64>,
    last: Option<(Applied, PlantInputs, GateOutput)>,
}

/// Which command is in effect.
#[derive(Debug, Clone, Copy, Default)]
struct InEffect {
    sequence: u64,
    cause_sequence: u64,
    epoch: u64,
}

impl Plant {
    /// A vehicle at trim.
    ///
    /// # Errors
    /// [`PlantError`] naming the impossible number.
    pub fn new(config: &PlantConfig) -> Result<Self, PlantError> {
        let vehicle = config.vehicle;
        let mut state = RigidBodyState::hover(&vehicle, config.position_w_m, config.morph_angle);
        state.q_wb = vehicle::quaternion_from_euler(&Vector3::new(0.0, 0.0, config.yaw_rad));
        let (model, linear): (Box<dyn PlantModel>, bool) = match config.model {
            ModelKind::Nonlinear { ground } => {
                let ground = ground.then(GroundContact::default);
                (Box::new(NonlinearModel::new(vehicle, ground, state)?), false)
            }
            ModelKind::Linear => (Box::new(LinearModel::new(vehicle, &state)?), true),
        };
        Ok(Self {
            model,
            linear,
            vehicle,
            imu: Imu::new(&config.imu, config.seed)?,
            pose_fix: PoseFix::new(&config.pose_fix, config.seed)?,
            morph_encoder: MorphEncoder::new(&config.morph_encoder, config.seed)?,
            gate: Gate::new(&config.gate, &vehicle)?,
            start_morph: config.morph_angle,
            commands: Vec::with_capacity(COMMAND_CAPACITY),
            integrated_ns: 0,
            reading: None,
            measured_morph_rad: config.morph_angle.rad(),
            imu_sequence: 0,
            in_effect: InEffect::default(),
            kick_b_rad_s: Vector3::zeros(),
            last: None,
        })
    }

    /// Integrates to `until_ns`, stopping at every instant at which something takes effect.
    fn integrate(&mut self, until_ns: u64, inputs: &Inputs) {
        let mut effects = Effects::new(inputs);
        loop {
            let from_ns = self.integrated_ns;
            let held = self.take_effect(from_ns, inputs, &mut effects);
            let to_ns = effects.next_ns(inputs).map_or(until_ns, |t| t.min(until_ns));
            self.advance(to_ns - from_ns, &held);
            self.integrated_ns = to_ns;
            if to_ns >= until_ns {
                break;
            }
        }
    }

    /// Runs the gate on the commands that take effect now; what to hold until the next instant.
    fn take_effect(&mut self, now_ns: u64, inputs: &Inputs, effects: &mut Effects) -> PlantInputs {
        effects.advance(now_ns, inputs);
        self.commands.clear();
        let first = effects.commands_from;
        for sample in &inputs.wrench_command.fresh()[first..effects.commands_to] {
            self.commands.push(command(sample, effects.owner.map_or(NO_SEAT, |o| o.1)));
        }
        if let Some(kick) = effects.take_kick(inputs) {
            self.kick_b_rad_s += kick;
        }
        let output = self.gate.tick(&GateInput {
            now_ns,
            commands: &self.commands,
            reading: self.reading.take(),
            morph_angle_rad: self.measured_morph_rad,
        });
        if let Some(accepted) =
            output.accepted.and_then(|i| inputs.wrench_command.fresh().get(first + i))
        {
            self.in_effect = InEffect {
                sequence: accepted.header.sequence,
                cause_sequence: accepted.header.cause_sequence,
                epoch: effects.owner.map_or(0, |o| o.0),
            };
        }
        let applied = self.allocate(&output);
        let held = self.plant_inputs(now_ns, inputs, effects, &applied);
        self.last = Some((applied, held, output));
        held
    }

    fn allocate(&self, output: &GateOutput) -> Applied {
        let morph =
            MorphAngle::saturating_from_rad(self.measured_morph_rad).unwrap_or(self.start_morph);
        let off =
            Allocation { rotor_thrust_n: [0.0; 4], achieved: Wrench::thrust(0.0), clipped: true };
        // The gate's wrench is finite, so allocation has an answer; rotors off if it had none.
        let allocation = self.vehicle.allocator(morph).allocate(&output.wrench).unwrap_or(off);
        let (actuation, achieved, clipped) = if self.linear {
            (Actuation::Wrench(output.wrench), output.wrench, false)
        } else {
            let rotors = Actuation::Rotors(allocation.rotor_thrust_n);
            (rotors, allocation.achieved, allocation.clipped)
        };
        Applied {
            actuation,
            achieved,
            rotor_thrust_n: allocation.rotor_thrust_n,
            clipped,
            mode: output.mode,
        }
    }

    fn plant_inputs(
        &self,
        now_ns: u64,
        inputs: &Inputs,
        effects: &Effects,
        applied: &Applied,
    ) -> PlantInputs {
        PlantInputs {
            actuation: applied.actuation,
            morph_command_rad: effects
                .morph(inputs)
                .map_or(self.start_morph.rad(), |command| commanded_morph(command, now_ns)),
            disturbance: effects.disturbance(inputs),
        }
    }

    /// Integrates over a stretch with everything held, in steps of at most a millisecond.
    fn advance(&mut self, stretch_ns: u64, held: &PlantInputs) {
        let stretch_s = stretch_ns as f64 * 1e-9;
        let steps = (stretch_s / MAX_STEP_S - 1e-9).ceil().max(1.0);
        let dt_s = stretch_s / steps;
        if dt_s <= 0.0 {
            return;
        }
        let mut held = *held;
        if self.kick_b_rad_s == Vector3::zeros() {
            self.step_model(dt_s, &held);
        } else {
            // A jump in body rate is an impulse: all of it in the first step.
            let beta = self.model.truth(&held).state.beta;
            let impulse = self.vehicle.inertia_kg_m2(beta).component_mul(&self.kick_b_rad_s);
            held.disturbance.torque_b_nm += impulse / dt_s;
            self.step_model(dt_s, &held);
            held.disturbance.torque_b_nm -= impulse / dt_s;
            self.kick_b_rad_s = Vector3::zeros();
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small count")]
        for _ in 1..steps as u32 {
            self.step_model(dt_s, &held);
        }
    }

    fn step_model(&mut self, dt_s: f64, held: &PlantInputs) {
        // A refused step leaves the vehicle where it is: a diverged simulation stands still and
        // finite instead of spreading NaN.
        let _status = self.model.step(dt_s, held);
    }

    fn look(&mut self, now_ns: u64, outputs: &mut Outputs) {
        let Some((applied, held, gate)) = self.last else { return };
        let truth = self.model.truth(&held);
        let state = &truth.state;
        if let Some(sample) = self.imu.sample(now_ns, &state.omega_b, &truth.specific_force_b_m_s2)
        {
            self.reading = Some(sample);
            self.imu_sequence += 1;
            outputs.imu.write(shared_types::Imu {
                gyro_b_rad_s: sample.gyro_b_rad_s.into(),
                specific_force_b_m_s2: sample.specific_force_b_m_s2.into(),
                saturated: Flag::from(sample.saturated),
                ..shared_types::Imu::default()
            });
        }
        let pose = Pose { position_w_m: state.position_w, q_wb: state.q_wb };
        self.pose_fix.capture(now_ns, &pose);
        if let Some(fix) = self.pose_fix.deliver(now_ns) {
            outputs.pose_fix.write(shared_types::PoseFix {
                captured_ns: fix.captured_ns,
                position_w_m: fix.pose.position_w_m.into(),
                q_wb: crate::ports::quaternion(&fix.pose.q_wb),
                ..shared_types::PoseFix::default()
            });
        }
        if let Some(angle_rad) = self.morph_encoder.sample(now_ns, state.beta.rad()) {
            self.measured_morph_rad = angle_rad;
            outputs.morph_angle.write(shared_types::MorphAngle {
                angle_rad,
                ..shared_types::MorphAngle::default()
            });
        }
        outputs.applied_command.write(self.applied_command(&applied, &gate));
        self.write_truth(now_ns, &truth, &applied, &held, outputs);
    }

    fn applied_command(&self, applied: &Applied, gate: &GateOutput) -> AppliedCommand {
        AppliedCommand {
            command_sequence: self.in_effect.sequence,
            command_cause_sequence: self.in_effect.cause_sequence,
            epoch: self.in_effect.epoch,
            thrust_n: applied.achieved.thrust_n,
            torque_b_nm: applied.achieved.torque_b_nm.into(),
            rotor_thrust_n: applied.rotor_thrust_n,
            refused_not_finite: gate.counters.refused_not_finite,
            refused_out_of_range: gate.counters.refused_out_of_range
                + gate.counters.refused_out_of_time,
            refused_wrong_owner: gate.counters.refused_wrong_owner,
            safe_mode_episodes: gate.counters.safe_mode_episodes,
            mode: GateMode(applied.mode.code()),
            clipped: Flag::from(applied.clipped),
            ..AppliedCommand::default()
        }
    }

    fn write_truth(
        &self,
        now_ns: u64,
        truth: &Truth,
        applied: &Applied,
        held: &PlantInputs,
        outputs: &mut Outputs,
    ) {
        let state = &truth.state;
        outputs.truth.write(shared_types::Truth {
            position_w_m: state.position_w.into(),
            velocity_w_m_s: state.velocity_w.into(),
            q_wb: crate::ports::quaternion(&state.q_wb),
            body_rate_b_rad_s: state.omega_b.into(),
            morph_angle_rad: state.beta.rad(),
            morph_rate_rad_s: state.beta_rate_rad_s,
            gyro_bias_b_rad_s: self.imu.gyro_bias_b_rad_s(now_ns).into(),
            accelerometer_bias_b_m_s2: self.imu.accelerometer_bias_b_m_s2(now_ns).into(),
            ..shared_types::Truth::default()
        });
        let efficiency = held.disturbance.rotor_efficiency;
        outputs.actuator_state.write(shared_types::ActuatorState {
            rotor_thrust_n: core::array::from_fn(|i| state.rotor_thrust_n[i] * efficiency[i]),
            rotor_command_n: applied.rotor_thrust_n,
            morph_command_rad: held.morph_command_rad,
            ..shared_types::ActuatorState::default()
        });
    }
}

impl Service for Plant {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = PlantMemory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.integrate(now_ns, inputs);
        self.look(now_ns, outputs);
    }

    fn cause_sequence(&self, _inputs: &Inputs) -> u64 {
        self.imu_sequence
    }

    fn memory(&self) -> PlantMemory {
        let reading = self.reading.map_or([0.0; 6], |r| {
            let (g, f) = (r.gyro_b_rad_s, r.specific_force_b_m_s2);
            [g.x, g.y, g.z, f.x, f.y, f.z]
        });
        PlantMemory {
            model: self.model.memory(),
            imu: self.imu.memory(),
            pose_fix: self.pose_fix.memory(),
            morph_encoder: self.morph_encoder.memory(),
            gate: self.gate.memory(),
            integrated_ns: self.integrated_ns,
            has_reading: self.reading.is_some(),
            reading,
            measured_morph_rad: self.measured_morph_rad,
            imu_sequence: self.imu_sequence,
            in_effect: [
                self.in_effect.sequence,
                self.in_effect.cause_sequence,
                self.in_effect.epoch,
            ],
            kick_b_rad_s: self.kick_b_rad_s.into(),
        }
    }

    fn restore(&mut self, memory: &PlantMemory) -> Result<(), String> {
        self.model.restore(&memory.model).ok_or("the vehicle state is not one of this model")?;
        self.imu.restore(&memory.imu);
        self.pose_fix.restore(&memory.pose_fix);
        self.morph_encoder.restore(&memory.morph_encoder);
        self.gate.restore(&memory.gate);
        self.integrated_ns = memory.integrated_ns;
        let [gx, gy, gz, fx, fy, fz] = memory.reading;
        self.reading = memory.has_reading.then(|| ImuSample {
            gyro_b_rad_s: Vector3::new(gx, gy, gz),
            specific_force_b_m_s2: Vector3::new(fx, fy, fz),
            saturated: false,
        });
        self.measured_morph_rad = memory.measured_morph_rad;
        self.imu_sequence = memory.imu_sequence;
        let [sequence, cause_sequence, epoch] = memory.in_effect;
        self.in_effect = InEffect { sequence, cause_sequence, epoch };
        self.kick_b_rad_s = memory.kick_b_rad_s.into();
        Ok(())
    }

    fn reseed(&mut self, seed: u64) {
        self.imu.reseed(seed);
        self.pose_fix.reseed(seed);
        self.morph_encoder.reseed(seed);
    }
}
