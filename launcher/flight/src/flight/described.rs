//! What the processes of a flight find in the run's folder, also when their launcher has died.

use super::Flight;
use simulate::Speed;
use simulate::setup::{RunError, RunOptions, system};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// What describes the flight to its processes.
pub(super) struct Described {
    /// The run's folder.
    folder: PathBuf,
    flight: host::Flight,
}

impl Described {
    /// Of a flight that is to be flown.
    pub(super) fn flight(options: &RunOptions) -> Result<host::Flight, RunError> {
        let flight = options.scenario.flight();
        let mut flight = flight.map_err(|error| RunError::Wiring(error.to_string()))?;
        if let Speed::Times(times) = options.speed {
            flight.speed = times;
        }
        Ok(flight)
    }

    /// Leaves it in a run's folder, and the scenario beside it.
    pub(super) fn leave(
        folder: &Path,
        options: &RunOptions,
        flight: host::Flight,
    ) -> Result<Self, RunError> {
        let scenario = folder.join("scenario.toml");
        fs::write(&scenario, options.scenario.to_toml())
            .map_err(system(format!("write {}", scenario.display())))?;
        flight
            .write(folder)
            .map_err(system(format!("describe the flight in {}", folder.display())))?;
        Ok(Self { folder: folder.to_path_buf(), flight })
    }

    /// What the launcher before has left there.
    pub(super) fn left(folder: &Path) -> Result<Self, RunError> {
        let flight = host::Flight::read(folder);
        let flight = flight.map_err(|error| RunError::Wiring(error.to_string()))?;
        Ok(Self { folder: folder.to_path_buf(), flight })
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
