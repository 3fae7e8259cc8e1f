//! launcher -> pilot and injector: what was ordered in flight.
//!
//! Each sample is complete: it contains everything that has been ordered so far and still holds, so that
//! the latest one is enough for a reader that joins late.

use crate::{Flag, Header, sample};

/// Capacity of [`DisturbanceOrder::entries`].
pub const DISTURBANCE_ORDERS: usize = 8;

sample! {
    /// A way from where the reference moved at an instant to a place to rest at.
    pub struct PositionDiversion {
        /// First instant of it \[ns\].
        pub begin_ns: u64,
        /// Position at that instant \[m\].
        pub from_w_m: [f64; 3],
        /// Velocity at that instant \[m/s\].
        pub velocity_w_m_s: [f64; 3],
        /// Acceleration at that instant \[m/s²\].
        pub acceleration_w_m_s2: [f64; 3],
        /// Where it rests in the end \[m\].
        pub goal_w_m: [f64; 3],
        /// Time in which the motion that it begins with dies out \[s\].
        pub brake_s: f64,
        /// Time of the way from where that alone would lead to the goal \[s\].
        pub move_s: f64,
        /// There is one; the rest means nothing otherwise.
        pub ordered: Flag,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
    }
}

sample! {
    /// The same for an angle.
    pub struct AngleDiversion {
        /// First instant of it \[ns\].
        pub begin_ns: u64,
        /// Angle at that instant \[rad\].
        pub from_rad: f64,
        /// Rate at that instant \[rad/s\].
        pub rate_rad_s: f64,
        /// Acceleration at that instant \[rad/s²\].
        pub acceleration_rad_s2: f64,
        /// Where it rests in the end \[rad\].
        pub goal_rad: f64,
        /// Time in which the motion that it begins with dies out \[s\].
        pub brake_s: f64,
        /// Time of the way from where that alone would lead to the goal \[s\].
        pub move_s: f64,
        /// There is one; the rest means nothing otherwise.
        pub ordered: Flag,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
    }
}

sample! {
    /// Where to go instead of what the scenario plans, and how wide to spread the arms.
    pub struct GuidanceOrder {
        /// Identity and time.
        pub header: Header,
        /// Of the position reference.
        pub position: PositionDiversion,
        /// Of the heading reference.
        pub yaw: AngleDiversion,
        /// Of the deployable angle.
        pub morph: AngleDiversion,
    }
}

crate::code! {
    /// What a disturbance that was ordered does.
    pub enum DisturbanceKind {
        /// Nothing.
        None = 0,
        /// Mean wind with gusts.
        Wind = 1,
        /// A force at the centre of mass.
        Force = 2,
        /// A torque.
        Torque = 3,
        /// A jump of the body rate.
        Kick = 4,
        /// A mass attached at the centre of mass.
        Payload = 5,
        /// A weak rotor.
        Rotor = 6,
    }
}

sample! {
    /// One disturbance; what its kind does not need is zero.
    pub struct OrderedDisturbance {
        /// Counts up from 1 over the flight; also distinguishes the noise of one from that of another.
        pub number: u64,
        /// First instant \[ns\].
        pub begin_ns: u64,
        /// First instant without it \[ns\].
        pub until_ns: u64,
        /// Mean wind \[m/s\].
        pub wind_w_m_s: [f64; 3],
        /// Standard deviation of the gusts \[m/s\].
        pub gust_sigma_w_m_s: [f64; 3],
        /// Force \[N\].
        pub force_w_n: [f64; 3],
        /// Torque \[N m\].
        pub torque_b_nm: [f64; 3],
        /// Jump of the body rate \[rad/s\].
        pub body_rate_kick_b_rad_s: [f64; 3],
        /// Mass \[kg\].
        pub payload_kg: f64,
        /// Thrust relative to a healthy rotor, 0 to 1.
        pub efficiency: f64,
        /// 1 front, 2 left, 3 rear, 4 right.
        pub rotor: u32,
        /// What it does.
        pub kind: DisturbanceKind,
    }
}

sample! {
    /// Disturbances beside those of the scenario's script.
    pub struct DisturbanceOrder {
        /// Identity and time.
        pub header: Header,
        /// Number of entries in use.
        pub count: u64,
        /// Those that hold, oldest first.
        pub entries: [OrderedDisturbance; DISTURBANCE_ORDERS],
        /// The script has been silenced.
        pub script_off: Flag,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
    }
}
