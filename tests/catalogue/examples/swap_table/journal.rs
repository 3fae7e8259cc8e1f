//! The results of flights, line by line in a file, so that an interrupted table goes on where it was.

use super::{Candidate, Case, Selection, executable};
use catalogue::swapped::Swapped;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write as _;
use std::sync::Mutex;
use std::time::UNIX_EPOCH;

/// Name of a journal's file, at its end.
pub(super) const JOURNAL: &str = ".jsonl";

/// What has been flown, by flight.
pub(super) struct Journal {
    pub(super) known: BTreeMap<String, Swapped>,
    file: Option<Mutex<File>>,
    /// Of this build and these settings.
    prefix: String,
}

/// A line of the journal.
#[derive(Deserialize, Serialize)]
struct Line {
    flight: String,
    flown: Swapped,
}

impl Journal {
    pub(super) fn open(selection: &Selection) -> Self {
        let modified = std::fs::metadata(executable()).and_then(|built| built.modified());
        let since = modified.expect("the catalogue").duration_since(UNIX_EPOCH);
        let built_ms = since.expect("a time").as_millis();
        let prefix = format!("{built_ms} {}", selection.given.join(" "));
        let Some(path) = &selection.journal else {
            return Self { known: BTreeMap::new(), file: None, prefix };
        };
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let lines = text.lines().filter_map(|line| serde_json::from_str::<Line>(line).ok());
        let known = lines.map(|line| (line.flight, line.flown)).collect();
        let mut file = File::options().create(true).append(true).open(path).expect("the journal");
        // The last line of a run that was killed may be cut.
        if !text.is_empty() && !text.ends_with('\n') {
            writeln!(file).expect("room");
        }
        Self { known, file: Some(Mutex::new(file)), prefix }
    }

    pub(super) fn name(&self, case: &Case) -> String {
        let Case { situation, seed, slot, guard, .. } = case;
        let (slot, guard) = (slot.label(), guard.name());
        format!("{} {slot} {} {} {seed} {guard}", self.prefix, case.name(), situation.name)
    }

    pub(super) fn keep(&self, case: &Case, flown: &Swapped) {
        // What a script does is no matter of this build.
        let is_script = matches!(case.candidate, Candidate::Python | Candidate::BadPython(_));
        let Some(file) = self.file.as_ref().filter(|_| !is_script) else { return };
        let line = Line { flight: self.name(case), flown: flown.clone() };
        let text = serde_json::to_string(&line).expect("numbers");
        writeln!(file.lock().expect("no panic"), "{text}").expect("room");
    }
}
