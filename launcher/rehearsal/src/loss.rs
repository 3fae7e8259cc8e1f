//! The ways to lose a vehicle.

use serde::{Deserialize, Serialize};

/// How a vehicle was lost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "how")]
pub enum Lost {
    /// The tilt is larger than can be recovered from.
    Tilted {
        /// Angle between body z and the vertical \[rad\].
        tilt_rad: f64,
        /// Its limit \[rad\].
        limit_rad: f64,
    },
    /// The vehicle is too far from its reference.
    Away {
        /// Distance from the reference \[m\].
        distance_m: f64,
        /// Its limit \[m\].
        limit_m: f64,
    },
    /// The vehicle touches the ground.
    Grounded {
        /// Height above the ground \[m\].
        height_m: f64,
        /// Its limit \[m\].
        limit_m: f64,
    },
    /// The actuation guard had to level the vehicle or cut its rotors, because no valid command came.
    Uncommanded,
    /// Tilt, position or height is not a finite number.
    NotFinite,
}
