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
    /// Takes what the owner reports in a step. A controller that `has_paused` continues from what took the place of its
    /// last set point, by the backup law of the attitude loop; at any other time no report without a set point is believed.
    pub fn take(&mut self, inputs: &Inputs, has_paused: bool) {
        let Some(sample) = in_command(inputs) else { return };
        self.set(sample, has_paused && self.setpoint.is_some());
    }

    /// The same for a controller that shadows: what is in effect since before it began counts as well.
    pub fn take_shadowing(&mut self, inputs: &Inputs) {
        self.take(inputs, false);
        let (owner, latest) = (&inputs.attitude_owner, inputs.applied_setpoint.latest());
        if let (None, Some(latest)) = (self.setpoint, latest)
            && owner.authority_of(&latest.header) == Authority::Owner
        {
            self.set(latest, false);
        }
    }

    fn set(&mut self, sample: &AppliedSetpoint, takes_faded: bool) {
        self.setpoint = if takes_faded && sample.setpoint_sequence == 0 {
            Some(Setpoint::in_effect(sample))
        } else {
            Setpoint::of_applied(sample)
        };
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

#[cfg(test)]
mod tests {
    use super::*;
    use runtime::InputSet as _;

    /// What the attitude slot's owner reports in a step.
    fn reported(at_ns: u64, setpoint_sequence: u64, roll_rad: f64) -> Inputs {
        let mut inputs = Inputs::default();
        // A seat without a process has no authority.
        let period_ns = [2; 4];
        inputs.attitude_owner.offer(OwnerRecord { epoch: 1, period_ns, ..OwnerRecord::default() });
        let mut sample =
            AppliedSetpoint { setpoint_sequence, roll_rad, ..AppliedSetpoint::default() };
        (sample.header.sequence, sample.header.valid_ns) = (1, at_ns);
        inputs.applied_setpoint.offer(sample);
        inputs.accept(at_ns, at_ns.checked_sub(5));
        inputs
    }

    #[test]
    fn what_has_faded_counts_for_a_controller_that_has_paused_and_for_no_other() {
        let roll_rad = |tracked: &Tracked| tracked.setpoint.map(|setpoint| setpoint.gamma_rad.x);
        let mut tracked = Tracked::default();
        tracked.take(&reported(5, 0, 0.1), true);
        assert_eq!(roll_rad(&tracked), None, "before the first set point");
        tracked.take(&reported(10, 7, 0.3), false);
        assert_eq!(roll_rad(&tracked), Some(0.3));
        let before = tracked;
        tracked.take(&reported(20, 0, 0.05), true);
        assert_eq!(roll_rad(&tracked), Some(0.05));
        tracked = before;
        tracked.take(&reported(20, 0, 0.05), false);
        assert_eq!(roll_rad(&tracked), None);
    }
}
