//! estimator -> controllers: what the vehicle is believed to do.

use crate::{Flag, Header, Quaternion, Sample, sample};

sample! {
    /// State estimate with the diagonal of its error covariance, which grows while the IMU is silent.
    pub struct StateEstimate {
        /// Identity and time.
        pub header: Header,
        /// Logical instant of the last IMU sample in it \[ns\]: what is believed is believed of this instant.
        pub described_ns: u64,
        /// Position \[m\].
        pub position_w_m: [f64; 3],
        /// Velocity \[m/s\].
        pub velocity_w_m_s: [f64; 3],
        /// Attitude, body to world.
        pub q_wb: Quaternion,
        /// Body rate, gyro bias removed \[rad/s\].
        pub body_rate_b_rad_s: [f64; 3],
        /// Specific force, accelerometer bias removed [m/s^2].
        pub specific_force_b_m_s2: [f64; 3],
        /// Gyro bias \[rad/s\].
        pub gyro_bias_b_rad_s: [f64; 3],
        /// Accelerometer bias [m/s^2].
        pub accelerometer_bias_b_m_s2: [f64; 3],
        /// Deployable angle \[rad\].
        pub morph_angle_rad: f64,
        /// Rate of the deployable angle \[rad/s\].
        pub morph_rate_rad_s: f64,
        /// One-sigma error of the position \[m\].
        pub position_sigma_w_m: [f64; 3],
        /// One-sigma error of the velocity \[m/s\].
        pub velocity_sigma_w_m_s: [f64; 3],
        /// One-sigma error of the attitude about the body axes \[rad\].
        pub attitude_sigma_b_rad: [f64; 3],
        /// One-sigma error of the gyro bias \[rad/s\].
        pub gyro_bias_sigma_b_rad_s: [f64; 3],
        /// One-sigma error of the accelerometer bias [m/s^2].
        pub accelerometer_bias_sigma_b_m_s2: [f64; 3],
        /// Normalised innovation squared of the last pose fix (6 degrees of freedom).
        pub pose_fix_nis: f64,
        /// Pose fixes refused by the innovation gate so far.
        pub pose_fixes_gated: u64,
        /// Times the covariance was re-opened after inconsistent innovations.
        pub covariance_reopened: u64,
        /// Samples refused as not finite, out of range, out of order or too old.
        pub samples_refused: u64,
        /// Times the IMU was silent for longer than can be integrated so far, this time included.
        pub imu_gaps: u64,
        /// The windowed innovation test currently fails.
        pub nis_alarm: Flag,
        /// The IMU has been silent for longer than can be integrated.
        pub imu_overdue: Flag,
        /// No pose fix has been accepted for the configured timeout.
        pub fix_overdue: Flag,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
    }
}

impl Sample for StateEstimate {
    fn header(&self) -> &Header {
        &self.header
    }

    fn header_mut(&mut self) -> &mut Header {
        &mut self.header
    }

    fn described_ns(&self) -> u64 {
        self.described_ns
    }
}
