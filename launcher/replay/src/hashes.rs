//! The hashes of a recording, computed again from its samples.

use super::ReplayError;
use observe::{FlightHash, LogHash, kept_hash};
use record::read::{RecordVisitor, RecordedFlight};
use shared_types::{Sample, Topic};

/// Hashes of a recording, and those that the flight stored in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hashes {
    /// Flight hash of the samples in the file.
    pub flight: String,
    /// Log hash of the samples in the file.
    pub log: String,
    /// Flight hash stored at the end of the flight; none in a cut file, or of another form.
    pub stored_flight: Option<String>,
    /// Log hash stored at the end of the flight; none in a cut file, or of another form.
    pub stored_log: Option<String>,
}

impl Hashes {
    /// True if both were stored and agree with the samples.
    #[must_use]
    pub fn agree(&self) -> bool {
        self.stored_flight.as_ref() == Some(&self.flight)
            && self.stored_log.as_ref() == Some(&self.log)
    }
}

#[derive(Default)]
struct Both {
    flight: FlightHash,
    log: LogHash,
}

impl RecordVisitor for Both {
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.flight.add(&topic.info, sample);
        self.log.add(&topic.info, sample);
    }
}

/// Hashes every sample of a recording.
///
/// # Errors
/// The recording cannot be read.
pub fn hashes(flight: &RecordedFlight) -> Result<Hashes, ReplayError> {
    let mut both = Both::default();
    let closing = flight.visit(&mut both)?;
    let stored = |key: &str| kept_hash(&closing.summary, key).map(str::to_owned);
    Ok(Hashes {
        flight: both.flight.hex(),
        log: both.log.hex(),
        stored_flight: stored("hash"),
        stored_log: stored("log_hash"),
    })
}
