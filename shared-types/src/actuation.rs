//! plant -> controllers and recorder: what was applied, and what really happened.

use crate::{Flag, Header, Quaternion, sample};

crate::code! {
    /// Mode of the plant's actuation gate.
    pub enum GateMode {
        /// A valid command is in effect.
        Normal = 0,
        /// No valid command: the last one is held.
        Hold = 1,
        /// Still none: the gate flies the vehicle itself, along the reference, or level where it does not know where the
        /// vehicle is.
        Level = 2,
        /// Rotors off, for good.
        Cut = 3,
        /// The owner tripped while the vehicle was tilted or turning fast: the gate levels it from its own
        /// gyro and accelerometer before the fallback's commands count.
        Recover = 4,
    }
}

sample! {
    /// What the gate applied over the plant tick that ends at the sample's instant.
    pub struct AppliedCommand {
        /// Identity and time.
        pub header: Header,
        /// Sequence of the wrench command in effect; 0 while none is.
        #[identity]
        pub command_sequence: u64,
        /// IMU sample that the command in effect descends from.
        #[identity]
        pub command_cause_sequence: u64,
        /// Seat of the writer of the command in effect; [`NO_SEAT`](crate::NO_SEAT) while none is.
        #[identity]
        pub command_seat: u32,
        /// The owner has tripped: true until a record names another owner or fallback.
        #[identity]
        pub tripped: Flag,
        /// Epoch of the owner record in effect; 0 before the first.
        #[identity]
        pub epoch: u64,
        /// Allocated collective thrust, after rotor limits \[N\].
        pub thrust_n: f64,
        /// Allocated torque, after rotor limits \[N m\].
        pub torque_b_nm: [f64; 3],
        /// Commanded thrust of rotors 1 (front), 2 (left), 3 (rear), 4 (right) \[N\].
        pub rotor_thrust_n: [f64; 4],
        /// Commands refused because a number was not finite.
        pub refused_not_finite: u64,
        /// Commands refused because they ask for more than the rotors can ever give.
        pub refused_out_of_range: u64,
        /// Commands refused because their writer has no seat in the attitude slot any more.
        #[identity]
        pub refused_wrong_owner: u64,
        /// Commands of an owner that has not proven itself, reduced to what the laws of its slot may ask for.
        #[identity]
        pub reduced: u64,
        /// Times the gate left `Normal`.
        pub safe_mode_episodes: u64,
        /// Moves from owner to fallback so far.
        #[identity]
        pub fail_overs: u64,
        /// Epoch of the last owner record refused because it came too late; 0 for none.
        #[identity]
        pub refused_epoch: u64,
        /// Owner records refused so far.
        #[identity]
        pub refused_records: u64,
        /// Mode of the gate.
        pub mode: GateMode,
        /// Rotor limits changed the wrench.
        pub clipped: Flag,
        /// Seat whose commands count: the owner's, or after a fail-over the fallback's;
        /// [`NO_SEAT`](crate::NO_SEAT) before the first record.
        #[identity]
        pub seat: u32,
        /// The fallback commands: until the next epoch, after a trip for as long as `tripped`.
        #[identity]
        pub failed_over: Flag,
    }
}

sample! {
    /// The vehicle's real state; for the recorder only.
    pub struct Truth {
        /// Identity and time.
        pub header: Header,
        /// Position \[m\].
        pub position_w_m: [f64; 3],
        /// Velocity \[m/s\].
        pub velocity_w_m_s: [f64; 3],
        /// Attitude, body to world.
        pub q_wb: Quaternion,
        /// Body rate \[rad/s\].
        pub body_rate_b_rad_s: [f64; 3],
        /// Deployable angle \[rad\].
        pub morph_angle_rad: f64,
        /// Rate of the deployable angle \[rad/s\].
        pub morph_rate_rad_s: f64,
        /// Gyro bias \[rad/s\].
        pub gyro_bias_b_rad_s: [f64; 3],
        /// Accelerometer bias [m/s^2].
        pub accelerometer_bias_b_m_s2: [f64; 3],
    }
}

sample! {
    /// Real actuator state; for the recorder only.
    pub struct ActuatorState {
        /// Identity and time.
        pub header: Header,
        /// Thrust the rotors give, lag and efficiency included \[N\].
        pub rotor_thrust_n: [f64; 4],
        /// Thrust the rotors were asked for \[N\].
        pub rotor_command_n: [f64; 4],
        /// Morph servo's commanded angle \[rad\].
        pub morph_command_rad: f64,
    }
}
