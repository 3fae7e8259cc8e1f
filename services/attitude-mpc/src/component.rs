//! The attitude MPC as a process: state estimate and set point in, wrench command out.

use crate::law::{AttitudeLaw, Input, LawStatus, Output};
use crate::memory::Memory;
use crate::preview::MorphPlan;
use crate::{AttitudeLawConfig, ConfigError, Setpoint};
use controller::attitude::{Inputs, Outputs, applied, fresh_estimate, is_recovering};
use controller::sampling::{age_s, fallback_status, gamma_rad, period_ns};
use nalgebra::Vector3;
use runtime::{Service, SetpointMemory, SetpointSlot};
use shared_types::{
    AppliedSetpoint, AttitudeReport, BoundedInput, MorphCommand, SolveReport, SolveStatus,
    WrenchCommand,
};
use vehicle::{MorphAngle, VehicleParameters};

shared_types::memory! {
    /// Everything that evolves.
    pub struct ComponentMemory {
        /// The control law's memory.
        pub law: Memory,
        /// Set point in use: φ, θ, ψ [rad] and T [N].
        pub setpoint: [f64; 4],
        /// Sequence of the set point sample in use.
        pub setpoint_sequence: u64,
        /// The seat whose set point counts.
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
            period_ns: period_ns(rate_hz),
            yaw_coefficient_m: vehicle.yaw_coefficient_m,
            setpoint: Setpoint {
                gamma_rad: Vector3::new(0.0, 0.0, start_yaw_rad),
                thrust_n: vehicle.weight_n(),
            },
            setpoint_sequence: 0,
            slot: SetpointSlot::new(vehicle.weight_n(), vehicle.gravity_m_s2),
        })
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
            let [thrust_n, roll, pitch, yaw] = command.value;
            self.setpoint = Setpoint { gamma_rad: Vector3::new(roll, pitch, yaw), thrust_n };
            self.setpoint_sequence = command.sequence;
        }
    }

    fn law_input(&self, now_ns: u64, inputs: &Inputs) -> Option<Input> {
        let estimate = fresh_estimate(inputs, now_ns, self.period_ns)?;
        Some(Input {
            gamma_rad: gamma_rad(estimate),
            body_rate_rad_s: estimate.body_rate_b_rad_s.into(),
            age_s: age_s(estimate, now_ns),
            morph_angle: MorphAngle::saturating_from_rad(estimate.morph_angle_rad)?,
            setpoint: self.setpoint,
            applied_torque_nm: applied(inputs).map(|applied| applied.torque_b_nm.into()),
        })
    }

    fn report(&self, output: &Output) -> AttitudeReport {
        let counters = &self.law.memory().counters;
        let solve = SolveReport {
            fallbacks: counters.fallbacks,
            refused: counters.refused,
            iterations: u64::from(output.iterations),
            active_constraints: u64::from(output.active),
            status: solve_status(output.status),
            yielded: output.yielded,
        };
        let bounded = BoundedInput {
            input: output.torque_nm.into(),
            previous: self.law.memory().previous_applied_nm,
            min: (-output.torque_bound_nm).into(),
            max: output.torque_bound_nm.into(),
            increment_max: output.increment_bound_nm.into(),
            relaxation: output.relaxation_nm.into(),
        };
        let is_refused = solve.status == SolveStatus::Refused;
        AttitudeReport {
            thrust_n: output.thrust_n,
            arm_length_m: output.arm_length_m,
            yaw_coefficient_m: self.yaw_coefficient_m,
            rotor_thrust_max_n: output.rotor_bound_n,
            solve,
            ..if is_refused { bounded.held() } else { bounded }.into()
        }
    }
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
        age_s: age_s(command, now_ns),
    }
}

fn solve_status(status: LawStatus) -> SolveStatus {
    match status {
        LawStatus::Solved => SolveStatus::Solved,
        LawStatus::Fallback(status) => fallback_status(status),
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
            let reported = applied(inputs).map(|applied| applied.torque_b_nm.into());
            self.law.leave_out(1, reported);
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

    fn is_displaced(&self, inputs: &Inputs) -> bool {
        is_recovering(inputs)
    }

    fn skip(&mut self, left_out: u64) {
        self.law.leave_out(left_out, None);
    }

    fn memory(&self) -> ComponentMemory {
        ComponentMemory {
            law: *self.law.memory(),
            setpoint: self.setpoint.into(),
            setpoint_sequence: self.setpoint_sequence,
            slot: self.slot.memory(),
        }
    }

    fn restore(&mut self, memory: &ComponentMemory) -> Result<(), String> {
        self.law.restore(&memory.law).map_err(|error| error.to_string())?;
        self.setpoint = memory.setpoint.into();
        self.setpoint_sequence = memory.setpoint_sequence;
        self.slot.restore(&memory.slot);
        Ok(())
    }
}
