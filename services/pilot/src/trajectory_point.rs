//! Where a trajectory is at one instant.

/// The trajectory at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPoint {
    /// Position \[m\].
    pub position_w_m: [f64; 3],
    /// Velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Acceleration \[m/s²\].
    pub acceleration_w_m_s2: [f64; 3],
    /// Heading, unwrapped \[rad\].
    pub yaw_rad: f64,
}

impl TrajectoryPoint {
    pub(super) fn at_rest(position_w_m: [f64; 3], yaw_rad: f64) -> Self {
        let zero = [0.0; 3];
        Self { position_w_m, velocity_w_m_s: zero, acceleration_w_m_s2: zero, yaw_rad }
    }
}
