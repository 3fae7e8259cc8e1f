//! Orders as sentences.

use super::{Calm, Disturb, Goto, Load, Morph, Order};
use core::fmt::{self, Display, Formatter};

/// A vector as a user types it.
struct Vector([f64; 3]);

impl Display for Vector {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0;
        write!(f, "{x} {y} {z}")
    }
}

impl Display for Order {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Goto(Goto { position_w_m, yaw_deg }) => {
                write!(f, "goto {} m", Vector(*position_w_m))?;
                yaw_deg.map_or(Ok(()), |yaw_deg| write!(f, ", heading {yaw_deg} deg"))
            }
            Self::Morph(Morph { angle_deg, over_s }) => {
                write!(f, "morph {angle_deg} deg over {over_s} s")
            }
            Self::Disturb(Disturb { load, for_s, .. }) => {
                write!(f, "disturb {load}")?;
                for_s.map_or(Ok(()), |for_s| write!(f, " for {for_s} s"))
            }
            Self::Calm(Calm { script: false }) => f.write_str("disturb off"),
            Self::Calm(Calm { script: true }) => f.write_str("disturb off, the script too"),
        }
    }
}

impl Display for Load {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Wind { mean_w_m_s, sigma_w_m_s } => {
                write!(f, "wind {} m/s", Vector(mean_w_m_s))?;
                if sigma_w_m_s.iter().all(|sigma| *sigma <= 0.0) {
                    return Ok(());
                }
                write!(f, ", gusts {} m/s", Vector(sigma_w_m_s))
            }
            Self::ForceWN(force) => write!(f, "force {} N", Vector(force)),
            Self::TorqueBNm(torque) => write!(f, "torque {} N m", Vector(torque)),
            Self::KickBRadS(rate) => write!(f, "kick {} rad/s", Vector(rate)),
            Self::PayloadKg(mass) => write!(f, "payload {mass} kg"),
            Self::Rotor { rotor, efficiency } => write!(f, "rotor {rotor} at {efficiency}"),
        }
    }
}
