//! The position MPC as a process: reference and state estimate in, attitude set point out.

use crate::law::{Input, LawStatus, Output, PositionLaw, Setpoint};
use crate::memory::Memory;
use crate::{ConfigError, PositionLawConfig};
use controller::preview::{Landing, preview};
use mpc::QpStatus;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use runtime::{Link, Service, Standing, inputs, outputs};
use shared_types::{
    AppliedSetpoint, AttitudeSetpoint, ControllerReport, MorphCommand, OwnerRecord, Reference,
    SolveStatus, StateEstimate, topics,
};
use vehicle::{VehicleParameters, euler_from_quaternion};

inputs! {
    /// What the position loop reads; its set points descend from the state estimate.
    pub struct Inputs {
        /// Believed state.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// Trajectory to follow.
        reference: Reference = topics::REFERENCE,
        /// Set point in use at the attitude loop.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// Planned path of the deployable angle.
        morph_command: MorphCommand = topics::MORPH_COMMAND,
        /// Owner of the attitude slot.
        attitude_owner: OwnerRecord = topics::ATTITUDE_OWNER,
    }
}

outputs! {
    /// What the position loop writes.
    pub struct Outputs {
        /// Thrust and Euler angles for the attitude loop.
        attitude_setpoint: AttitudeSetpoint = topics::ATTITUDE_SETPOINT,
        /// Bounds, verdict and effort.
        position_report: ControllerReport = topics::POSITION_REPORT,
    }
}

shared_types::memory! {
    /// Everything that evolves.
    pub struct ComponentMemory {
        /// The control law's memory.
        pub law: Memory,
        /// Set point that the attitude slot's owner tracks: φ, θ, ψ [rad] and T [N].
        pub applied: [f64; 4],
        /// Whether there is one.
        pub has_applied: bool,
        /// Release of the step that said so \[ns\].
        pub applied_release_ns: u64,
    }
}

/// The position MPC between its ports.
#[derive(Debug)]
pub struct PositionMpc {
    law: PositionLaw,
    period_s: f64,
    period_ns: u64,
    landing: Landing,
    /// Reference over the horizon, reused every step.
    points: Vec<Vector3<f64>>,
    /// Set point that the attitude slot's owner tracks.
    applied: Option<Setpoint>,
    /// Release of the step that said so \[ns\].
    applied_release_ns: u64,
}

impl PositionMpc {
    /// A controller at trim.
    ///
    /// # Errors
    /// The configuration is impossible.
    pub fn new(
        config: PositionLawConfig,
        vehicle: &VehicleParameters,
        landing: Landing,
    ) -> Result<Self, ConfigError> {
        let period_s = 1.0 / config.rate_hz;
        let points = vec![Vector3::zeros(); config.horizon.prediction];
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let period_ns = (1e9 * period_s).ceil() as u64;
        let law = PositionLaw::new(config, vehicle)?;
        Ok(Self { law, period_s, period_ns, landing, points, applied: None, applied_release_ns: 0 })
    }

    /// Takes what the attitude slot's owner says it tracks; shadows say so too.
    fn take_applied(&mut self, inputs: &Inputs) {
        if let Some(sample) = inputs.applied_setpoint.in_command(&inputs.attitude_owner) {
            self.applied = applied(sample);
            self.applied_release_ns = sample.header.release_ns;
        }
    }

    fn report(&self, output: &Output) -> ControllerReport {
        let state = &self.law.memory().state;
        let mut report = ControllerReport {
            input: output.command.into(),
            previous_input: [state[9], state[10], state[11]],
            input_min: output.command_min.into(),
            input_max: output.command_max.into(),
            increment_max: output.increment_bound.into(),
            relaxation: output.relaxation.into(),
            iterations: u64::from(output.iterations),
            active_constraints: u64::from(output.active),
            fallbacks: self.law.memory().counters.fallbacks,
            refused: self.law.memory().counters.refused,
            yielded: output.yielded,
            status: solve_status(output.status),
            ..ControllerReport::default()
        };
        if report.status == SolveStatus::Refused {
            // The last set point is held: it obeyed the bounds of its own step.
            report.previous_input = report.input;
            report.input_min = report.input;
            report.input_max = report.input;
        }
        report
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

fn applied(sample: &AppliedSetpoint) -> Option<Setpoint> {
    (sample.setpoint_sequence > 0).then(|| Setpoint {
        gamma_rad: Vector3::new(sample.roll_rad, sample.pitch_rad, sample.yaw_rad),
        thrust_n: sample.thrust_n,
    })
}

impl Service for PositionMpc {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = ComponentMemory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take_applied(inputs);
        let estimate = inputs.state_estimate.link(now_ns, 2 * self.period_ns);
        let (Link::Fresh(estimate), Some(reference)) = (estimate, inputs.reference.latest()) else {
            // The attitude loop keeps the last set point.
            self.law.miss();
            return;
        };
        let yaw_rad = preview(reference, now_ns, self.period_s, &self.landing, &mut self.points);
        let q = &estimate.q_wb;
        let attitude = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z));
        let age_ns = now_ns.saturating_sub(estimate.header.valid_ns);
        let output = self.law.step(&Input {
            position_w_m: estimate.position_w_m.into(),
            velocity_w_m_s: estimate.velocity_w_m_s.into(),
            gamma_rad: euler_from_quaternion(&attitude),
            age_s: age_ns as f64 * 1e-9,
            reference_w_m: &self.points,
            reference_yaw_rad: yaw_rad,
            applied: self.applied,
        });
        let gamma = output.setpoint.gamma_rad;
        outputs.attitude_setpoint.write(AttitudeSetpoint {
            thrust_n: output.setpoint.thrust_n,
            roll_rad: gamma.x,
            pitch_rad: gamma.y,
            yaw_rad: gamma.z,
            ..AttitudeSetpoint::default()
        });
        outputs.position_report.write(self.report(&output));
    }

    fn track(&mut self, now_ns: u64, inputs: &Inputs) {
        self.take_applied(inputs);
        let (owner, latest) = (&inputs.attitude_owner, inputs.applied_setpoint.latest());
        if let (None, Some(latest)) = (self.applied, latest)
            && owner.standing_of(&latest.header) == Standing::Owner
        {
            // In effect since before this controller began.
            self.applied = applied(latest);
            self.applied_release_ns = latest.header.release_ns;
        }
        if let Some(setpoint) = self.applied {
            // Chosen before the set point of k−1 could be in effect.
            let late = self.applied_release_ns + self.period_ns <= now_ns;
            self.law.track(&setpoint, late);
        }
    }

    fn memory(&self) -> ComponentMemory {
        let applied = self.applied.map_or([0.0; 4], |setpoint| {
            let gamma = setpoint.gamma_rad;
            [gamma.x, gamma.y, gamma.z, setpoint.thrust_n]
        });
        let has_applied = self.applied.is_some();
        let applied_release_ns = self.applied_release_ns;
        ComponentMemory { law: *self.law.memory(), applied, has_applied, applied_release_ns }
    }

    fn restore(&mut self, memory: &ComponentMemory) -> Result<(), String> {
        self.law.restore(&memory.law).map_err(|error| error.to_string())?;
        let [roll, pitch, yaw, thrust_n] = memory.applied;
        let setpoint = Setpoint { gamma_rad: Vector3::new(roll, pitch, yaw), thrust_n };
        self.applied = memory.has_applied.then_some(setpoint);
        self.applied_release_ns = memory.applied_release_ns;
        Ok(())
    }
}
