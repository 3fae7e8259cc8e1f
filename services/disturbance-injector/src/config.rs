//! The injector's section of a scenario.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use thiserror::Error;

use crate::Event;

/// Events in a script, at most: each has its place in the injector's memory.
pub const MAX_EVENTS: usize = 16;

/// Highest rate \[Hz\].
pub const MAX_RATE_HZ: f64 = 10_000.0;

/// A script that cannot be played.
#[derive(Debug, Error)]
pub enum InjectorError {
    /// A value is out of its range, or there are too many events.
    #[error("the disturbance script is not usable:\n{0}")]
    Config(#[from] garde::Report),
}

/// Rate and script.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct InjectorConfig {
    /// Samples per second.
    #[garde(range(min = 1.0, max = MAX_RATE_HZ))]
    pub rate_hz: f64,
    /// The events, in any order of time.
    #[garde(dive, custom(few_enough))]
    pub script: Vec<Event>,
}

impl Default for InjectorConfig {
    fn default() -> Self {
        Self { rate_hz: 200.0, script: Vec::new() }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that the validator calls")]
fn few_enough(script: &[Event], _context: &()) -> garde::Result {
    if script.len() <= MAX_EVENTS {
        return Ok(());
    }
    let count = script.len();
    Err(garde::Error::new(format!(
        "{count} events, but a script holds at most {MAX_EVENTS}: merge some or leave some out"
    )))
}
