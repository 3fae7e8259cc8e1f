//! What can be ordered of the vehicle and the air around it while a flight is under way: where to go, how
//! wide to spread the arms, what to disturb.
//!
//! [`Order`] is an order as a user writes it, on the control socket or in a scenario's `[[order]]`.
//! [`Planner`] turns it into the sample that pilot or injector takes in, at an instant that neither has
//! reached: a reference leaves its plan smoothly from wherever it is by then.

mod planner;
mod sentences;
#[cfg(test)]
mod tests;

pub use planner::{OrderReport, Planned, Planner, RefusedOrder, Sent};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How far from the world's origin a vehicle may be sent \[m\].
pub const REACH_M: f64 = 100.0;
/// Lowest that it may be sent over ground \[m\].
pub const FLOOR_M: f64 = 0.2;
/// Shortest that a sweep of the arms may take; the servo asks for more \[s\].
const MIN_DURATION_S: f64 = 1e-3;
/// Longest that anything ordered may take or last \[s\].
pub const MAX_DURATION_S: f64 = 3600.0;

/// One order.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// Leave the plan and rest at a place.
    Goto(Goto),
    /// Leave the schedule and spread the arms.
    Morph(Morph),
    /// Disturb the vehicle.
    Disturb(Disturb),
    /// End what was ordered to disturb it.
    Calm(Calm),
}

/// A place to rest at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Goto {
    /// Where \[m\].
    pub position_w_m: [f64; 3],
    /// Heading there \[°\]; as it is, or as it was ordered before, if left out.
    #[serde(default)]
    pub yaw_deg: Option<f64>,
}

/// A width of the arms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Morph {
    /// β \[°\].
    pub angle_deg: f64,
    /// Time to get there \[s\].
    #[serde(default = "over_s")]
    pub over_s: f64,
}

/// Time of a sweep unless something else is asked for \[s\].
fn over_s() -> f64 {
    2.0
}

/// A disturbance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Disturb {
    /// What acts.
    pub load: Load,
    /// From when on, after the order is in effect \[s\].
    #[serde(default)]
    pub in_s: f64,
    /// For how long \[s\]; until it is ended if left out.
    #[serde(default)]
    pub for_s: Option<f64>,
}

/// What acts on the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Load {
    /// Mean wind with gusts.
    Wind {
        /// Mean \[m/s\].
        mean_w_m_s: [f64; 3],
        /// Standard deviation of the gusts \[m/s\].
        #[serde(default)]
        sigma_w_m_s: [f64; 3],
    },
    /// Force at the centre of mass \[N\].
    ForceWN([f64; 3]),
    /// Torque \[N m\].
    TorqueBNm([f64; 3]),
    /// Jump of the body rate, once \[rad/s\].
    KickBRadS([f64; 3]),
    /// Mass attached at the centre of mass \[kg\].
    PayloadKg(f64),
    /// A rotor that gives less than it should.
    Rotor {
        /// 1 front, 2 left, 3 rear, 4 right.
        rotor: u32,
        /// Thrust relative to a healthy one.
        efficiency: f64,
    },
}

/// An end of disturbances.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Calm {
    /// Also of those in the scenario's script.
    #[serde(default)]
    pub script: bool,
}

/// A number that cannot be ordered.
#[derive(Debug, Clone, PartialEq)]
pub struct OutOfRange {
    /// Where it stands within the order.
    pub key: String,
    /// What it is.
    pub value: f64,
    /// From and to, with the unit.
    pub range: String,
}

impl OutOfRange {
    /// As a sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        format!("{} {} is out of range: give a number {}", self.key, self.value, self.range)
    }
}

fn within(key: &str, value: f64, (min, max): (f64, f64), unit: &str) -> Result<(), OutOfRange> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(OutOfRange { key: key.to_owned(), value, range: format!("from {min} to {max} {unit}") })
}

fn each(key: &str, values: [f64; 3], limit: f64, unit: &str) -> Result<(), OutOfRange> {
    let mut values = values.into_iter().zip(["x", "y", "z"]);
    values.try_for_each(|(v, axis)| within(&format!("{key}.{axis}"), v, (-limit, limit), unit))
}

impl Order {
    /// Refuses numbers that make no sense in any flight; `floor_m` is the lowest place to rest at.
    ///
    /// # Errors
    /// The first of them, with its range.
    pub fn check(&self, floor_m: f64) -> Result<(), OutOfRange> {
        match self {
            Self::Goto(Goto { position_w_m: [x, y, z], yaw_deg }) => {
                within("x", *x, (-REACH_M, REACH_M), "m")?;
                within("y", *y, (-REACH_M, REACH_M), "m")?;
                within("z", *z, (floor_m, REACH_M), "m")?;
                within("yaw", yaw_deg.unwrap_or(0.0), (-360.0, 360.0), "deg")
            }
            Self::Morph(Morph { angle_deg, over_s }) => {
                within("angle", *angle_deg, (45.0, 160.0), "deg")?;
                within("over", *over_s, (MIN_DURATION_S, MAX_DURATION_S), "s")
            }
            Self::Disturb(Disturb { load, in_s, for_s }) => {
                load.check()?;
                within("in", *in_s, (0.0, MAX_DURATION_S), "s")?;
                within("for", for_s.unwrap_or(1.0), (0.001, MAX_DURATION_S), "s")
            }
            Self::Calm(_) => Ok(()),
        }
    }
}

impl Load {
    fn check(&self) -> Result<(), OutOfRange> {
        match *self {
            Self::Wind { mean_w_m_s, sigma_w_m_s } => {
                each("wind", mean_w_m_s, 100.0, "m/s")?;
                let sigmas = sigma_w_m_s.into_iter();
                let mut sigmas = sigmas.map(|sigma| within("gust", sigma, (0.0, 50.0), "m/s"));
                sigmas.try_for_each(|checked| checked)
            }
            Self::ForceWN(force) => each("force", force, 100.0, "N"),
            Self::TorqueBNm(torque) => each("torque", torque, 10.0, "N m"),
            Self::KickBRadS(rate) => each("kick", rate, 100.0, "rad/s"),
            Self::PayloadKg(mass) => within("payload", mass, (0.0, 10.0), "kg"),
            Self::Rotor { rotor, efficiency } => {
                within("rotor", rotor.into(), (1.0, 4.0), "(front, left, rear, right)")?;
                within("efficiency", efficiency, (0.0, 1.0), "(1 is a healthy rotor)")
            }
        }
    }
}
