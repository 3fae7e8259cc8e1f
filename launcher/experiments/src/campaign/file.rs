//! The campaign's file: scenario, seeds, grid.

use super::case::{Axis, Base, Case};
use super::values;
use core::ops::Range;
use miette::{Diagnostic, NamedSource, SourceSpan};
use scenario::shipped;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;
use toml::{Spanned, Value};

/// Cases of the largest campaign.
pub const MAX_CASES: usize = 10_000_000;

/// The section of what loops do when they are late.
const REALTIME: &str = "realtime";

/// Keys, or sections, that a case does not take from `[set]` or `[grid]`, and what does instead.
const ELSEWHERE: [(&str, &str); 9] = [
    ("scenario.seed", "seeds are given with `seeds = ...`"),
    ("scenario.clock", "the flights of a campaign are in one process, which knows lockstep only"),
    ("scenario.speed", "the flights of a campaign go as fast as they can"),
    (REALTIME, "it does nothing in lockstep without [[timing]], and a campaign flies in lockstep"),
    ("swap", "write [[swap]] into the scenario that the campaign flies"),
    ("standby", "write [[standby]] into the scenario that the campaign flies"),
    ("fault", "write [[fault]] into the scenario that the campaign flies"),
    ("order", "write [[order]] into the scenario that the campaign flies"),
    ("launcher", "it does nothing in a campaign, whose flights have no processes"),
];

/// What a campaign flies.
#[derive(Debug, Clone)]
pub struct Plan {
    /// What all cases share.
    pub base: Base,
    /// What varies, in the order of the keys.
    pub axes: Vec<Axis>,
    /// Seeds, each flown with every combination; the scenario's own if left out.
    pub seeds: Option<Vec<u64>>,
    /// Folder for the results, if the file names one.
    pub out: Option<PathBuf>,
    /// How many of the worst cases are listed.
    pub worst: usize,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    scenario: Spanned<String>,
    seeds: Option<Spanned<Value>>,
    out: Option<PathBuf>,
    #[serde(default = "default_worst")]
    worst: usize,
    #[serde(default)]
    set: BTreeMap<String, Spanned<Value>>,
    #[serde(default)]
    grid: BTreeMap<String, Spanned<Value>>,
}

fn default_worst() -> usize {
    5
}

/// Something wrong in a campaign's file.
#[derive(Debug, Error, Diagnostic)]
#[error("{what}")]
pub struct FileError {
    what: String,
    #[help]
    remedy: String,
    #[source_code]
    source_code: Arc<NamedSource<String>>,
    #[label]
    span: Option<SourceSpan>,
}

/// Text of a file; nothing else is opened, since to open a pipe is to wait for its writer.
fn read_file(path: &Path) -> std::io::Result<String> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(std::io::Error::other("it is not a file but a folder, pipe or device"));
    }
    std::fs::read_to_string(path)
}

impl Plan {
    /// Reads a campaign's file.
    ///
    /// # Errors
    /// [`FileError`]: unreadable, no TOML, an unknown key, an impossible range.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let name = path.display().to_string();
        match read_file(path) {
            Ok(text) => Self::from_text(path, &text),
            Err(error) => Err(FileError {
                what: format!("cannot read `{name}`: {error}"),
                remedy: "give the path of a campaign file, a TOML text with `scenario = \"...\"`"
                    .to_owned(),
                source_code: Arc::new(NamedSource::new(name, String::new())),
                span: None,
            }),
        }
    }

    fn from_text(path: &Path, text: &str) -> Result<Self, FileError> {
        let reader = Reader { name: path.display().to_string(), text };
        let document: Document = toml::from_str(text).map_err(|error| {
            let remedy = "a campaign has scenario, seeds, out, worst, [set] and [grid]; \
                          keys of the scenario with dots are quoted";
            reader.error(error.message(), remedy, error.span())
        })?;
        let mut axes = Vec::new();
        for (key, value) in &document.grid {
            reader.axes(key, value.get_ref(), &value.span(), &mut axes)?;
        }
        let seeds = document.seeds.map(|seeds| reader.seeds(&seeds)).transpose()?;
        let mut set = Vec::new();
        for (key, value) in &document.set {
            leaves(key, value.get_ref(), &mut |key, value| set.push(format!("{key}={value}")));
        }
        let base = reader.base(path, &document.scenario, set)?;
        let plan = Self { base, axes, seeds, out: document.out, worst: document.worst };
        let case = Case { seed: 0, values: Vec::new() };
        let loops_take_time =
            plan.base.scenario(&[], &case).is_ok_and(|flown| !flown.settings().timing.is_empty());
        for (key, value) in document.set.iter().chain(&document.grid) {
            reader.refuse_elsewhere(key, value, loops_take_time)?;
        }
        let count = plan.axes.iter().map(|axis| axis.values.len());
        let count = count.chain(plan.seeds.as_ref().map(Vec::len));
        if count.fold(1, usize::saturating_mul) > MAX_CASES {
            let what = format!("the grid has more than {MAX_CASES} cases");
            return Err(reader.error(what, "take fewer values, or fewer seeds", None));
        }
        reader.refuse_misspelt(&plan, document.set.iter().chain(&document.grid))?;
        Ok(plan)
    }
}

struct Reader<'t> {
    name: String,
    text: &'t str,
}

impl Reader<'_> {
    fn error(
        &self,
        what: impl Into<String>,
        remedy: impl Into<String>,
        span: Option<Range<usize>>,
    ) -> FileError {
        FileError {
            what: what.into(),
            remedy: remedy.into(),
            source_code: Arc::new(NamedSource::new(self.name.clone(), self.text.to_owned())),
            span: span.map(SourceSpan::from),
        }
    }

    /// What the loops of a flight do when they are late matters where a script makes them late, `loops_take_time`.
    fn refuse_elsewhere(
        &self,
        key: &str,
        value: &Spanned<Value>,
        loops_take_time: bool,
    ) -> Result<(), FileError> {
        let elsewhere =
            ELSEWHERE.iter().filter(|(outer, _)| !(loops_take_time && *outer == REALTIME));
        let mut found = None;
        leaves(key, value.get_ref(), &mut |leaf, _| {
            let is = |outer: &str| {
                leaf.strip_prefix(outer)
                    .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            found = found.or_else(|| elsewhere.clone().find(|(outer, _)| is(outer)));
        });
        found.map_or(Ok(()), |(key, reason)| {
            Err(self.error(
                format!("{key} cannot vary here: {reason}"),
                "leave it away",
                Some(value.span()),
            ))
        })
    }

    /// What no case could be flown with: a key that the scenario does not have, or a value of another
    /// kind. The first case shows it.
    fn refuse_misspelt<'v>(
        &self,
        plan: &Plan,
        mut entries: impl Iterator<Item = (&'v String, &'v Spanned<Value>)>,
    ) -> Result<(), FileError> {
        let first = |axis: &Axis| axis.values.first().cloned();
        let values = plan.axes.iter().filter_map(first).collect();
        let case = Case { seed: 0, values };
        let Err(error) = plan.base.scenario(&plan.axes, &case) else { return Ok(()) };
        let Some(problem) = error.problems().find(|problem| problem.is_malformed()) else {
            return Ok(());
        };
        let owns = |key: &str| {
            let rest = problem.key().strip_prefix(key);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
        };
        let entry = entries.find(|(key, _)| owns(key));
        // What is wrong in the scenario itself is reported with its own place.
        let Some((_, value)) = entry else { return Ok(()) };
        Err(self.error(problem.to_string(), problem.remedy(), Some(value.span())))
    }

    /// A shipped scenario by name, or a file beside the campaign's.
    fn base(
        &self,
        path: &Path,
        scenario: &Spanned<String>,
        set: Vec<String>,
    ) -> Result<Base, FileError> {
        let name = scenario.get_ref().clone();
        if let Some(text) = shipped::text(&name) {
            return Ok(Base { name, text: text.to_owned(), set });
        }
        let beside = path.parent().unwrap_or(Path::new("")).join(&name);
        match read_file(&beside) {
            Ok(text) => Ok(Base { name: beside.display().to_string(), text, set }),
            Err(error) => {
                let known = shipped::names().collect::<Vec<_>>().join(", ");
                let remedy = format!(
                    "name {known}, or give a path that starts at the folder of the campaign's file"
                );
                let what = format!("scenario `{}`: {error}", beside.display());
                Err(self.error(what, remedy, Some(scenario.span())))
            }
        }
    }

    fn seeds(&self, value: &Spanned<Value>) -> Result<Vec<u64>, FileError> {
        let remedy = "write seeds = \"0..99\", both ends included, or seeds = [1, 2, 3]";
        let wrong = |what: String| self.error(what, remedy, Some(value.span()));
        match value.get_ref() {
            Value::String(text) => values::seeds(text).map_err(wrong),
            Value::Integer(seed) => u64::try_from(*seed)
                .map(|seed| vec![seed])
                .map_err(|_| wrong(format!("seed {seed} is negative"))),
            Value::Array(list) if !list.is_empty() => {
                let seed = |value: &Value| value.as_integer().and_then(|s| u64::try_from(s).ok());
                let seeds = list.iter().map(|v| {
                    seed(v).ok_or_else(|| {
                        wrong(format!("`{v}` is not a valid seed: a whole number from 0"))
                    })
                });
                seeds.collect()
            }
            other => Err(wrong(format!("`{other}` gives no seeds"))),
        }
    }

    /// One axis, or one for each entry of a table.
    fn axes(
        &self,
        key: &str,
        value: &Value,
        span: &Range<usize>,
        axes: &mut Vec<Axis>,
    ) -> Result<(), FileError> {
        let remedy = "write a list, [0.8, 1.0], or a range, \"0.8..1.2/5\"";
        let wrong = |what: String| self.error(what, remedy, Some(span.clone()));
        if let Value::Table(table) = value {
            for (inner, value) in table {
                self.axes(&format!("{key}.{inner}"), value, span, axes)?;
            }
            return Ok(());
        }
        let values = match value {
            Value::Array(list) if !list.is_empty() => list.iter().map(Value::to_string).collect(),
            Value::String(text) => {
                values::range(text).map_err(|what| wrong(format!("{key}: {what}")))?
            }
            other => return Err(wrong(format!("{key}: `{other}` is not a list of values"))),
        };
        if axes.iter().any(|axis| axis.key == key) {
            return Err(wrong(format!("{key} comes twice")));
        }
        axes.push(Axis { key: key.to_owned(), values });
        Ok(())
    }
}

/// Every value of a table of tables, under its dotted key.
fn leaves(key: &str, value: &Value, leaf: &mut dyn FnMut(&str, &Value)) {
    match value {
        Value::Table(table) => {
            for (inner, value) in table {
                leaves(&format!("{key}.{inner}"), value, leaf);
            }
        }
        value => leaf(key, value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str) -> Result<Plan, FileError> {
        Plan::from_text(Path::new("folder/test.toml"), text)
    }

    #[test]
    fn dotted_and_quoted_keys_are_the_same_and_ranges_become_values() {
        let plan = plan(
            r#"
            scenario = "hover"
            seeds = "0..2"
            [set]
            scenario.duration_s = 2.0
            [grid]
            "plant.mismatch.mass_scale" = "0.9..1.1/3"
            attitude_mpc.prediction_horizon = [15, 20]
            "#,
        );
        let plan = plan.unwrap();
        assert_eq!(plan.seeds, Some(vec![0, 1, 2]));
        assert_eq!(plan.base.set, ["scenario.duration_s=2.0"]);
        let axes: Vec<_> = plan.axes.iter().map(|a| (a.key.as_str(), a.values.join(" "))).collect();
        let expected = [
            ("attitude_mpc.prediction_horizon", "15 20".to_owned()),
            ("plant.mismatch.mass_scale", "0.9 1.0 1.1".to_owned()),
        ];
        assert_eq!(axes, expected);
        assert_eq!((plan.worst, plan.out), (5, None));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place_and_a_remedy() {
        for (text, named) in [
            ("", "scenario"),
            ("scenario = \"hoover\"", "hoover"),
            ("scenario = \"hover\"\nseed = 3", "seed"),
            ("scenario = \"hover\"\nseeds = \"9..1\"", "9..1"),
            ("scenario = \"hover\"\nseeds = [1, -2]", "-2"),
            ("scenario = \"hover\"\nseeds = []", "no seeds"),
            ("scenario = \"hover\"\n[grid]\n\"plant.rate_hz\" = 5", "plant.rate_hz"),
            ("scenario = \"hover\"\n[set]\nscenario.clock = \"realtime\"", "scenario.clock"),
            ("scenario = \"hover\"\n[grid]\n\"scenario.seed\" = [1, 2]", "scenario.seed"),
            ("scenario = \"hover\"\n[set]\n\"realtime.priority\" = 5", "realtime"),
            ("scenario = \"hover\"\n[grid]\n\"plant.rate_hz\" = \"1..2\"", "1..2"),
            ("scenario = \"hover\"\nseeds = \"0..99999\"\n[grid]\na.b = \"0..1/1000\"", "cases"),
        ] {
            let error = plan(text).unwrap_err();
            assert!(error.what.contains(named), "{text}: {}", error.what);
            assert!(!error.remedy.is_empty());
        }
        let error = Plan::load(Path::new("no/such.toml")).unwrap_err();
        assert!(error.what.contains("no/such.toml"));
    }
}
