//! Which run is meant: by name, by the beginning of its name, or because there is only one.

use runtime::leader::leading;
use runtime::namespace;
use std::fs;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Marks the folder of a run in which nothing flies.
const MEASUREMENT: &str = "measurement";

/// Keeps a run from being taken for a flight.
///
/// # Errors
/// Its folder cannot be written.
pub fn note_measurement(folder: &Path) -> std::io::Result<()> {
    fs::write(folder.join(MEASUREMENT), "")
}

/// A run of this user with processes alive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Run {
    id: String,
    folder: PathBuf,
}

impl Run {
    /// A run that tests have made up.
    #[cfg(test)]
    pub(crate) fn at(id: &str, folder: &Path) -> Self {
        Self { id: id.to_owned(), folder: folder.to_owned() }
    }

    /// Name of the run.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Folder of the run.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The scenario's description of itself; none before it is there.
    fn scenario(&self) -> Option<toml::Table> {
        let text = fs::read_to_string(self.folder.join("scenario.toml")).ok()?;
        let table: toml::Table = text.parse().ok()?;
        table.get("scenario")?.as_table().cloned()
    }

    /// What can be done for it if its launcher has died.
    pub(super) fn rescue(&self) -> String {
        let clock =
            self.scenario().map(|scenario| scenario.get("clock")?.as_str().map(str::to_owned));
        match clock.as_ref().map(Option::as_deref) {
            Some(Some("realtime")) => {
                format!("`morphquad adopt {}` goes on before its processes leave", self.id)
            }
            Some(_) => {
                "its processes leave within seconds: a flight in lockstep cannot go on, but its \
                        recording can be read, and flown again it is the same flight"
                    .to_owned()
            }
            None => "its processes leave".to_owned(),
        }
    }

    /// Name and scenario, as far as it can be read.
    fn described(&self) -> String {
        let scenario = self.scenario().unwrap_or_default();
        let name = scenario.get("name").and_then(|name| name.as_str());
        let led = leading(&self.folder);
        let led = led.map_or("without launcher".to_owned(), |pid| format!("led by {pid}"));
        format!("{}  {}  {led}", self.id, name.unwrap_or("(just starting)"))
    }
}

/// Why no run was found.
#[derive(Debug, Error)]
pub enum FindError {
    /// There is none at all.
    #[error("no run is active: start one with `morphquad run`")]
    NoRun,
    /// There is none of that name.
    #[error("no run is called {wanted}; active: {}", list(.living))]
    Unknown {
        /// As asked for.
        wanted: String,
        /// All there are.
        living: Vec<Run>,
    },
    /// Every run has its launcher.
    #[error("no run has lost its launcher; active: {}", list(.led))]
    NoOrphan {
        /// All there are.
        led: Vec<Run>,
    },
    /// More than one has lost its launcher.
    #[error("{} runs have lost their launchers, name the one to adopt:{}", .orphans.len(), list(.orphans))]
    SeveralOrphans {
        /// All that could be meant.
        orphans: Vec<Run>,
    },
    /// There is more than one.
    #[error("{} runs are active, name one with --run:{}", .living.len(), list(.living))]
    Several {
        /// All that could be meant.
        living: Vec<Run>,
    },
}

fn list(runs: &[Run]) -> String {
    if runs.is_empty() {
        return "none".to_owned();
    }
    let lines: Vec<String> = runs.iter().map(Run::described).collect();
    format!("\n  {}", lines.join("\n  "))
}

/// Runs of this user with processes alive, in the order of their names.
#[must_use]
pub fn living() -> Vec<Run> {
    let folders = namespace::living_runs().into_iter();
    let flights = folders.filter(|(_, folder)| !folder.join(MEASUREMENT).exists());
    let mut runs: Vec<Run> = flights.map(|(id, folder)| Run { id, folder }).collect();
    runs.sort_by(|a, b| a.id.cmp(&b.id));
    runs
}

/// The run that `wanted` names, or the only one there is.
///
/// # Errors
/// There is none, or more than one.
pub fn find(wanted: Option<&str>) -> Result<Run, FindError> {
    choose(wanted, living())
}

/// The run that `wanted` names, or the only one that has lost its launcher.
///
/// # Errors
/// There is none, or more than one.
pub fn find_orphan(wanted: Option<&str>) -> Result<Run, FindError> {
    if wanted.is_some() {
        return find(wanted);
    }
    let is_led = |run: &Run| leading(run.folder()).is_some();
    let (led, mut orphans): (Vec<Run>, _) = living().into_iter().partition(is_led);
    match (orphans.pop(), orphans.is_empty(), led.is_empty()) {
        (Some(only), true, _) => Ok(only),
        (Some(last), false, _) => {
            orphans.push(last);
            Err(FindError::SeveralOrphans { orphans })
        }
        (None, _, true) => Err(FindError::NoRun),
        (None, _, false) => Err(FindError::NoOrphan { led }),
    }
}

/// As [`find`], among `living`.
fn choose(wanted: Option<&str>, living: Vec<Run>) -> Result<Run, FindError> {
    if let Some(run) = living.iter().find(|run| Some(run.id()) == wanted) {
        return Ok(run.clone());
    }
    let prefix = wanted.unwrap_or_default();
    let mut meant = living.iter().filter(|run| run.id.starts_with(prefix));
    match (meant.next(), meant.next(), wanted) {
        (Some(run), None, _) => Ok(run.clone()),
        (Some(_), Some(_), _) => {
            let meant = living.into_iter().filter(|run| run.id.starts_with(prefix));
            Err(FindError::Several { living: meant.collect() })
        }
        (None, _, None) => Err(FindError::NoRun),
        (None, _, Some(wanted)) => Err(FindError::Unknown { wanted: wanted.to_owned(), living }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn living(ids: &[&str]) -> Vec<Run> {
        let run = |id: &&str| Run { id: (*id).to_owned(), folder: PathBuf::from("/nowhere") };
        ids.iter().map(run).collect()
    }

    fn chosen(wanted: Option<&str>, ids: &[&str]) -> Result<String, String> {
        choose(wanted, living(ids)).map(|run| run.id).map_err(|error| error.to_string())
    }

    #[test]
    fn the_only_run_needs_no_name_and_any_beginning_of_a_name_will_do() {
        assert_eq!(chosen(None, &["7f3a"]).as_deref(), Ok("7f3a"));
        assert_eq!(chosen(Some("9"), &["7f3a", "9b01"]).as_deref(), Ok("9b01"));
        // A whole name is that run's although another one begins with it.
        assert_eq!(chosen(Some("7f"), &["7f3a", "7f"]).as_deref(), Ok("7f"));
    }

    #[test]
    fn without_the_launcher_the_message_names_what_can_be_done_on_which_clock() {
        let folder = tempfile::tempdir().unwrap();
        let run = Run::at("7f3a", folder.path());
        let rescue = |scenario: &str| {
            fs::write(folder.path().join("scenario.toml"), scenario).unwrap();
            run.rescue()
        };
        assert!(!run.rescue().contains("adopt"), "nothing is known of it yet");
        assert!(rescue("[scenario]\nclock = \"realtime\"\n").contains("`morphquad adopt 7f3a`"));
        for lockstep in ["[scenario]\nclock = \"lockstep\"\n", "[scenario]\nseed = 1\n"] {
            let text = rescue(lockstep);
            assert!(text.contains("lockstep") && !text.contains("adopt"), "{text}");
        }
    }

    #[test]
    fn none_several_and_unknown_are_refused_with_the_list_of_what_there_is() {
        let listed = |wanted, ids: &[&str], expected: &[&str]| {
            let text = chosen(wanted, ids).unwrap_err();
            for word in expected {
                assert!(text.contains(word), "{text}");
            }
        };
        listed(None, &[], &["no run is active"]);
        listed(Some("7"), &[], &["no run is called 7", "none"]);
        listed(None, &["7f3a", "9b01"], &["2 runs", "--run", "7f3a", "9b01"]);
        listed(Some("7"), &["7f3a", "7f3b", "9b01"], &["2 runs", "7f3a", "7f3b"]);
        listed(Some("8"), &["7f3a"], &["no run is called 8", "7f3a"]);
        assert!(!chosen(Some("7"), &["7f3a", "7f3b", "9b01"]).unwrap_err().contains("9b01"));
    }
}
