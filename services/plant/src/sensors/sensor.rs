//! What all sensors have in common.

use super::config::SensorError;
use crate::ports::Outputs;
use shared_types::TopicInfo;
use vehicle::Truth;

/// A function of its configuration, its seed and the truths it was shown, with noise of its own.
pub trait Sensor: Sized {
    /// What a scenario sets for it.
    type Config;
    /// Everything that evolves, as plain numbers.
    type Memory;
    /// One reading.
    type Reading;

    /// The topic on which it is published.
    const TOPIC: &'static TopicInfo;

    /// Readings per second \[Hz\]; 0 if there is no such sensor.
    fn rate_hz(config: &Self::Config) -> u32;

    /// A sensor whose first reading is due at 0 ns.
    ///
    /// # Errors
    /// [`SensorError`] for a value out of its range.
    fn new(config: &Self::Config, seed: u64) -> Result<Self, SensorError>;

    /// Looks at the vehicle at `now_ns`, and writes and returns what is due, if anything is.
    fn look(&mut self, now_ns: u64, truth: &Truth, outputs: &mut Outputs) -> Option<Self::Reading>;

    /// Everything that evolves.
    fn memory(&self) -> Self::Memory;

    /// Continues from a memory, bit for bit.
    fn restore(&mut self, memory: &Self::Memory);

    /// Draws from the stream of another seed from now on.
    fn reseed(&mut self, seed: u64);
}
