//! Another recording of the same scenario that is another flight.

use core::fmt;
use serde::Serialize;

/// In simulated time a scenario is one flight, and what makes another one of it is named.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parted {
    /// The other recording.
    pub file: String,
    /// Release of the first sample that the two do not share \[s\].
    pub at_s: f64,
    /// Its topic.
    pub topic: String,
    /// The process that has published it.
    pub writer: String,
    /// Where the two part and why, as a sentence.
    pub text: String,
}

impl fmt::Display for Parted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, text, .. } = self;
        write!(f, "{file} is of the same scenario, and another flight: {text}")
    }
}
