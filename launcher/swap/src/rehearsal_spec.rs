//! What is to be rehearsed before a swap.

use rehearsal::Snapshot;
use serde::{Deserialize, Serialize};
use shared_types::{PerSlot, Slot};
use std::path::PathBuf;

/// What to rehearse: candidate, slot, scenario and state of the vehicle. The launcher passes it as JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RehearsalSpec {
    /// Text of the scenario that is flown.
    pub scenario: String,
    /// State of the vehicle from which the flights begin.
    pub snapshot: Snapshot,
    /// The slot that the candidate is to take over.
    pub slot: Slot,
    /// Built-in controllers that own the slots now; where left out, those of the scenario.
    #[serde(default)]
    pub owners: PerSlot<Option<String>>,
    /// The controller that commands the slot now, if it is not built in or has its own configuration:
    /// name or path, and the file that configures it.
    #[serde(default)]
    pub owner: Option<(String, Option<PathBuf>)>,
    /// Name of a controller, or path of an executable.
    pub candidate: String,
    /// File that configures the candidate; without one the configuration of the flight applies.
    #[serde(default)]
    pub config: Option<PathBuf>,
    /// Seed of the run.
    pub seed: u64,
    /// Number of the swap within the run.
    pub swap: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn owners_are_read_by_the_names_of_slots_and_others_are_refused() {
        let read = |text: &str| serde_json::from_str::<PerSlot<Option<String>>>(text);
        let owners = read(r#"{"attitude": "attitude-lqr"}"#).expect("a slot");
        assert_eq!(owners[Slot::Attitude].as_deref(), Some("attitude-lqr"));
        assert_eq!(owners[Slot::Position], None);
        let text = serde_json::to_string(&owners).expect("a table");
        assert_eq!(read(&text).expect("the same"), owners);
        assert!(read(r#"{"estimator": "attitude-lqr"}"#).is_err());
    }
}
