//! What a component reads and writes.

use super::ReplayError;
use components::build_service;
use scenario::Scenario;
use scenario::services::{Assignment, names_for};
use shared_types::Role;

/// Topics that a component reads and writes.
pub(super) struct Topics {
    pub(super) read: Vec<&'static str>,
    pub(super) written: Vec<&'static str>,
}

impl Topics {
    /// Of a service that fills `role` in `scenario`.
    pub(super) fn of(service: &str, role: Role, scenario: &Scenario) -> Result<Self, ReplayError> {
        let component = build_service(service, scenario).map_err(ReplayError::component(role))?;
        let layout = component.layout();
        let read = layout.reads().map(|topic| topic.name).collect();
        Ok(Self { read, written: layout.writes().map(|topic| topic.name).collect() })
    }

    /// Of all that may have filled `role` in `scenario`.
    pub(super) fn of_all(role: Role, scenario: &Scenario) -> Result<Self, ReplayError> {
        let begins = Assignment::of(scenario.settings()).name(role);
        let mut all = Self::of(begins, role, scenario)?;
        for name in names_for(role).filter(|name| *name != begins) {
            // A service that does not fit the scenario has not flown in it.
            if let Ok(other) = Self::of(name, role, scenario) {
                all.read.extend(other.read);
                all.written.extend(other.written);
            }
        }
        Ok(all)
    }
}
