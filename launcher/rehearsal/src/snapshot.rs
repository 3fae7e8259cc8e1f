//! The state of a vehicle at one instant as far as it is known on board, as plain numbers.

use serde::{Deserialize, Serialize};

/// The initial condition of a rehearsal. No field comes from the ground truth of a simulation, so that the
/// same is available on a real vehicle. Frames are world ENU (`_w_`) and body FLU (`_b_`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// The instant \[ns\].
    pub at_ns: u64,
    /// Estimated position \[m\].
    pub position_w_m: [f64; 3],
    /// Estimated velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Estimated attitude, body to world, Hamilton quaternion: w, x, y, z.
    pub q_wb: [f64; 4],
    /// Estimated angular velocity, in body axes \[rad/s\].
    pub body_rate_b_rad_s: [f64; 3],
    /// Estimated morph angle β \[rad\].
    pub morph_angle_rad: f64,
    /// Estimated rate of the morph angle \[rad/s\].
    pub morph_rate_rad_s: f64,
    /// One-sigma error of the position \[m\].
    pub position_sigma_w_m: [f64; 3],
    /// One-sigma error of the velocity \[m/s\].
    pub velocity_sigma_w_m_s: [f64; 3],
    /// One-sigma error of the attitude about the body axes \[rad\].
    pub attitude_sigma_b_rad: [f64; 3],
    /// One-sigma error of the gyro bias, worst axis \[rad/s\].
    pub gyro_bias_sigma_rad_s: f64,
    /// One-sigma error of the accelerometer bias, worst axis \[m/s²\].
    pub accelerometer_bias_sigma_m_s2: f64,
    /// Last commanded thrust of rotors 1 to 4 \[N\].
    pub rotor_thrust_n: [f64; 4],
    /// True if the actuation guard lets commands through; in any other mode nothing can be rehearsed.
    pub commanded: bool,
    /// Mean external force, without thrust, weight and drag in still air \[N\].
    pub force_w_n: [f64; 3],
    /// Mean external torque, without that of the rotors \[N m\].
    pub torque_b_nm: [f64; 3],
    /// Guidance orders in effect; their instants are in the time of the plan.
    pub guidance: Guidance,
}

/// The guidance orders to the pilot that are in effect; `None` where the plan applies.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guidance {
    /// Order for the position reference.
    pub position: Option<Way>,
    /// Order for the heading reference.
    pub yaw: Option<Turn>,
    /// Order for the morph angle.
    pub morph: Option<Turn>,
}

/// A motion of the position reference to a new goal, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Way {
    /// Beginning, in the time of the plan \[s\].
    pub begin_s: f64,
    /// Position at the beginning \[m\].
    pub from_w_m: [f64; 3],
    /// Velocity at the beginning \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Acceleration at the beginning \[m/s²\].
    pub acceleration_w_m_s2: [f64; 3],
    /// Position at rest at the end \[m\].
    pub goal_w_m: [f64; 3],
    /// Duration over which the initial velocity and acceleration decay to rest \[s\].
    pub brake_s: f64,
    /// Duration of the motion from the point to which braking alone would lead, to the goal \[s\].
    pub move_s: f64,
}

/// A motion of an angle to a new goal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// Beginning, in the time of the plan \[s\].
    pub begin_s: f64,
    /// Angle at the beginning \[rad\].
    pub from_rad: f64,
    /// Rate at the beginning \[rad/s\].
    pub rate_rad_s: f64,
    /// Angular acceleration at the beginning \[rad/s²\].
    pub acceleration_rad_s2: f64,
    /// Angle at rest at the end \[rad\].
    pub goal_rad: f64,
    /// Duration over which the initial rate and acceleration decay to rest \[s\].
    pub brake_s: f64,
    /// Duration of the motion from the angle to which braking alone would lead, to the goal \[s\].
    pub move_s: f64,
}

impl Snapshot {
    /// True if every number is finite and the attitude is a unit quaternion.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        let vectors = [
            self.position_w_m,
            self.velocity_w_m_s,
            self.body_rate_b_rad_s,
            self.position_sigma_w_m,
            self.velocity_sigma_w_m_s,
            self.attitude_sigma_b_rad,
            self.force_w_n,
            self.torque_b_nm,
        ];
        let [w, x, y, z] = self.q_wb;
        let scalars = [
            self.morph_angle_rad,
            self.morph_rate_rad_s,
            self.gyro_bias_sigma_rad_s,
            self.accelerometer_bias_sigma_m_s2,
        ];
        let mut numbers = vectors.iter().flatten().chain(&self.rotor_thrust_n).chain(&scalars);
        let norm = w * w + x * x + y * y + z * z;
        numbers.all(|number| number.is_finite()) && (norm - 1.0).abs() < 1e-3
    }
}
