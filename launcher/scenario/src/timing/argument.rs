//! `--timing` of the command line: an entry, a file of entries, or those of a recording.

use crate::overrides::{refusal, seconds};
use crate::{Override, text};
use document::{Edit, ScenarioError};
use std::path::Path;

const TIMING_FORM: &str = "write --timing NAME:KIND=TIME@FROM..TO, for example --timing attitude:step=12ms@2s..3s or \
    --timing imu:late=1ms..3ms; KIND is start-late or step with a TIME, stopped or wake-missed for a loop, and late with \
    a TIME, lost or duplicated for a topic; or write --timing FILE with [[timing]] in it";

impl Override {
    /// `--timing NAME:KIND[=TIME][@FROM..TO]`, where NAME is a loop or a topic and TIME may be `LEAST..MOST`; or a file
    /// with `[[timing]]` in it.
    ///
    /// # Errors
    /// Not of this form, and no file that can be read.
    pub fn timing(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--timing {argument}");
        if !argument.contains(':') || Path::new(argument).is_file() {
            return of_file(&shown, argument);
        }
        let Some(entry) = entry_of(argument) else {
            let what = "lacks what happens to which loop or topic when";
            return Err(refusal("--timing", &shown, what, TIMING_FORM));
        };
        Ok(Self::entry(shown, "timing", &entry))
    }

    /// `--timing RECORDING`, of which `entries` are what has been made, or why none could be.
    ///
    /// # Errors
    /// Why none could be.
    pub fn recorded_timing(
        argument: &str,
        entries: Result<String, String>,
    ) -> Result<Self, ScenarioError> {
        let shown = format!("--timing {argument}");
        let remedy = "name a recording of a realtime flight, or of one with [[timing]], in which no slot changed hands";
        let entries = entries.map_err(|what| refusal("--timing", &shown, &what, remedy))?;
        of_text(&shown, &entries)
    }
}

/// All entries of a file, which has nothing else.
fn of_file(shown: &str, path: &str) -> Result<Override, ScenarioError> {
    let refuse = |what: &str| refusal("--timing", shown, what, TIMING_FORM);
    let cannot = |error| refuse(&format!("is no entry, and cannot be read as a file: {error}"));
    of_text(shown, &text::text_of(path).map_err(cannot)?)
}

fn of_text(shown: &str, text: &str) -> Result<Override, ScenarioError> {
    let refuse = |what: &str| refusal("--timing", shown, what, TIMING_FORM);
    let table: toml::Table = text.parse().map_err(|_| refuse("is a file that is not TOML"))?;
    match (table.get("timing"), table.len()) {
        (Some(entries @ toml::Value::Array(_)), 1) => {
            let (key, value) = ("timing".to_owned(), entries.to_string());
            Ok(Override(Edit { added: true, ..Edit::set(shown.to_owned(), key, value) }))
        }
        _ => Err(refuse("is a file with something else in it than [[timing]]")),
    }
}

/// The entry in TOML.
fn entry_of(argument: &str) -> Option<String> {
    let (name, rest) = argument.split_once(':')?;
    let (effect, window) =
        rest.split_once('@').map_or((rest, None), |(effect, window)| (effect, Some(window)));
    let (kind, value) =
        effect.split_once('=').map_or((effect, None), |(kind, value)| (kind, Some(value)));
    // A loop and a topic may have the same name.
    let is_topic = matches!(kind, "late" | "lost" | "duplicated");
    let quoted = toml::Value::from(name.trim());
    let mut entry = format!("{} = {quoted}", if is_topic { "topic" } else { "loop" });
    let key = kind.replace('-', "_");
    match (kind, value) {
        ("start-late" | "step" | "late", Some(value)) => {
            let drawn = match value.split_once("..") {
                Some((least, most)) => {
                    format!("{{ uniform_s = [{:?}, {:?}] }}", seconds(least)?, seconds(most)?)
                }
                None => format!("{:?}", seconds(value)?),
            };
            entry = format!("{entry}, {key}_s = {drawn}");
        }
        ("stopped" | "wake-missed" | "lost" | "duplicated", None) => {
            entry = format!("{entry}, {key} = true");
        }
        _ => return None,
    }
    match window.map(|window| window.split_once("..")) {
        None => {}
        Some(Some((from, to))) => {
            entry = format!("{entry}, from_s = {:?}, to_s = {:?}", seconds(from)?, seconds(to)?);
        }
        Some(None) => entry = format!("{entry}, at_s = {:?}", seconds(window?)?),
    }
    Some(entry)
}
