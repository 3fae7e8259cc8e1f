//! A scenario with the values of the keys that were left out.

use crate::Scenario;
use crate::keys::{self, Key, Section};
use crate::services::LOOPS;
use ::pilot::settings::KINDS;
use shared_types::Slot;
use toml::{Table, Value};

impl Scenario {
    /// As [`to_toml`](Self::to_toml), with every key that was left out and has a default in the reference. What is still left
    /// out follows from the rest, as a weight from the rate of its loop, or has no effect.
    #[must_use]
    pub fn to_complete_toml(&self) -> String {
        let mut table: Table = self.to_toml().parse().unwrap_or_default();
        let pilot = table.entry("pilot").or_insert_with(|| Table::new().into());
        if let Some(pilot) = pilot.as_table_mut() {
            pilot.entry("kind").or_insert_with(|| KINDS[0].into());
        }
        let is_rig = self.settings().pilot.is_rig();
        let is_idle = |section: &Section| {
            let own = LOOPS.iter().find(|known| known.section == section.name);
            is_rig && own.is_some_and(|own| own.role() == Slot::Position.role())
        };
        let sections = keys::sections();
        let flown = sections.iter().filter(|section| !is_idle(section));
        for key in flown.flat_map(|section| &section.keys) {
            let default = key.default.as_ref().and_then(|value| Value::try_from(value).ok());
            let is_empty_table = |value: &Value| value.as_table().is_some_and(Table::is_empty);
            if let Some(default) = default.filter(|value| !is_empty_table(value)) {
                let path: Vec<&str> = key.name.split('.').collect();
                fill(&mut table, &path, (key, None), &default);
            }
        }
        table.to_string()
    }
}

/// Gives a key its value wherever it has a place and is left out: in `table` at the rest of its path, where `kind` is that
/// of the table above.
fn fill(table: &mut Table, path: &[&str], (key, kind): (&Key, Option<&str>), value: &Value) {
    let own = table.get("kind").and_then(Value::as_str).map(str::to_owned);
    let kind = own.as_deref().or(kind);
    if key.kind.is_some() && kind.is_some() && key.kind != kind {
        return;
    }
    let may_be_made = key.name.split('.').count() - path.len() >= key.written_tables;
    match path {
        [] => {}
        [last] => {
            if may_be_made {
                table.entry(*last).or_insert_with(|| value.clone());
            }
        }
        [first, rest @ ..] => {
            if let Some(list) = first.strip_suffix("[]") {
                let entries = table.get_mut(list).and_then(Value::as_array_mut);
                for entry in entries.into_iter().flatten().filter_map(Value::as_table_mut) {
                    fill(entry, rest, (key, kind), value);
                }
                return;
            }
            if may_be_made {
                table.entry(*first).or_insert_with(|| Table::new().into());
            }
            if let Some(inner) = table.get_mut(*first).and_then(Value::as_table_mut) {
                fill(inner, rest, (key, kind), value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;

    #[test]
    fn a_completed_scenario_is_the_same_flight_and_has_every_key_with_a_default() {
        // Tables that are there only if they are written, and one of several kinds of a table.
        let more = [
            "",
            "[plant.barometer]\nrate_hz = 50\n[plant.imu.bias_step]\nat_s = 1.0\n",
            "[[order]]\nat_s = 2.0\ndisturb = { load = { force_w_n = [0.1, 0.0, 0.0] }, for_s = 1.0 }\n",
            "[[order]]\nat_s = 2.0\ndisturb = { load = { wind = { mean_w_m_s = [1.0, 0.0, 0.0] } } }\n",
            "[[swap]]\nslot = \"attitude\"\nto = \"attitude-pid\"\nat_s = 1.0\n",
            "[[standby]]\nslot = \"attitude\"\nname = \"attitude-lqr\"\n",
        ];
        let shipped = shipped::names().map(|name| (name, Scenario::load(name, &[])));
        let written =
            more.iter().map(|text| ("written", Scenario::from_text("mine.toml", text, &[])));
        for (name, first) in shipped.chain(written) {
            let first = first.expect("a scenario");
            let text = first.to_complete_toml();
            let again = Scenario::from_text("mine.toml", &text, &[]).expect("a scenario");
            assert_eq!(format!("{:?}", first.settings()), format!("{:?}", again.settings()));
            assert_eq!(again.to_complete_toml(), text, "nothing is left to be completed");
            let warnings = |scenario: &Scenario| -> Vec<String> {
                scenario.warnings().iter().map(|warning| warning.key().to_owned()).collect()
            };
            assert_eq!(warnings(&first), warnings(&again), "{name}");
            let table: Table = text.parse().expect("TOML");
            let sections = keys::sections();
            let is_rig = first.settings().pilot.is_rig();
            let flown = sections.iter().filter(|own| !is_rig || !own.name.contains("position"));
            for key in flown.flat_map(|section| &section.keys) {
                let is_everywhere = key.kind.is_none() && key.written_tables == 0;
                let has_value =
                    key.default.as_ref().is_some_and(|value| *value != serde_json::json!({}));
                if is_everywhere && has_value && !key.name.contains("[]") {
                    let mut parts = key.name.split('.');
                    let section = parts.next().and_then(|section| table.get(section));
                    let found =
                        section.and_then(|own| parts.try_fold(own, |at, part| at.get(part)));
                    assert!(found.is_some(), "{name}: {}", key.name);
                }
            }
        }
    }
}
