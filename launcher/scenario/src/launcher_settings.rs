//! The section `[launcher]` of a scenario.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

/// Timeouts and restarts of the launcher, in wall time but for the grace, which is a time of the flight.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct LauncherSettings {
    /// For all processes to be ready \[s\].
    #[garde(range(min = 0.1, max = 600.0))]
    pub startup_timeout_s: f64,
    /// Lockstep: without progress for this long a process is killed \[s\].
    #[garde(range(min = 0.1, max = 600.0))]
    pub stall_timeout_s: f64,
    /// Realtime: a process that lags behind the plant by more than this is killed \[s\]. Shorter than
    /// the actuation guard holds, so that a successor still finds the vehicle flying.
    #[garde(range(min = 0.05, max = 600.0))]
    pub lag_timeout_s: f64,
    /// How long the flight goes on after the launcher's death, for another one to take over: then the vehicle lands and the
    /// processes leave; in lockstep, where none can, 2 s at most \[s\].
    #[garde(range(min = 0.0, max = 3600.0))]
    pub launcher_grace_s: f64,
    /// Pause before the first restart of a process \[s\]; doubled by each further one.
    #[garde(range(min = 0.0, max = 60.0))]
    pub restart_backoff_s: f64,
    /// Longest pause before a restart \[s\].
    #[garde(range(min = 0.0, max = 600.0))]
    pub restart_backoff_max_s: f64,
    /// Restarts of one process before the run is given up.
    #[garde(range(max = 1000))]
    pub restart_limit: u32,
}

impl Default for LauncherSettings {
    fn default() -> Self {
        Self {
            startup_timeout_s: 10.0,
            stall_timeout_s: 2.0,
            lag_timeout_s: 0.3,
            launcher_grace_s: 30.0,
            restart_backoff_s: 0.01,
            restart_backoff_max_s: 5.0,
            restart_limit: 10,
        }
    }
}
