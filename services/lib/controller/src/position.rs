//! Between a position law and its ports: reference and state estimate in, attitude set point out.

use crate::Setpoint;
use runtime::{Authority, inputs, outputs};
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, MorphCommand, OwnerRecord, PositionReport,
    Reference, StateEstimate, topics,
};

inputs! {
    /// What a position loop reads; its set points descend from the state estimate.
    pub struct Inputs {
        /// Believed state.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// Trajectory to follow.
        reference: Reference = topics::REFERENCE,
        /// Set point in use at the attitude loop.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// The seat whose commands the plant follows.
        applied_command: AppliedCommand = topics::APPLIED_COMMAND,
        /// Planned path of the deployable angle.
        morph_command: MorphCommand = topics::MORPH_COMMAND,
        /// Owner of the attitude slot.
        attitude_owner: OwnerRecord = topics::ATTITUDE_OWNER,
    }
}

outputs! {
    /// What a position loop writes.
    pub struct Outputs {
        /// Thrust and Euler angles for the attitude loop.
        attitude_setpoint: AttitudeSetpoint = topics::ATTITUDE_SETPOINT,
        /// Bounds, verdict and effort.
        position_report: PositionReport = topics::POSITION_REPORT,
    }
}

/// What the controller that flies the attitude slot has reported of its set point in this step.
fn in_command(inputs: &Inputs) -> Option<&AppliedSetpoint> {
    inputs.applied_setpoint.in_command(&inputs.attitude_owner, inputs.applied_command.latest())
}

/// The set point that the attitude slot's owner tracks; shadows report what they track, too.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tracked {
    /// None until the owner has published.
    pub setpoint: Option<Setpoint>,
    /// Release of the step that reported it \[ns\].
    pub release_ns: u64,
}

impl Tracked {
    /// Takes what the owner reports in a step.
    pub fn take(&mut self, inputs: &Inputs) {
        if let Some(sample) = in_command(inputs) {
            self.set(sample);
        }
    }

    /// The same for a controller that shadows: what is in effect since before it began counts as well.
    pub fn take_shadowing(&mut self, inputs: &Inputs) {
        self.take(inputs);
        let (owner, latest) = (&inputs.attitude_owner, inputs.applied_setpoint.latest());
        if let (None, Some(latest)) = (self.setpoint, latest)
            && owner.authority_of(&latest.header) == Authority::Owner
        {
            self.set(latest);
        }
    }

    fn set(&mut self, sample: &AppliedSetpoint) {
        self.setpoint = Setpoint::of_applied(sample);
        self.release_ns = sample.header.release_ns;
    }

    /// φ, θ, ψ \[rad\] and T \[N\], zeros for none, and whether there is one.
    #[must_use]
    pub fn packed(&self) -> ([f64; 4], bool) {
        (self.setpoint.map_or([0.0; 4], <[f64; 4]>::from), self.setpoint.is_some())
    }

    /// The value that [`Tracked::packed`] and the release describe.
    #[must_use]
    pub fn unpacked(setpoint: [f64; 4], is_there: bool, release_ns: u64) -> Self {
        Self { setpoint: is_there.then(|| setpoint.into()), release_ns }
    }
}
