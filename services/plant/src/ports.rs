//! What the plant reads and writes.

use runtime::{inputs, outputs};
use shared_types::{
    ActuatorState, AppliedCommand, Barometer, Disturbance, Imu, MorphAngle, MorphCommand,
    OwnerRecord, PoseFix, RangeFinder, Reference, StateEstimate, Trip, Truth, WrenchCommand,
    topics,
};

inputs! {
    /// What acts on the vehicle.
    pub struct Inputs {
        /// Commands to the attitude slot.
        wrench_command: WrenchCommand = topics::WRENCH_COMMAND,
        /// Owner of the attitude slot.
        attitude_owner: OwnerRecord = topics::ATTITUDE_OWNER,
        /// Owners that are not to be followed any more.
        trip: Trip = topics::TRIP,
        /// Wind, forces, payload, rotor faults.
        disturbance: Disturbance = topics::DISTURBANCE,
        /// Commanded deployable angle.
        morph_command: MorphCommand = topics::MORPH_COMMAND,
        /// Believed state, for the gate alone.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// Where the gate goes by itself.
        reference: Reference = topics::REFERENCE,
    }
}

outputs! {
    /// The readings of the vehicle's sensors, what was applied, and the truth for the recorder.
    pub struct Outputs {
        /// Inertial measurement.
        imu: Imu = topics::IMU,
        /// Delayed pose.
        pose_fix: PoseFix = topics::POSE_FIX,
        /// Encoder reading.
        morph_angle: MorphAngle = topics::MORPH_ANGLE,
        /// Height by air pressure.
        barometer: Barometer = topics::BAROMETER,
        /// Distance to the ground below.
        range_finder: RangeFinder = topics::RANGE_FINDER,
        /// What the gate applied.
        applied_command: AppliedCommand = topics::APPLIED_COMMAND,
        /// Real state.
        truth: Truth = topics::TRUTH,
        /// Real rotor thrusts.
        actuator_state: ActuatorState = topics::ACTUATOR_STATE,
    }
}
