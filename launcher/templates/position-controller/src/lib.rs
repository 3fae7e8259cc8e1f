//! my-position-controller: reference and state estimate in, thrust and attitude set point out.
//!
//! Position and velocity errors ask for an acceleration beside that of the reference, an integral holds
//! what is constantly missing, and the thrust is turned into that direction. Change
//! `Controller::acceleration`; the rest is what any position controller needs.

use host::{Config, Flight, HostError};
use nalgebra::Vector3;
use runtime::{Link, Service, inputs, outputs};
use serde::Deserialize;
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, OwnerRecord, PositionReport, Reference,
    Role, StateEstimate, topics,
};
use vehicle::VehicleParameters;

/// Largest roll and pitch \[rad\].
const TILT_MAX_RAD: f64 = 0.35;
/// Least and largest thrust over the weight.
const THRUST_WEIGHTS: [f64; 2] = [0.3, 2.0];
/// Without a reference for as long as the launcher's grace the vehicle sinks at this rate \[m/s\].
const LANDING_M_S: f64 = 0.5;

/// What can be tuned, with `--config FILE`.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Gains {
    /// Acceleration per position error, for x, y and z \[1/s²\].
    pub position_per_s2: [f64; 3],
    /// Acceleration per velocity error \[1/s\].
    pub velocity_per_s: [f64; 3],
    /// Integral time of the position error \[s\].
    pub integral_s: f64,
}

impl Default for Gains {
    /// As stiff against gusts as the attitude loop, which answers after some 55 ms, lets it be; the thrust
    /// answers at once.
    fn default() -> Self {
        Self {
            position_per_s2: [20.0, 20.0, 40.0],
            velocity_per_s: [5.5, 5.5, 8.0],
            integral_s: 1.2,
        }
    }
}

inputs! {
    /// What the controller reads; its set points descend from the first.
    pub struct Inputs {
        /// Believed state.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// Trajectory to follow.
        reference: Reference = topics::REFERENCE,
        /// Set point that the attitude slot tracks, whichever controller gave it.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// The last command of the rotors, with the controller that gave it.
        applied_command: AppliedCommand = topics::APPLIED_COMMAND,
        /// The owner of the attitude slot.
        attitude_owner: OwnerRecord = topics::ATTITUDE_OWNER,
    }
}

outputs! {
    /// What the controller writes.
    pub struct Outputs {
        /// Thrust and Euler angles for the attitude loop.
        attitude_setpoint: AttitudeSetpoint = topics::ATTITUDE_SETPOINT,
        /// Bounds and command, for the summary.
        position_report: PositionReport = topics::POSITION_REPORT,
    }
}

shared_types::memory! {
    /// Everything that evolves. A successor restores it and goes on bit for bit.
    #[derive(PartialEq)]
    pub struct Memory {
        /// Integral of the position error \[m/s²\].
        pub integral_m_s2: [f64; 3],
        /// Set point that the attitude slot's owner tracks: φ, θ, ψ [rad] and T [N].
        pub applied: [f64; 4],
        /// Whether there is one.
        pub has_applied: bool,
        /// Last command: θ₀, φ₀ [rad] and T [N], see `Controller::bounded`.
        pub command: [f64; 3],
    }
}

/// The controller.
#[derive(Debug)]
pub struct Controller {
    gains: Gains,
    vehicle: VehicleParameters,
    period_s: f64,
    hover_s: f64,
    memory: Memory,
}

/// What the law knows at a step.
#[derive(Debug, Clone, Copy)]
struct Sample {
    position_error_m: Vector3<f64>,
    velocity_error_m_s: Vector3<f64>,
    /// Of the reference.
    acceleration_m_s2: Vector3<f64>,
    /// Heading of the vehicle \[rad\].
    heading_rad: f64,
    /// Heading to take \[rad\].
    yaw_rad: f64,
}

impl Controller {
    /// At rest.
    ///
    /// # Errors
    /// The configuration cannot be read.
    pub fn new(flight: &Flight, config: &Config) -> Result<Self, HostError> {
        let rate_hz = flight.rate_hz(Role::Position).ok_or(HostError::NoSuchLoop("position"))?;
        let vehicle = flight.vehicle();
        let memory = Memory { command: [0.0, 0.0, vehicle.weight_n()], ..Memory::default() };
        let period_s = 1.0 / rate_hz;
        Ok(Self { gains: config.read()?, vehicle, period_s, hover_s: flight.hover_s, memory })
    }

    /// What is known now; `None` if it is too little, or too old, to fly on.
    fn sample(&self, now_ns: u64, inputs: &Inputs) -> Option<Sample> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let limit_ns = (2e9 * self.period_s).ceil() as u64;
        let Link::Fresh(estimate) = inputs.state_estimate.link(now_ns, limit_ns) else {
            return None;
        };
        let reference = inputs.reference.latest()?;
        let age_ns = now_ns.saturating_sub(reference.header.valid_ns);
        let count = usize::try_from(reference.count).ok()?.min(reference.points.len());
        let index = usize::try_from(age_ns / reference.spacing_ns.max(1)).ok()?;
        let is_over = index >= count;
        let last = count.checked_sub(1)?;
        let point = reference.points.get(index.min(last))?;
        let mut position = Vector3::from(point.position_w_m);
        let mut velocity = Vector3::from(point.velocity_w_m_s);
        let mut acceleration_m_s2 = Vector3::zeros();
        if is_over {
            // No process publishes a reference any more: hover, and land after a while.
            let landing_s = (age_ns as f64 * 1e-9 - self.hover_s).max(0.0);
            position.z = (position.z - LANDING_M_S * landing_s).max(0.0);
            velocity = Vector3::zeros();
        } else {
            let spacing_ns = reference.spacing_ns.max(1);
            let since_s = (age_ns % spacing_ns) as f64 * 1e-9;
            let next = Vector3::from(reference.points[(index + 1).min(last)].velocity_w_m_s);
            acceleration_m_s2 = (next - velocity) / (spacing_ns as f64 * 1e-9);
            position += (velocity + 0.5 * since_s * acceleration_m_s2) * since_s;
            velocity += since_s * acceleration_m_s2;
        }
        let q = &estimate.q_wb;
        let heading_rad =
            libm::atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
        Some(Sample {
            position_error_m: position - Vector3::from(estimate.position_w_m),
            velocity_error_m_s: velocity - Vector3::from(estimate.velocity_w_m_s),
            acceleration_m_s2,
            heading_rad,
            yaw_rad: point.yaw_rad,
        })
    }

    /// The law, without its integral: acceleration \[m/s²\].
    fn acceleration(&self, sample: &Sample) -> Vector3<f64> {
        sample.position_error_m.component_mul(&Vector3::from(self.gains.position_per_s2))
            + sample.velocity_error_m_s.component_mul(&Vector3::from(self.gains.velocity_per_s))
            + sample.acceleration_m_s2
    }

    /// θ₀ and φ₀ \[rad\], the tilt at heading zero, and T \[N\] for an acceleration, within bounds.
    fn bounded(&self, acceleration: &Vector3<f64>) -> Vector3<f64> {
        let gravity = self.vehicle.gravity_m_s2;
        let lift = (acceleration.z + gravity).max(0.1 * gravity);
        let tilt = |a: f64| libm::atan2(a, lift).clamp(-TILT_MAX_RAD, TILT_MAX_RAD);
        let (pitch, roll) = (tilt(acceleration.x), tilt(-acceleration.y));
        let upright = libm::cos(pitch) * libm::cos(roll);
        let [least, most] = THRUST_WEIGHTS.map(|weights| weights * self.vehicle.weight_n());
        Vector3::new(pitch, roll, (self.vehicle.mass_kg * lift / upright).clamp(least, most))
    }

    /// The acceleration of a command: the reverse of [`bounded`](Self::bounded) inside the bounds.
    fn acceleration_of(&self, command: &Vector3<f64>) -> Vector3<f64> {
        let upright = libm::cos(command.x) * libm::cos(command.y);
        let lift = command.z * upright / self.vehicle.mass_kg;
        let (x, y) = (libm::tan(command.x) * lift, -libm::tan(command.y) * lift);
        Vector3::new(x, y, lift - self.vehicle.gravity_m_s2)
    }

    /// Notes what the attitude slot's owner tracks; its shadows publish what they would, too.
    fn take_applied(&mut self, inputs: &Inputs) {
        let followed = inputs.applied_command.latest();
        let applied = inputs.applied_setpoint.in_command(&inputs.attitude_owner, followed);
        if let Some(sample) = applied.filter(|sample| sample.setpoint_sequence > 0) {
            self.memory.applied =
                [sample.roll_rad, sample.pitch_rad, sample.yaw_rad, sample.thrust_n];
            self.memory.has_applied = true;
        }
    }
}

/// (θ, φ) of the ψ = 0 frame from (φ, θ) at heading `psi`, and with `-psi` the way back.
fn turned(theta: f64, phi: f64, psi: f64) -> (f64, f64) {
    let (s, c) = libm::sincos(psi);
    (c * theta + s * phi, c * phi - s * theta)
}

impl Service for Controller {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = Memory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take_applied(inputs);
        let Some(sample) = self.sample(now_ns, inputs) else {
            // The attitude loop holds the last set point, and flies by itself if none follows.
            return;
        };
        let wish = self.acceleration(&sample) + Vector3::from(self.memory.integral_m_s2);
        let command = self.bounded(&wish);
        let given = self.acceleration_of(&command);
        for axis in 0..3 {
            let gain = self.gains.position_per_s2[axis] * self.period_s / self.gains.integral_s;
            let further = gain * sample.position_error_m[axis];
            // Beyond a bound it only comes back; rounding is no bound.
            let cut = given[axis] - wish[axis];
            if cut.abs() < 1e-9 || cut * further > 0.0 {
                self.memory.integral_m_s2[axis] += further;
            }
        }
        let (pitch_rad, roll_rad) = turned(command.x, command.y, -sample.heading_rad);
        outputs.attitude_setpoint.write(AttitudeSetpoint {
            thrust_n: command.z,
            roll_rad,
            pitch_rad,
            yaw_rad: sample.yaw_rad,
            ..AttitudeSetpoint::default()
        });
        let [least, most] = THRUST_WEIGHTS.map(|weights| weights * self.vehicle.weight_n());
        outputs.position_report.write(PositionReport {
            input: <[f64; 3]>::from(command).into(),
            previous_input: self.memory.command.into(),
            input_min: [-TILT_MAX_RAD, -TILT_MAX_RAD, least].into(),
            input_max: [TILT_MAX_RAD, TILT_MAX_RAD, most].into(),
            increment_max: [f64::INFINITY; 3].into(),
            ..PositionReport::default()
        });
        self.memory.command = command.into();
    }

    /// Before each step of a shadow: the integral takes what is flown and the law would not, so that
    /// the next set point continues from there and a change of hands is not felt.
    fn track(&mut self, now_ns: u64, inputs: &Inputs) {
        self.take_applied(inputs);
        if let Some(sample) = self.sample(now_ns, inputs).filter(|_| self.memory.has_applied) {
            let [roll_rad, pitch_rad, _, thrust_n] = self.memory.applied;
            let (pitch, roll) = turned(pitch_rad, roll_rad, sample.heading_rad);
            let command = Vector3::new(pitch, roll, thrust_n);
            self.memory.command = command.into();
            let flown = self.acceleration_of(&command);
            self.memory.integral_m_s2 = (flown - self.acceleration(&sample)).into();
        }
    }

    fn memory(&self) -> Memory {
        self.memory
    }

    fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        if !memory.integral_m_s2.iter().chain(&memory.applied).all(|number| number.is_finite()) {
            return Err("it holds a number that is not finite".to_owned());
        }
        self.memory = *memory;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Header, ReferencePoint, Sample as _};

    fn controller() -> Controller {
        let (gains, vehicle) = (Gains::default(), VehicleParameters::default());
        let memory = Memory { command: [0.0, 0.0, vehicle.weight_n()], ..Memory::default() };
        Controller { gains, vehicle, period_s: 0.02, hover_s: 2.0, memory }
    }

    /// Hovering at the origin, asked to be at `position_w_m`; the attitude loop tracks `applied`.
    fn inputs(position_w_m: [f64; 3], applied: Option<AppliedSetpoint>) -> Inputs {
        let mut inputs = Inputs::default();
        let q_wb = shared_types::Quaternion::IDENTITY;
        inputs.state_estimate.offer(StateEstimate { q_wb, ..StateEstimate::default() });
        let mut reference =
            Reference { spacing_ns: 1_000_000_000, count: 1, ..Reference::default() };
        reference.points[0] = ReferencePoint { position_w_m, ..ReferencePoint::default() };
        inputs.reference.offer(reference);
        let mut owner = OwnerRecord { epoch: 1, ..OwnerRecord::default() };
        owner.period_ns[0] = 10_000_000;
        inputs.attitude_owner.offer(owner);
        if let Some(mut applied) = applied {
            *applied.header_mut() = Header { sequence: 1, ..Header::default() };
            inputs.applied_setpoint.offer(applied);
        }
        inputs.state_estimate.accept(0, None);
        inputs.reference.accept(0, None);
        inputs.attitude_owner.accept(0, None);
        inputs.applied_setpoint.accept(0, None);
        inputs
    }

    fn command(controller: &mut Controller, inputs: &Inputs) -> [f64; 3] {
        controller.step(0, inputs, &mut Outputs::default());
        controller.memory.command
    }

    #[test]
    fn it_leans_towards_where_it_is_to_be_and_never_beyond_its_bounds() {
        for metres in [0.1, -0.1, 100.0, -100.0] {
            let [theta, phi, _] = command(&mut controller(), &inputs([metres, metres, 0.0], None));
            assert!(theta * metres > 0.0 && theta.abs() <= TILT_MAX_RAD, "{metres}: {theta}");
            assert!(phi * metres < 0.0 && phi.abs() <= TILT_MAX_RAD, "{metres}: {phi}");
            let [_, _, thrust_n] = command(&mut controller(), &inputs([0.0, 0.0, metres], None));
            let weights = thrust_n / VehicleParameters::default().weight_n();
            assert!((weights - 1.0) * metres > 0.0, "{metres}: {weights}");
            assert!((THRUST_WEIGHTS[0]..=THRUST_WEIGHTS[1]).contains(&weights));
        }
    }

    #[test]
    fn after_tracking_the_next_set_point_is_the_applied_one() {
        let applied = AppliedSetpoint {
            setpoint_sequence: 1,
            roll_rad: 0.05,
            pitch_rad: -0.1,
            thrust_n: 1.3,
            ..AppliedSetpoint::default()
        };
        let inputs = inputs([0.3, -0.2, 0.1], Some(applied));
        let mut controller = controller();
        controller.track(0, &inputs);
        let [theta, phi, thrust_n] = command(&mut controller, &inputs);
        assert!((theta + 0.1).abs() < 1e-9 && (phi - 0.05).abs() < 1e-9, "{theta} {phi}");
        assert!((thrust_n - 1.3).abs() < 1e-9, "{thrust_n}");
    }

    #[test]
    fn a_restored_successor_goes_on_bit_for_bit() {
        let inputs = inputs([0.3, -0.2, 0.1], None);
        let mut first = controller();
        command(&mut first, &inputs);
        let mut successor = controller();
        successor.restore(&first.memory()).expect("finite");
        let both = [command(&mut successor, &inputs), command(&mut first, &inputs)];
        let [ours, theirs] = both.map(|setpoint| setpoint.map(f64::to_bits));
        assert_eq!(ours, theirs);
        assert_eq!(successor.memory(), first.memory());
    }
}
