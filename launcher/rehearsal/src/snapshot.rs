//! What a vehicle knows of itself at one instant, as plain numbers.

use serde::{Deserialize, Serialize};

/// What a rehearsal begins from. No field comes from the simulated world behind the sensors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// The instant \[ns\].
    pub at_ns: u64,
    /// Believed position \[m\].
    pub position_w_m: [f64; 3],
    /// Believed velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Believed attitude, body to world: w, x, y, z.
    pub q_wb: [f64; 4],
    /// Believed body rate \[rad/s\].
    pub body_rate_b_rad_s: [f64; 3],
    /// Believed deployable angle \[rad\].
    pub morph_angle_rad: f64,
    /// Its believed rate \[rad/s\].
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
    /// Thrust last commanded of rotors 1 to 4 \[N\].
    pub rotor_thrust_n: [f64; 4],
    /// The actuation guard lets commands through; in any other mode nothing can be rehearsed.
    pub commanded: bool,
    /// Mean force beside thrust, weight and the drag of still air \[N\].
    pub force_w_n: [f64; 3],
    /// Mean torque beside that of the rotors \[N m\].
    pub torque_b_nm: [f64; 3],
    /// Who commands the attitude slot.
    pub attitude: Instance,
    /// Who commands the position slot.
    pub position: Instance,
    /// What had been ordered of the pilot, with instants of its plan.
    pub guidance: Guidance,
}

/// Who commands a slot, by its consumer's own word.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// Epoch of the owner record in effect.
    pub epoch: u64,
    /// Process slot whose commands count.
    pub seat: u32,
    /// The fallback commands until the next epoch.
    pub failed_over: bool,
}

/// An order to the pilot that is in effect.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guidance {
    /// Of the position reference.
    pub position: Option<Way>,
    /// Of the heading reference.
    pub yaw: Option<Turn>,
    /// Of the deployable angle.
    pub morph: Option<Turn>,
}

/// A way that the position reference is on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Way {
    /// When it began \[s\].
    pub begin_s: f64,
    /// Where \[m\].
    pub from_w_m: [f64; 3],
    /// How fast \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// With which acceleration \[m/s²\].
    pub acceleration_w_m_s2: [f64; 3],
    /// Where it rests in the end \[m\].
    pub goal_w_m: [f64; 3],
    /// Time in which the motion that it began with dies out \[s\].
    pub brake_s: f64,
    /// Time of the way from where that alone would lead to the goal \[s\].
    pub move_s: f64,
}

/// A turn that an angle is on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// When it began \[s\].
    pub begin_s: f64,
    /// Angle there \[rad\].
    pub from_rad: f64,
    /// Rate there \[rad/s\].
    pub rate_rad_s: f64,
    /// Acceleration there \[rad/s²\].
    pub acceleration_rad_s2: f64,
    /// Angle at which it rests in the end \[rad\].
    pub goal_rad: f64,
    /// Time in which the motion that it began with dies out \[s\].
    pub brake_s: f64,
    /// Time of the way from where that alone would lead to the goal \[s\].
    pub move_s: f64,
}

impl Snapshot {
    /// True if every number is finite and the attitude a rotation.
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
