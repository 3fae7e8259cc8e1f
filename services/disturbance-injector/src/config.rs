//! The injector's section of a scenario.

use garde::Validate;
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
#[derive(Debug, Clone, Deserialize, Validate)]
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

/// Accepts finite numbers in [min, max]; a plain comparison would let NaN pass.
pub(crate) fn finite_in(min: f64, max: f64) -> impl Fn(&f64, &()) -> garde::Result {
    move |value, ()| {
        if (min..=max).contains(value) {
            Ok(())
        } else {
            Err(garde::Error::new(format!("{value} is not a number from {min} to {max}")))
        }
    }
}

/// Accepts a finite instant after `at_s`.
pub(crate) fn later_than(at_s: f64) -> impl Fn(&f64, &()) -> garde::Result {
    move |until, ()| {
        if *until > at_s && until.is_finite() {
            Ok(())
        } else {
            Err(garde::Error::new(format!("{until} does not lie after at_s = {at_s}")))
        }
    }
}

/// Accepts no instant, or one as in [`later_than`].
pub(crate) fn after(at_s: f64) -> impl Fn(&Option<f64>, &()) -> garde::Result {
    move |until, context| until.as_ref().map_or(Ok(()), |until| later_than(at_s)(until, context))
}
