//! The pilot of a rig flight: an attitude step instead of a trajectory.

use super::error::within;
use super::flight::morph_command;
use super::{MorphKnot, MorphSchedule, PilotError, PilotInputs, PilotMemory, TakenUp};
use core::f64::consts::PI;
use runtime::{Service, outputs};
use shared_types::time::s_from_ns;
use shared_types::{AttitudeSetpoint, MorphCommand, topics};
use vehicle::{MAX_PITCH_RAD, MorphAngle, VehicleParameters};

outputs! {
    /// What the pilot of a rig flight writes, as the owner of the position slot.
    pub struct RigPilotOutputs {
        /// Thrust of hover and the attitude step.
        attitude_setpoint: AttitudeSetpoint = topics::ATTITUDE_SETPOINT,
        /// Commanded deployable angle, with its path.
        morph_command: MorphCommand = topics::MORPH_COMMAND,
    }
}

/// A step of the Euler angles (intrinsic z-y-x) from zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeStep {
    /// First instant with the new angles \[s\].
    pub at_s: f64,
    /// φ \[rad\].
    pub roll_rad: f64,
    /// θ \[rad\].
    pub pitch_rad: f64,
    /// ψ \[rad\].
    pub yaw_rad: f64,
}

/// The plan of a rig flight.
#[derive(Debug, Clone)]
pub struct RigPilotConfig {
    /// The attitude to step to.
    pub step: AttitudeStep,
    /// How wide to spread the arms; see [`MorphSchedule`].
    pub morph: Vec<MorphKnot>,
    /// Where in the plan the flight begins.
    pub taken_up: TakenUp,
}

impl Default for RigPilotConfig {
    /// Test I of the paper: the small vehicle, 0.2 rad about each axis at once, from the start.
    fn default() -> Self {
        Self {
            step: AttitudeStep { at_s: 0.0, roll_rad: 0.2, pitch_rad: 0.2, yaw_rad: 0.2 },
            morph: vec![MorphKnot { t_s: 0.0, angle_rad: MorphAngle::MIN.rad() }],
            taken_up: TakenUp::default(),
        }
    }
}

/// Publishes an attitude step at hover thrust and how wide to spread the arms.
#[derive(Debug, Clone)]
pub struct RigPilot {
    step: AttitudeStep,
    thrust_n: f64,
    morph: MorphSchedule,
    taken_up: TakenUp,
    steps: u64,
}

impl RigPilot {
    /// Checks a plan; of the vehicle the weight and the servo's rate limit matter.
    ///
    /// # Errors
    /// [`PilotError`] naming the parameter, its value and the remedy.
    pub fn new(config: &RigPilotConfig, vehicle: &VehicleParameters) -> Result<Self, PilotError> {
        let step = config.step;
        within("step.at_s", step.at_s, (0.0, 1e6))?;
        within("step.roll_rad", step.roll_rad, (-MAX_PITCH_RAD, MAX_PITCH_RAD))?;
        within("step.pitch_rad", step.pitch_rad, (-MAX_PITCH_RAD, MAX_PITCH_RAD))?;
        within("step.yaw_rad", step.yaw_rad, (-PI, PI))?;
        within("vehicle.weight_n", vehicle.weight_n(), (1e-6, 1e6))?;
        Ok(Self {
            step,
            thrust_n: vehicle.weight_n(),
            morph: MorphSchedule::new(&config.morph, vehicle.servo_rate_limit_rad_s)?,
            taken_up: config.taken_up,
            steps: 0,
        })
    }

    /// The schedule of the deployable angle.
    #[must_use]
    pub fn morph(&self) -> &MorphSchedule {
        &self.morph
    }

    fn setpoint(&self, plan_ns: u64) -> AttitudeSetpoint {
        let AttitudeStep { at_s, roll_rad, pitch_rad, yaw_rad } = self.step;
        let level = AttitudeSetpoint { thrust_n: self.thrust_n, ..AttitudeSetpoint::default() };
        if s_from_ns(plan_ns) < at_s {
            return level;
        }
        AttitudeSetpoint { roll_rad, pitch_rad, yaw_rad, ..level }
    }
}

impl Service for RigPilot {
    type Inputs = PilotInputs;
    type Outputs = RigPilotOutputs;
    type Memory = PilotMemory;

    fn step(&mut self, now_ns: u64, inputs: &PilotInputs, outputs: &mut RigPilotOutputs) {
        self.steps += 1;
        let (order, plan_ns) = self.taken_up.now(inputs.order.latest(), now_ns);
        outputs.attitude_setpoint.write(self.setpoint(plan_ns));
        outputs.morph_command.write(morph_command(&self.morph, order, plan_ns));
    }

    fn memory(&self) -> PilotMemory {
        PilotMemory { steps: self.steps }
    }

    fn restore(&mut self, memory: &PilotMemory) -> Result<(), String> {
        self.steps = memory.steps;
        Ok(())
    }
}
