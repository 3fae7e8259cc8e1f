//! The plant as a process: it owns what the controllers' model leaves out.
//!
//! The step at t integrates from the previous release to t, split wherever a command, disturbance
//! or owner takes effect, and then lets the sensors look. Its samples at t therefore depend only
//! on what was effective before t.

use crate::config::{ModelKind, PlantConfig, PlantError};
use crate::effects::{Effects, command, commanded_morph};
use crate::gate::{Command, Gate, GateInput, GateOutput, Mode, UnprovenRange};
use crate::memory::{InEffect, PlantMemory};
use crate::ports::{Inputs, Outputs};
use crate::sensors::{ImuSample, Sensors};
use nalgebra::Vector3;
use runtime::{CommandArbiter, Service};
use shared_types::{AppliedCommand, Flag, GateMode, Quaternion, Role, WrenchCommand};
use slot::{Authority, REJECTED_AFTER_TRIP_NS, Tripped};
use vehicle::{
    Actuation, Allocation, Disturbance, GroundContact, LinearModel, MorphAngle, NonlinearModel,
    PlantInputs, PlantModel, Truth, VehicleParameters, Wrench, components,
};

/// Longest integration step \[s\].
const MAX_STEP_S: f64 = 1e-3;
/// Share of the rotors' bounds by which a change of kind may step at once.
const STEP_SHARE: f64 = 0.1;

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
    sensors: Sensors,
    gate: Gate,
    unproven: Option<UnprovenRange>,
    start_morph: MorphAngle,
    arbiter: CommandArbiter,
    integrated_ns: u64,
    reading: Option<ImuSample>,
    measured_morph_rad: f64,
    imu_sequence: u64,
    in_effect: InEffect,
    kick_b_rad_s: Vector3<f64>,
    last: Option<(Applied, PlantInputs, GateOutput)>,
}

impl Plant {
    /// A vehicle as it begins.
    ///
    /// # Errors
    /// [`PlantError`] naming the impossible number.
    pub fn new(config: &PlantConfig) -> Result<Self, PlantError> {
        let vehicle = config.vehicle;
        let state = config.initial_state();
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
            sensors: Sensors::new(&config.sensors, config.seed)?,
            gate: config.initial_gate(&state)?,
            unproven: config.unproven,
            start_morph: config.morph_angle,
            arbiter: CommandArbiter::new(REJECTED_AFTER_TRIP_NS),
            integrated_ns: 0,
            reading: None,
            measured_morph_rad: config.morph_angle.rad(),
            imu_sequence: 0,
            in_effect: InEffect::NONE,
            kick_b_rad_s: Vector3::zeros(),
            last: None,
        })
    }

    /// Integrates to `until_ns`, stopping at every instant at which something takes effect, or at
    /// which a silent owner's command gives way to the fallback's.
    fn integrate(&mut self, until_ns: u64, inputs: &Inputs) {
        let mut effects = Effects::default();
        self.arbiter.take_records(&inputs.attitude_owner);
        loop {
            let from_ns = self.integrated_ns;
            let held = self.take_effect(from_ns, inputs, &mut effects);
            let lapses_ns = self.arbiter.lapses_ns().filter(|t| *t > from_ns);
            let stops = [effects.next_ns(inputs), lapses_ns];
            let to_ns = stops.into_iter().flatten().fold(until_ns, u64::min);
            self.advance(to_ns - from_ns, &held);
            self.integrated_ns = to_ns;
            if to_ns >= until_ns {
                break;
            }
        }
        self.arbiter.close_before(until_ns);
    }

    /// Judges a command and puts it on the table if its writer may command.
    fn offer(&mut self, now_ns: u64, sample: &WrenchCommand) {
        let command = command(sample);
        let unproven = self.unproven.as_ref().filter(|_| self.arbiter.is_watched());
        let judged = match (self.arbiter.authority_of(&sample.header), unproven) {
            (Authority::Owner, Some(range)) => self.gate.judge_unproven(now_ns, &command, range),
            (Authority::Owner | Authority::Fallback, _) => self.gate.judge(now_ns, &command),
            (Authority::Member, _) => return,
            (Authority::Stray, _) => return self.gate.refuse_stray(),
        };
        if let Some(Command { wrench, validity_ns, .. }) = judged {
            let [x, y, z] = wrench.torque_b_nm.into();
            self.arbiter.offer(&sample.header, [wrench.thrust_n, x, y, z], validity_ns);
        }
    }

    /// The command that counts from now on, if it is another than before, and whether none may be held any more.
    fn select_command(&mut self, now_ns: u64) -> (Option<Command>, bool) {
        let largest = self.vehicle.largest_wrench(self.measured_morph());
        let limit = largest.map(|most| STEP_SHARE * most);
        let selected = self.arbiter.decide(now_ns, &limit);
        let is_revoked = selected.is_none() && self.arbiter.is_revoked();
        let Some(selected) = selected.filter(|selected| selected.is_new) else {
            return (None, is_revoked);
        };
        let slot::Command { value, sequence, cause_sequence, effective_ns, valid_until_ns } =
            selected.command;
        self.in_effect = InEffect { seat: selected.seat.into(), sequence, cause_sequence };
        let [thrust_n, x, y, z] = value;
        let wrench = Wrench { thrust_n, torque_b_nm: Vector3::new(x, y, z) };
        let validity_ns = valid_until_ns - effective_ns;
        (Some(Command { wrench, effective_ns, validity_ns }), false)
    }

    fn measured_morph(&self) -> MorphAngle {
        MorphAngle::saturating_from_rad(self.measured_morph_rad).unwrap_or(self.start_morph)
    }

    /// Runs the gate on the command that counts now; what to hold until the next instant.
    fn take_effect(&mut self, now_ns: u64, inputs: &Inputs, effects: &mut Effects) -> PlantInputs {
        effects.advance(now_ns, inputs);
        self.arbiter.advance(now_ns);
        let trips = &inputs.trip.fresh()[effects.trips_from..effects.trips_to];
        let taken = trips.iter().map(|trip| self.arbiter.trip(Role::Attitude, trip));
        let tripped = taken.filter(|taken| *taken != Tripped::Ignored).count() > 0;
        for sample in &inputs.wrench_command.fresh()[effects.commands_from..effects.commands_to] {
            self.offer(now_ns, sample);
        }
        let (command, is_revoked) = self.select_command(now_ns);
        let kick = effects.take_kick(inputs);
        if let Some(kick) = kick.filter(|kick| kick.iter().all(|rate| rate.is_finite())) {
            self.kick_b_rad_s += kick;
        }
        // Neither its fallback, nor what levels in its place.
        let commands_unproven =
            self.arbiter.is_watched() && !self.arbiter.failed_over() && !self.arbiter.tripped();
        let led_astray = trips.iter().any(|trip| trip.slot == Role::Position);
        let output = self.gate.tick(&GateInput {
            now_ns,
            command,
            is_revoked,
            // An attitude owner that has not proven itself may go on following the set point that has tripped.
            tripped: tripped || commands_unproven && led_astray,
            led_astray,
            unproven: self.unproven.as_ref().filter(|_| commands_unproven),
            reading: self.reading.take(),
            morph_angle_rad: self.measured_morph_rad,
            estimate: inputs.state_estimate.latest(),
            reference: inputs.reference.latest(),
        });
        if !matches!(output.mode, Mode::Normal | Mode::Hold { .. }) {
            self.arbiter.forget_order();
        }
        let applied = self.allocate(&output);
        let held = self.plant_inputs(now_ns, inputs, effects, &applied);
        self.last = Some((applied, held, output));
        held
    }

    fn allocate(&self, output: &GateOutput) -> Applied {
        let morph = self.measured_morph();
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
        // What is no number moves nothing, and stops nothing.
        let commanded = effects.morph(inputs).map(|command| commanded_morph(command, now_ns));
        let last = self.last.map(|(_, held, _)| held.morph_command_rad);
        let morph_command_rad = commanded
            .filter(|angle_rad| angle_rad.is_finite())
            .or(last)
            .unwrap_or_else(|| self.start_morph.rad());
        PlantInputs {
            actuation: applied.actuation,
            morph_command_rad,
            disturbance: Some(effects.disturbance(inputs))
                .filter(Disturbance::is_usable)
                .unwrap_or_default(),
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
        let seen = self.sensors.look(now_ns, &truth, outputs);
        if let Some(sample) = seen.imu {
            self.reading = Some(sample);
            self.imu_sequence += 1;
        }
        self.measured_morph_rad = seen.morph_encoder.unwrap_or(self.measured_morph_rad);
        outputs.applied_command.write(self.applied_command(&applied, &gate));
        self.write_truth(now_ns, &truth, &applied, &held, outputs);
    }

    fn applied_command(&self, applied: &Applied, gate: &GateOutput) -> AppliedCommand {
        let slot = self.arbiter.counters();
        AppliedCommand {
            command_sequence: self.in_effect.sequence,
            command_seat: self.in_effect.seat,
            command_cause_sequence: self.in_effect.cause_sequence,
            epoch: self.arbiter.epoch(),
            thrust_n: applied.achieved.thrust_n,
            torque_b_nm: applied.achieved.torque_b_nm.into(),
            rotor_thrust_n: applied.rotor_thrust_n,
            refused_not_finite: gate.counters.refused_not_finite,
            refused_out_of_range: gate.counters.refused_out_of_range
                + gate.counters.refused_out_of_time,
            refused_wrong_owner: gate.counters.refused_wrong_owner,
            reduced: gate.counters.reduced,
            safe_mode_episodes: gate.counters.safe_mode_episodes,
            mode: GateMode(applied.mode.code()),
            clipped: Flag::from(applied.clipped),
            fail_overs: slot.fail_overs,
            refused_epoch: slot.refused_epoch,
            refused_records: slot.refused_records,
            seat: self.arbiter.seat(),
            failed_over: Flag::from(self.arbiter.failed_over()),
            tripped: Flag::from(self.arbiter.tripped()),
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
            q_wb: Quaternion::from_array(components(state.q_wb)),
            body_rate_b_rad_s: state.omega_b.into(),
            morph_angle_rad: state.beta.rad(),
            morph_rate_rad_s: state.beta_rate_rad_s,
            gyro_bias_b_rad_s: self.sensors.imu.gyro_bias_b_rad_s(now_ns).into(),
            accelerometer_bias_b_m_s2: self.sensors.imu.accelerometer_bias_b_m_s2(now_ns).into(),
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
            sensors: self.sensors.memory(),
            gate: self.gate.memory(),
            arbiter: self.arbiter.memory(),
            integrated_ns: self.integrated_ns,
            has_reading: self.reading.is_some(),
            reading,
            measured_morph_rad: self.measured_morph_rad,
            imu_sequence: self.imu_sequence,
            in_effect: self.in_effect,
            kick_b_rad_s: self.kick_b_rad_s.into(),
        }
    }

    fn restore(&mut self, memory: &PlantMemory) -> Result<(), String> {
        self.model.restore(&memory.model).ok_or("the vehicle state is not one of this model")?;
        self.sensors.restore(&memory.sensors);
        self.gate.restore(&memory.gate);
        self.arbiter.restore(&memory.arbiter);
        self.integrated_ns = memory.integrated_ns;
        let [gx, gy, gz, fx, fy, fz] = memory.reading;
        self.reading = memory.has_reading.then(|| ImuSample {
            gyro_b_rad_s: Vector3::new(gx, gy, gz),
            specific_force_b_m_s2: Vector3::new(fx, fy, fz),
            saturated: false,
        });
        self.measured_morph_rad = memory.measured_morph_rad;
        self.imu_sequence = memory.imu_sequence;
        self.in_effect = memory.in_effect;
        self.kick_b_rad_s = memory.kick_b_rad_s.into();
        Ok(())
    }

    fn reseed(&mut self, seed: u64) {
        self.sensors.reseed(seed);
    }
}
