//! The section `[disturbance_injector]` of a scenario.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::{Event, InjectorConfig, MAX_EVENTS, MAX_RATE_HZ};

/// What a scenario sets of the injector.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Loop rate \[Hz\].
    #[garde(range(min = 1.0, max = MAX_RATE_HZ))]
    pub rate_hz: f64,
    /// Steps from one published state to the next.
    #[garde(range(min = 1, max = 100000))]
    pub state_every: u32,
    /// The events, in any order of time.
    #[garde(dive, length(max = MAX_EVENTS))]
    pub script: Vec<Event>,
}

impl Default for Settings {
    fn default() -> Self {
        let InjectorConfig { rate_hz, script } = InjectorConfig::default();
        Self { rate_hz, state_every: 10, script }
    }
}

impl Settings {
    /// What the injector is built from.
    #[must_use]
    pub fn injector_config(&self) -> InjectorConfig {
        InjectorConfig { rate_hz: self.rate_hz, script: self.script.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_is_valid_and_calm() {
        let settings: Settings = toml::from_str("").unwrap();
        assert!(settings.validate().is_ok());
        assert!(settings.injector_config().script.is_empty());
    }

    #[test]
    fn an_event_out_of_range_is_refused_by_its_place_and_key() {
        let toml = "script = [{ kind = \"payload\", at_s = 1.0, mass_kg = 11.0 }]";
        let settings: Settings = toml::from_str(toml).unwrap();
        let refusal = settings.validate().unwrap_err().to_string();
        assert!(refusal.starts_with("script[0]") && refusal.contains("mass_kg"), "{refusal}");
    }
}
