//! Words for the clock of a flight and for its pace.

use schemars::JsonSchema;
use serde::de::{Deserializer, Visitor};
use serde::{Deserialize, Serialize};
use shared_types::ClockMode;

/// How the flight's clock runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// Simulated time.
    Lockstep,
    /// Logical time follows the wall clock.
    Realtime,
}

impl From<Clock> for ClockMode {
    fn from(clock: Clock) -> Self {
        match clock {
            Clock::Lockstep => Self::Lockstep,
            Clock::Realtime => Self::Realtime,
        }
    }
}

/// Logical seconds per wall second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    /// As fast as the machine can.
    Max,
    /// This many.
    Times(f64),
}

impl<'de> Deserialize<'de> for Speed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SpeedVisitor)
    }
}

struct SpeedVisitor;

impl Visitor<'_> for SpeedVisitor {
    type Value = Speed;

    fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("a number from 0.001 to 1000 or \"max\"")
    }

    fn visit_f64<E: serde::de::Error>(self, factor: f64) -> Result<Speed, E> {
        if (0.001..=1000.0).contains(&factor) {
            Ok(Speed::Times(factor))
        } else {
            Err(E::invalid_value(serde::de::Unexpected::Float(factor), &self))
        }
    }

    fn visit_i64<E: serde::de::Error>(self, factor: i64) -> Result<Speed, E> {
        i32::try_from(factor).map_err(E::custom).and_then(|factor| self.visit_f64(factor.into()))
    }

    fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<Speed, E> {
        if word == "max" {
            Ok(Speed::Max)
        } else {
            Err(E::invalid_value(serde::de::Unexpected::Str(word), &self))
        }
    }
}
