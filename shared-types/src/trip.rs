//! monitor -> consumers of the slots: an owner that flies the vehicle out of what can be recovered.

use crate::{Header, Role, sample};

crate::code! {
    /// Why an owner tripped. The pair of fields that holds the number and its limit stands behind each.
    pub enum TripCause {
        /// The vehicle turns away from its set point: `angle_rad` is how far it will have turned away
        /// about roll and pitch once it can be stopped.
        AttitudeDeparts = 0,
        /// The tilt at which the vehicle can be stopped, `angle_rad`, is beyond what may be flown.
        TiltBeyond = 1,
        /// The heading turns away from its set point: `angle_rad`, as for `AttitudeDeparts`.
        HeadingDeparts = 2,
        /// Roll and pitch have not been where they are asked to be, by `angle_rad`, for `lasted_s`.
        AttitudeAstray = 3,
        /// The body rate swings from side to side: `reversals` of more than `rate_limit_rad_s`.
        RateOscillates = 4,
        /// The thrust is not the one that is asked for: `speed_m_s` of vertical speed have come of it.
        ThrustAstray = 5,
        /// The vehicle leaves its reference: `distance_m` away from it once it can be stopped, or, if
        /// `lasted_s` is not 0, away from it for all that time.
        PositionDeparts = 6,
        /// The vehicle sinks: `distance_m` of height are needed to stop it, and the limit is there.
        Sinks = 7,
        /// The set point asks for a tilt, `angle_rad`, that no position controller may ask for.
        SetpointBeyond = 8,
        /// The set point's tilt swings from side to side: `reversals` of more than `angle_limit_rad`.
        SetpointOscillates = 9,
        /// The owner of the attitude slot reports another set point than the one of the sequence that it names, or one
        /// that is long over, or of the position slot's owner what its record, trips and set points do not show. No number
        /// goes with it.
        ReportFalse = 10,
        /// The owner of the attitude slot still follows the owner of the position slot, which has tripped. No number goes
        /// with it.
        TripIgnored = 11,
        /// The set point asks for a thrust, `thrust_n`, that no position controller may ask for.
        ThrustBeyond = 12,
        /// The set point asks for another heading than the reference, by `angle_rad`, for `lasted_s`.
        HeadingAstray = 13,
        /// The commands have been more than the rotors give for `lasted_s` without a break.
        RotorsClipped = 14,
        /// The actuation gate has had to level the vehicle, whose tilt would else have passed `angle_limit_rad`.
        Overturns = 15,
        /// Torque that is full for `lasted_s` turns the vehicle beyond its set point, by `angle_rad` before it can stop.
        TurnsBeyond = 16,
    }
}

sample! {
    /// The monitor's verdict that the owner of a slot is not to be followed any more. Published once per epoch.
    ///
    /// From its effective instant on the owner is not followed any more, but the fallback of this epoch's record, if it
    /// has one: in the position slot once two of the fallback's periods are over, for which attitude controllers
    /// follow the reference by themselves. A trip of a seat that is not its owner's, or of an epoch before the first that names owner and fallback
    /// of now, means nothing.
    #[derive(PartialEq)]
    pub struct Trip {
        /// Identity and time.
        pub header: Header,
        /// Epoch of the owner record by which the owner was judged.
        pub epoch: u64,
        /// Angle that tripped \[rad\]; 0 if none did, as in all pairs below.
        pub angle_rad: f64,
        /// Its limit \[rad\].
        pub angle_limit_rad: f64,
        /// Body rate that tripped \[rad/s\].
        pub rate_rad_s: f64,
        /// Its limit \[rad/s\].
        pub rate_limit_rad_s: f64,
        /// Distance that tripped \[m\].
        pub distance_m: f64,
        /// Its limit \[m\].
        pub distance_limit_m: f64,
        /// Speed that tripped \[m/s\].
        pub speed_m_s: f64,
        /// Its limit \[m/s\].
        pub speed_limit_m_s: f64,
        /// Thrust that tripped \[N\].
        pub thrust_n: f64,
        /// Its limit \[N\].
        pub thrust_limit_n: f64,
        /// How long it has been so \[s\].
        pub lasted_s: f64,
        /// Changes of side counted.
        pub reversals: u64,
        /// Slot of the owner: [`Role::Position`] or [`Role::Attitude`].
        pub slot: Role,
        /// The owner's instance.
        pub instance: u32,
        /// What went wrong.
        pub cause: TripCause,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
    }
}
