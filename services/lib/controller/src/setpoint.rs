//! What a position loop asks of an attitude loop.

use nalgebra::Vector3;
use shared_types::{AppliedSetpoint, AttitudeSetpoint};

/// Attitude and collective thrust.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// γ = (φ, θ, ψ) \[rad\], intrinsic z-y-x.
    pub gamma_rad: Vector3<f64>,
    /// Collective thrust T \[N\].
    pub thrust_n: f64,
}

impl Setpoint {
    /// The one that an attitude loop reports as tracked; none before its first.
    #[must_use]
    pub fn of_applied(sample: &AppliedSetpoint) -> Option<Self> {
        (sample.setpoint_sequence > 0).then(|| Self::in_effect(sample))
    }

    /// What an attitude loop reports as tracked, be it a set point or what has taken its place.
    #[must_use]
    pub fn in_effect(sample: &AppliedSetpoint) -> Self {
        Self {
            gamma_rad: Vector3::new(sample.roll_rad, sample.pitch_rad, sample.yaw_rad),
            thrust_n: sample.thrust_n,
        }
    }

    /// As it is published.
    #[must_use]
    pub fn sample(&self) -> AttitudeSetpoint {
        AttitudeSetpoint {
            thrust_n: self.thrust_n,
            roll_rad: self.gamma_rad.x,
            pitch_rad: self.gamma_rad.y,
            yaw_rad: self.gamma_rad.z,
            ..AttitudeSetpoint::default()
        }
    }
}

/// φ, θ, ψ \[rad\] and T \[N\], as memories hold it.
impl From<[f64; 4]> for Setpoint {
    fn from([roll_rad, pitch_rad, yaw_rad, thrust_n]: [f64; 4]) -> Self {
        Self { gamma_rad: Vector3::new(roll_rad, pitch_rad, yaw_rad), thrust_n }
    }
}

impl From<Setpoint> for [f64; 4] {
    fn from(setpoint: Setpoint) -> Self {
        let gamma = setpoint.gamma_rad;
        [gamma.x, gamma.y, gamma.z, setpoint.thrust_n]
    }
}
