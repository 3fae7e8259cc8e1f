//! plant -> estimator: the readings of the vehicle's sensors.

use crate::{Flag, Header, Quaternion, sample};

sample! {
    /// Inertial measurement at the sample's instant.
    pub struct Imu {
        /// Identity and time.
        pub header: Header,
        /// Angular rate of the body \[rad/s\].
        pub gyro_b_rad_s: [f64; 3],
        /// Specific force (acceleration minus gravity) [m/s^2].
        pub specific_force_b_m_s2: [f64; 3],
        /// A component left the sensor's range and was clipped.
        pub saturated: Flag,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
    }
}

sample! {
    /// Pose from an external tracker, delivered late and stamped at capture.
    pub struct PoseFix {
        /// Identity and time; `valid_ns` is the arrival.
        pub header: Header,
        /// Logical instant at which the pose was true \[ns\].
        pub captured_ns: u64,
        /// Position \[m\].
        pub position_w_m: [f64; 3],
        /// Attitude, body to world.
        pub q_wb: Quaternion,
    }
}

sample! {
    /// Encoder reading of the deployable angle.
    pub struct MorphAngle {
        /// Identity and time.
        pub header: Header,
        /// Deployable angle of the arms \[rad\].
        pub angle_rad: f64,
    }
}

sample! {
    /// Height by air pressure, with a bias that walks.
    pub struct Barometer {
        /// Identity and time.
        pub header: Header,
        /// Height above the world's origin \[m\].
        pub height_w_m: f64,
    }
}

sample! {
    /// Reading of a range finder that looks along the body's -z axis.
    pub struct RangeFinder {
        /// Identity and time.
        pub header: Header,
        /// Distance to the ground along that axis \[m\].
        pub range_m: f64,
    }
}
