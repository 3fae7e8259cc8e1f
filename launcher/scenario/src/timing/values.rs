//! How long something takes, and the steps of another flight, as a scenario has them.

use ::timing::{Duration, RecordedStep};
use runtime::Rate;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use shared_types::time::ns_from_s;
use std::collections::BTreeMap;

/// Longest time that anything can take \[s\].
const MAX_S: f64 = 3600.0;

/// Of a number of seconds, which most entries have.
pub(super) fn seconds_schema(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "number", "minimum": 0.0, "maximum": MAX_S })
}

/// A time, or how it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub enum DurationSettings {
    /// Always this \[s\].
    Seconds(f64),
    /// Drawn as the table describes.
    Drawn(DrawSettings),
}

/// The steps of a loop in another flight.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedSettings {
    /// Rate of the loop there \[Hz\].
    pub rate_hz: f64,
    /// By release: begin after it and time that the step took; nothing if that is not known \[ns\].
    pub steps_ns: Vec<Vec<i64>>,
    /// Numbers of the first and the last release of those that were left out in a row.
    #[serde(default)]
    pub left_out: Vec<[u64; 2]>,
}

impl RecordedSettings {
    /// By their releases; what is wrong with them, and what to write instead.
    pub(super) fn steps(&self) -> Result<BTreeMap<u64, RecordedStep>, (String, String)> {
        let remedy = "let `--timing RECORDING` write it".to_owned();
        let rate =
            Rate::from_hz(self.rate_hz).map_err(|error| (error.to_string(), remedy.clone()))?;
        let mut steps = BTreeMap::new();
        for (release_ns, step) in (0..).map(|k| rate.release_ns(k)).zip(&self.steps_ns) {
            match step[..] {
                [] => {}
                [begin_ns, step_ns] if step_ns >= 0 => {
                    let begin_ns = begin_ns.saturating_add_unsigned(release_ns);
                    let step_ns = step_ns.unsigned_abs();
                    steps.insert(release_ns, RecordedStep { begin_ns, step_ns });
                }
                _ => return Err((format!("{step:?} is neither [BEGIN, TIME] nor []"), remedy)),
            }
        }
        for [first, last] in &self.left_out {
            let count = self.steps_ns.len() as u64;
            if first > last || *last >= count {
                return Err((format!("{first} to {last} are no releases before {count}"), remedy));
            }
            // The loop looked when it began the one after them.
            if let Some(next) = steps.get(&rate.release_ns(last + 1)).copied() {
                let step = RecordedStep { step_ns: 0, ..next };
                steps.extend((*first..=*last).map(|k| (rate.release_ns(k), step)));
            }
        }
        Ok(steps)
    }
}

/// How a time is drawn.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DrawSettings {
    /// Any time between these two \[s\].
    uniform_s: Option<[f64; 2]>,
    /// One of these \[s\].
    values_s: Option<Vec<f64>>,
    /// How often each of `values_s` is drawn, beside the others.
    weights: Option<Vec<f64>>,
}

impl<'de> Deserialize<'de> for DurationSettings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(DurationVisitor)
    }
}

struct DurationVisitor;

impl<'de> Visitor<'de> for DurationVisitor {
    type Value = DurationSettings;

    fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("a number of seconds, { uniform_s = [LEAST, MOST] } or { values_s = [...], weights = [...] }")
    }

    fn visit_f64<E: Error>(self, value_s: f64) -> Result<DurationSettings, E> {
        Ok(DurationSettings::Seconds(value_s))
    }

    fn visit_i64<E: Error>(self, value_s: i64) -> Result<DurationSettings, E> {
        i32::try_from(value_s).map_err(E::custom).and_then(|value_s| self.visit_f64(value_s.into()))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<DurationSettings, A::Error> {
        DrawSettings::deserialize(MapAccessDeserializer::new(map)).map(DurationSettings::Drawn)
    }
}

impl DurationSettings {
    /// As it is drawn; what is wrong with it, and what to write instead.
    pub(super) fn duration(&self) -> Result<Duration, (String, String)> {
        let refuse = |what: &str, remedy: &str| Err((what.to_owned(), remedy.to_owned()));
        let in_range = |value_s: &f64| (0.0..=MAX_S).contains(value_s);
        let given_s = match self {
            Self::Seconds(value_s) => vec![*value_s],
            Self::Drawn(DrawSettings { uniform_s, values_s, .. }) => {
                uniform_s.iter().flatten().chain(values_s.iter().flatten()).copied().collect()
            }
        };
        if let Some(value_s) = given_s.iter().find(|value_s| !in_range(value_s)) {
            return Err((format!("{value_s} s is no time"), format!("write 0 to {MAX_S} s")));
        }
        match self {
            Self::Seconds(value_s) => Ok(Duration::Fixed(ns_from_s(*value_s))),
            Self::Drawn(DrawSettings {
                uniform_s: Some([least_s, most_s]),
                values_s: None,
                weights: None,
            }) => {
                if least_s > most_s {
                    return refuse(
                        "the first is longer than the second",
                        "write the shorter time first",
                    );
                }
                Ok(Duration::Uniform(ns_from_s(*least_s), ns_from_s(*most_s)))
            }
            Self::Drawn(DrawSettings { uniform_s: None, values_s: Some(values_s), weights }) => {
                let weights = weights.clone().unwrap_or_else(|| vec![1.0; values_s.len()]);
                if weights.len() != values_s.len()
                    || weights.iter().any(|weight| *weight < 0.0)
                    || !(f64::MIN_POSITIVE..=f64::MAX).contains(&weights.iter().sum::<f64>())
                {
                    return refuse(
                        "each of values_s needs a weight, none of which is negative and one of which is not 0",
                        "write as many weights as values, for example values_s = [0.001, 0.012], weights = [99, 1]",
                    );
                }
                let values: Vec<(u64, f64)> =
                    values_s.iter().map(|value_s| ns_from_s(*value_s)).zip(weights).collect();
                Ok(Duration::weighted(&values))
            }
            Self::Drawn(_) => refuse(
                "is not drawn in one way",
                "write { uniform_s = [LEAST, MOST] } or { values_s = [...], weights = [...] }",
            ),
        }
    }
}
