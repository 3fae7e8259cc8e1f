//! The position PID as a process: reference and state estimate in, attitude set point out.

use crate::law::{Input, Memory, Output, PositionPidConfig, PositionPidLaw, Setpoint};
use controller::OutOfRange;
use controller::preview::{Landing, target};
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
        /// Set point that the attitude slot's owner tracks: φ, θ, ψ \[rad\] and T \[N\].
        pub applied: [f64; 4],
        /// Whether there is one.
        pub has_applied: bool,
    }
}

/// The position PID between its ports.
#[derive(Debug)]
pub struct PositionPid {
    law: PositionPidLaw,
    /// Set point that the attitude slot's owner tracks.
    applied: Option<Setpoint>,
    lead_s: f64,
    period_ns: u64,
    landing: Landing,
}

impl PositionPid {
    /// A controller at trim.
    ///
    /// # Errors
    /// The configuration is impossible.
    pub fn new(
        config: PositionPidConfig,
        vehicle: &VehicleParameters,
        landing: Landing,
    ) -> Result<Self, OutOfRange> {
        let law = PositionPidLaw::new(config, vehicle)?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let period_ns = (1e9 / config.rate_hz).ceil() as u64;
        Ok(Self { law, applied: None, lead_s: config.lead_s, period_ns, landing })
    }

    /// Takes what the attitude slot's owner says it tracks; shadows say so too.
    fn take_applied(&mut self, inputs: &Inputs) {
        if let Some(sample) = inputs.applied_setpoint.in_command(&inputs.attitude_owner) {
            self.applied = applied(sample);
        }
    }

    fn report(&self, output: &Output) -> ControllerReport {
        let status = if output.is_new { SolveStatus::Solved } else { SolveStatus::Refused };
        let refused = self.law.memory().refused;
        ControllerReport { refused, ..output.command.report(status) }
    }
}

fn applied(sample: &AppliedSetpoint) -> Option<Setpoint> {
    (sample.setpoint_sequence > 0).then(|| Setpoint {
        gamma_rad: Vector3::new(sample.roll_rad, sample.pitch_rad, sample.yaw_rad),
        thrust_n: sample.thrust_n,
    })
}

impl Service for PositionPid {
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
        let q = &estimate.q_wb;
        let attitude = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z));
        let output = self.law.step(&Input {
            position_w_m: estimate.position_w_m.into(),
            velocity_w_m_s: estimate.velocity_w_m_s.into(),
            gamma_rad: euler_from_quaternion(&attitude),
            age_s: now_ns.saturating_sub(estimate.header.valid_ns) as f64 * 1e-9,
            target: target(reference, now_ns, self.lead_s, &self.landing),
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

    fn track(&mut self, _now_ns: u64, inputs: &Inputs) {
        self.take_applied(inputs);
        let (owner, latest) = (&inputs.attitude_owner, inputs.applied_setpoint.latest());
        if let (None, Some(latest)) = (self.applied, latest)
            && owner.standing_of(&latest.header) == Standing::Owner
        {
            // In effect since before this controller began.
            self.applied = applied(latest);
        }
        if self.applied.is_some() {
            self.law.track();
        }
    }

    fn memory(&self) -> ComponentMemory {
        let applied = self.applied.map_or([0.0; 4], |setpoint| {
            let gamma = setpoint.gamma_rad;
            [gamma.x, gamma.y, gamma.z, setpoint.thrust_n]
        });
        ComponentMemory { law: *self.law.memory(), applied, has_applied: self.applied.is_some() }
    }

    fn restore(&mut self, memory: &ComponentMemory) -> Result<(), String> {
        self.law.restore(&memory.law)?;
        let [roll, pitch, yaw, thrust_n] = memory.applied;
        let setpoint = Setpoint { gamma_rad: Vector3::new(roll, pitch, yaw), thrust_n };
        self.applied = memory.has_applied.then_some(setpoint);
        Ok(())
    }
}
