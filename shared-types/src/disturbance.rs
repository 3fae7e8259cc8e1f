//! disturbance-injector -> plant: what the world does to the vehicle.

use crate::{Header, sample};

sample! {
    /// Disturbance in effect from the sample's instant until the next one.
    pub struct Disturbance {
        /// Identity and time.
        pub header: Header,
        /// Wind velocity \[m/s\].
        pub wind_w_m_s: [f64; 3],
        /// External force \[N\].
        pub force_w_n: [f64; 3],
        /// External torque \[N m\].
        pub torque_b_nm: [f64; 3],
        /// Body-rate jump applied once, at the sample's instant \[rad/s\].
        pub body_rate_kick_b_rad_s: [f64; 3],
        /// Mass attached at the centre of mass \[kg\].
        pub payload_kg: f64,
        /// Thrust of each rotor relative to a healthy one, 0 to 1.
        pub rotor_efficiency: [f64; 4],
    }
}
