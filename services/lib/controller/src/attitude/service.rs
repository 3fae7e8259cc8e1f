//! An attitude loop between its ports: state estimate and set point in, wrench command out.

use super::{AttitudeLaw, AttitudeLoop, Measurement, Output, Setpoint, Timing};
use crate::sampling::{age_s, gamma_rad};
use runtime::arbiter::setpoints::SetpointSlot;
use runtime::{Link, Service, inputs, outputs};
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeReport, AttitudeSetpoint, GateMode, MorphCommand,
    OwnerRecord, Reference, StateEstimate, Trip, WrenchCommand, topics,
};
use vehicle::{MorphAngle, VehicleParameters};

/// An estimate older than this, and than two periods, is flown no more: the command lapses and the
/// plant's gate takes over, which goes by the IMU without an estimator \[ns\].
const STALE_NS: u64 = 20_000_000;

inputs! {
    /// What an attitude loop reads; its commands descend from the state estimate.
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
        /// Owners that are not to be followed any more.
        trip: Trip = topics::TRIP,
        /// Trajectory to follow while no set point counts.
        reference: Reference = topics::REFERENCE,
    }
}

outputs! {
    /// What an attitude loop writes.
    pub struct Outputs {
        /// Wrench asked of the rotors.
        wrench_command: WrenchCommand = topics::WRENCH_COMMAND,
        /// Set point in use.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// Bounds, verdict and effort.
        attitude_report: AttitudeReport = topics::ATTITUDE_REPORT,
    }
}

/// A service of the attitude slot.
#[derive(Debug)]
pub struct AttitudeController<L> {
    inner: AttitudeLoop<L>,
    slot: SetpointSlot,
    period_ns: u64,
}

impl<L: AttitudeLaw> AttitudeController<L> {
    /// A controller at trim: level, at the start's heading, until the first set point.
    #[must_use]
    pub fn new(law: L, vehicle: &VehicleParameters, timing: Timing, start_yaw_rad: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let period_ns = (1e9 * timing.period_s).ceil() as u64;
        let slot = SetpointSlot::new(vehicle.weight_n(), vehicle.gravity_m_s2);
        Self { inner: AttitudeLoop::new(law, vehicle, timing, start_yaw_rad), slot, period_ns }
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
        let slot = self.slot.memory();
        let common = self.inner.common_mut();
        common.slot = slot;
        if let Some(command) = taken {
            let [thrust_n, roll_rad, pitch_rad, yaw_rad] = command.value;
            common.setpoint = [roll_rad, pitch_rad, yaw_rad, thrust_n];
            common.setpoint_sequence = command.sequence;
        }
    }

    fn measurement(&self, now_ns: u64, inputs: &Inputs) -> Option<Measurement> {
        let estimate = fresh_estimate(inputs, now_ns, self.period_ns)?;
        Some(Measurement {
            gamma_rad: gamma_rad(estimate),
            body_rate_rad_s: estimate.body_rate_b_rad_s.into(),
            age_s: age_s(estimate, now_ns),
            morph_angle: MorphAngle::saturating_from_rad(estimate.morph_angle_rad)?,
            applied_nm: applied(inputs).map(|applied| applied.torque_b_nm.into()),
        })
    }

    fn report(&self, output: &Output, morph_angle: MorphAngle) -> AttitudeReport {
        let vehicle = self.inner.vehicle();
        AttitudeReport {
            thrust_n: output.thrust_n,
            arm_length_m: vehicle.geometry.arm_length_m(morph_angle),
            yaw_coefficient_m: vehicle.yaw_coefficient_m,
            rotor_thrust_max_n: f64::INFINITY,
            solve: output.torque.solve(output.is_new, self.inner.common().refused),
            ..output.torque.bounded().into()
        }
    }
}

/// What the gate applied, once there is a command.
#[must_use]
pub fn applied(inputs: &Inputs) -> Option<&AppliedCommand> {
    inputs.applied_command.latest().filter(|applied| applied.command_sequence > 0)
}

/// True while the plant brings the vehicle back by itself, for a trip.
#[must_use]
pub fn is_recovering(inputs: &Inputs) -> bool {
    inputs.applied_command.latest().is_some_and(|applied| applied.mode == GateMode::Recover)
}

/// The newest estimate, unless it is too old to be flown by a loop of this period \[ns\].
#[must_use]
pub fn fresh_estimate(inputs: &Inputs, now_ns: u64, period_ns: u64) -> Option<&StateEstimate> {
    match inputs.state_estimate.link(now_ns, (2 * period_ns).max(STALE_NS)) {
        Link::Fresh(estimate) => Some(estimate),
        _ => None,
    }
}

impl<L: AttitudeLaw> Service for AttitudeController<L> {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = L::Memory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take_setpoint(now_ns, inputs);
        let Some(measurement) = self.measurement(now_ns, inputs) else {
            let reported = applied(inputs).map(|applied| applied.torque_b_nm.into());
            self.inner.leave_out(1, reported);
            return;
        };
        let setpoint = Setpoint::from(self.inner.common().setpoint);
        let output = self.inner.step(&measurement, &setpoint);
        outputs.wrench_command.write(WrenchCommand {
            thrust_n: output.thrust_n,
            torque_b_nm: output.torque.input.into(),
            validity_ns: 2 * self.period_ns,
            ..WrenchCommand::default()
        });
        outputs.applied_setpoint.write(AppliedSetpoint {
            setpoint_sequence: self.inner.common().setpoint_sequence,
            // Of the set point that is named, also in a step that holds the last command.
            thrust_n: self.inner.thrust_n(&setpoint),
            roll_rad: setpoint.gamma_rad.x,
            pitch_rad: setpoint.gamma_rad.y,
            yaw_rad: setpoint.gamma_rad.z,
            ..self.slot.applied()
        });
        outputs.attitude_report.write(self.report(&output, measurement.morph_angle));
    }

    fn track(&mut self, _now_ns: u64, inputs: &Inputs) {
        if let Some(applied) = applied(inputs) {
            self.inner.track(&applied.torque_b_nm.into(), applied.thrust_n);
        }
    }

    fn is_displaced(&self, inputs: &Inputs) -> bool {
        is_recovering(inputs)
    }

    fn skip(&mut self, left_out: u64) {
        self.inner.leave_out(left_out, None);
    }

    fn memory(&self) -> L::Memory {
        self.inner.memory()
    }

    fn restore(&mut self, memory: &L::Memory) -> Result<(), String> {
        self.inner.restore(memory)?;
        self.slot.restore(&self.inner.common().slot);
        Ok(())
    }
}
