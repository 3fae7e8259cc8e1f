//! What the processes find in the run's folder when their launcher has died.

use super::Flight;
use std::io;
use std::path::PathBuf;

/// What describes the flight to its processes.
pub(super) struct Described {
    /// The run's folder.
    folder: PathBuf,
    flight: host::Flight,
}

impl Described {
    pub(super) fn new(folder: PathBuf, flight: host::Flight) -> Self {
        Self { folder, flight }
    }

    /// Notes how long a landing takes, if that is longer than before \[s\].
    fn extend_landing(&mut self, landing_s: f64) -> io::Result<()> {
        if landing_s <= self.flight.landing_s {
            return Ok(());
        }
        self.flight.landing_s = landing_s;
        self.flight.write(&self.folder)
    }
}

impl Flight {
    /// A vehicle that is sent higher than it ever was needs longer to land, should this launcher die.
    pub(super) fn note_landing(&mut self) {
        if let Err(error) = self.described.extend_landing(self.orders.landing_s()) {
            self.notice(&format!(
                "cannot note how long a landing takes ({error}): without a launcher the processes may leave before it"
            ));
        }
    }
}
