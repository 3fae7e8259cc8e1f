//! The attitude MPC as a process: state estimate and set point in, wrench command out.

use crate::law::{AttitudeLaw, Input, LawStatus, Output, Setpoint};
use crate::memory::Memory;
use crate::preview::MorphPlan;
use crate::{AttitudeLawConfig, ConfigError};
use mpc::QpStatus;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use runtime::{Link, Service, SetpointMemory, SetpointSlot, inputs, outputs};
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, ControllerReport, MorphCommand, OwnerRecord,
    SolveStatus, StateEstimate, WrenchCommand, topics,
};
use vehicle::{MorphAngle, VehicleParameters, euler_from_quaternion};

/// An estimate older than this, and than two periods, is flown no more: the command lapses and the
/// plant's gate, which has a gyro of its own, takes over \[ns\].
const STALE_NS: u64 = 20_000_000;

inputs! {
    /// What the attitude loop reads; its commands descend from the state estimate.
    pub struct Inputs {
        /// Believed state.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// Target of the position slot's owner.
        attitude_setpoint: AttitudeSetpoint = topics::ATTITUDE_SETPOINT,
        /// What the plant's gate made of the last command.
        applied_command: AppliedCommand = topics::APPLIED_COMMAND,
        /// Planned path of the deployable angle.
        morph_command: MorphCommand = topics::MORPH_COMMAND,
        /// Owner of the position slot.
        position_owner: OwnerRecord = topics::POSITION_OWNER,
    }
}

outputs! {
    /// What the attitude loop writes.
    pub struct Outputs {
        /// Wrench asked of the rotors.
        wrench_command: WrenchCommand = topics::WRENCH_COMMAND,
        /// Set point in use.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// Bounds, verdict and effort.
        attitude_report: ControllerReport = topics::ATTITUDE_REPORT,
    }
}

shared_types::memory! {
    /// Everything that evolves.
    pub struct ComponentMemory {
        /// The control law's memory.
        pub law: Memory,
        /// Set point in use: φ, θ, ψ [rad] and T [N].
        pub setpoint: [f64; 4],
        /// Sequence of the set point sample in use.
        pub setpoint_sequence: u64,
        /// Whose set point counts.
        pub slot: SetpointMemory,
    }
}

/// The attitude MPC between its ports.
#[derive(Debug)]
pub struct AttitudeMpc {
    law: AttitudeLaw,
    period_ns: u64,
    yaw_coefficient_m: f64,
    setpoint: Setpoint,
    setpoint_sequence: u64,
    slot: SetpointSlot,
}

impl AttitudeMpc {
    /// A controller at trim: level, at the start's heading, until the first set point.
    ///
    /// # Errors
    /// The configuration is impossible.
    pub fn new(
        config: AttitudeLawConfig,
        vehicle: &VehicleParameters,
        start_yaw_rad: f64,
    ) -> Result<Self, ConfigError> {
        let rate_hz = config.rate_hz;
        Ok(Self {
            law: AttitudeLaw::new(config, vehicle)?,
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "positive"
            )]
            period_ns: (1e9 / rate_hz).ceil() as u64,
            yaw_coefficient_m: vehicle.yaw_coefficient_m,
            setpoint: Setpoint {
                gamma_rad: Vector3::new(0.0, 0.0, start_yaw_rad),
                thrust_n: vehicle.weight_n(),
            },
            setpoint_sequence: 0,
            slot: SetpointSlot::new(vehicle.weight_n()),
        })
    }

    /// Takes the set point that counts; the last one stays if nobody's does.
    fn take_setpoint(&mut self, now_ns: u64, inputs: &Inputs) {
        let taken = self.slot.take(now_ns, &inputs.position_owner, &inputs.attitude_setpoint);
        if let Some(command) = taken {
            let [thrust_n, roll, pitch, yaw] = command.value;
            self.setpoint = Setpoint { gamma_rad: Vector3::new(roll, pitch, yaw), thrust_n };
            self.setpoint_sequence = command.sequence;
        }
    }

    fn law_input(&self, now_ns: u64, inputs: &Inputs) -> Option<Input> {
        let limit_ns = (2 * self.period_ns).max(STALE_NS);
        let Link::Fresh(estimate) = inputs.state_estimate.link(now_ns, limit_ns) else {
            return None;
        };
        let q = &estimate.q_wb;
        let attitude = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z));
        let age_ns = now_ns.saturating_sub(estimate.header.valid_ns);
        Some(Input {
            gamma_rad: euler_from_quaternion(&attitude),
            body_rate_rad_s: estimate.body_rate_b_rad_s.into(),
            age_s: age_ns as f64 * 1e-9,
            morph_angle: MorphAngle::saturating_from_rad(estimate.morph_angle_rad)?,
            setpoint: self.setpoint,
            applied_torque_nm: applied(inputs).map(|applied| applied.torque_b_nm.into()),
        })
    }

    fn report(&self, output: &Output) -> ControllerReport {
        let mut report = ControllerReport {
            input: output.torque_nm.into(),
            previous_input: self.law.memory().previous_applied_nm,
            input_min: (-output.torque_bound_nm).into(),
            input_max: output.torque_bound_nm.into(),
            increment_max: output.increment_bound_nm.into(),
            relaxation: output.relaxation_nm.into(),
            iterations: u64::from(output.iterations),
            active_constraints: u64::from(output.active),
            thrust_n: output.thrust_n,
            arm_length_m: output.arm_length_m,
            yaw_coefficient_m: self.yaw_coefficient_m,
            rotor_thrust_max_n: output.rotor_bound_n,
            fallbacks: self.law.memory().counters.fallbacks,
            refused: self.law.memory().counters.refused,
            yielded: output.yielded,
            status: solve_status(output.status),
            ..ControllerReport::default()
        };
        if report.status == SolveStatus::Refused {
            // The last command is held: it obeyed the bounds of its own step.
            report.previous_input = report.input;
            report.input_min = report.input;
            report.input_max = report.input;
        }
        report
    }
}

/// What the gate applied, once there is a command.
fn applied(inputs: &Inputs) -> Option<&AppliedCommand> {
    inputs.applied_command.latest().filter(|applied| applied.command_sequence > 0)
}

/// The path of a command, or its angle if it has none.
fn plan(command: &MorphCommand, now_ns: u64) -> MorphPlan<'_> {
    let count = usize::try_from(command.count).unwrap_or(0).min(command.path_rad.len());
    MorphPlan {
        path_rad: match count {
            0 => core::slice::from_ref(&command.angle_rad),
            _ => &command.path_rad[..count],
        },
        spacing_s: command.spacing_ns.max(1) as f64 * 1e-9,
        age_s: now_ns.saturating_sub(command.header.valid_ns) as f64 * 1e-9,
    }
}

fn solve_status(status: LawStatus) -> SolveStatus {
    match status {
        LawStatus::Solved => SolveStatus::Solved,
        LawStatus::Fallback(QpStatus::Infeasible) => SolveStatus::Infeasible,
        LawStatus::Fallback(QpStatus::NotFinite) => SolveStatus::NotFinite,
        LawStatus::Fallback(_) => SolveStatus::IterationLimit,
        LawStatus::Refused(_) => SolveStatus::Refused,
    }
}

impl Service for AttitudeMpc {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = ComponentMemory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take_setpoint(now_ns, inputs);
        let Some(input) = self.law_input(now_ns, inputs) else {
            self.law.miss();
            return;
        };
        let plan = inputs.morph_command.latest().map(|command| plan(command, now_ns));
        let output = self.law.step_along(&input, plan.as_ref());
        outputs.wrench_command.write(WrenchCommand {
            thrust_n: output.thrust_n,
            torque_b_nm: output.torque_nm.into(),
            validity_ns: 2 * self.period_ns,
            ..WrenchCommand::default()
        });
        outputs.applied_setpoint.write(AppliedSetpoint {
            setpoint_sequence: self.setpoint_sequence,
            thrust_n: output.thrust_n,
            roll_rad: self.setpoint.gamma_rad.x,
            pitch_rad: self.setpoint.gamma_rad.y,
            yaw_rad: self.setpoint.gamma_rad.z,
            ..self.slot.applied()
        });
        outputs.attitude_report.write(self.report(&output));
    }

    fn track(&mut self, _now_ns: u64, inputs: &Inputs) {
        if let Some(applied) = applied(inputs) {
            self.law.track(&applied.torque_b_nm.into(), applied.thrust_n);
        }
    }

    fn memory(&self) -> ComponentMemory {
        let gamma = self.setpoint.gamma_rad;
        ComponentMemory {
            law: *self.law.memory(),
            setpoint: [gamma.x, gamma.y, gamma.z, self.setpoint.thrust_n],
            setpoint_sequence: self.setpoint_sequence,
            slot: self.slot.memory(),
        }
    }

    fn restore(&mut self, memory: &ComponentMemory) -> Result<(), String> {
        self.law.restore(&memory.law).map_err(|error| error.to_string())?;
        let [roll, pitch, yaw, thrust_n] = memory.setpoint;
        self.setpoint = Setpoint { gamma_rad: Vector3::new(roll, pitch, yaw), thrust_n };
        self.setpoint_sequence = memory.setpoint_sequence;
        self.slot.restore(&memory.slot);
        Ok(())
    }
}
