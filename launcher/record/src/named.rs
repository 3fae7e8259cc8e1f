//! Recordings by name: files, the latest one, and the beginning of a name or of the ID of a run.

use crate::read::facts_of;
use core::cmp::Reverse;
use scenario::shipped;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Folder of recordings that are not placed elsewhere.
pub const FOLDER: &str = "recordings";
/// What stands for the newest recording in that folder.
pub const LATEST: &str = "latest";

/// So many files are named that are no recordings.
const NAMED: usize = 3;

/// Why a word means no single recording.
#[derive(Debug, Error)]
pub enum Unnamed {
    #[error("there is no recording in {FOLDER}/ yet: `morphquad run` makes one")]
    Nothing,
    #[error("no file in {FOLDER}/ is a recording with a whole beginning: {names}")]
    NoneWhole { names: String },
    #[error("`{word}` begins the names of several recordings: {names}")]
    Several { word: String, names: String },
}

/// The file that a word means: the newest in [`FOLDER`] for [`LATEST`], itself if there is one, else the only one there
/// whose name, or the ID of whose run, begins with it. Any other word is returned as it is; so is the name of a shipped
/// scenario, which `--name` gives to no recording.
///
/// # Errors
/// [`Unnamed`] if there is no recording yet, or the beginning is of several.
pub fn named(word: &Path) -> Result<PathBuf, Unnamed> {
    if word == Path::new(LATEST) {
        return latest();
    }
    if shipped::names().any(|name| Path::new(name) == word) {
        return Ok(word.to_owned());
    }
    // A folder without recordings hides no recording of its name.
    let is_other_folder = || word.is_dir() && of_folder(word).is_ok_and(|found| found.is_empty());
    if word.exists() && !is_other_folder() {
        return Ok(word.to_owned());
    }
    let is_bare = word.components().count() == 1;
    match word.to_str().filter(|text| is_bare && !text.is_empty()) {
        Some(text) => Ok(begun_by(text, found_in(Path::new(FOLDER)))?.unwrap_or(word.to_owned())),
        None => Ok(word.to_owned()),
    }
}

/// The newest recording in [`FOLDER`].
///
/// # Errors
/// [`Unnamed`] if there is no recording.
pub fn latest() -> Result<PathBuf, Unnamed> {
    let found = found_in(Path::new(FOLDER));
    match found.first() {
        Some(newest) if newest.began_unix_ns > 0 => Ok(newest.path.clone()),
        Some(_) => {
            let names: Vec<String> =
                found.iter().take(NAMED).map(|found| found.path.display().to_string()).collect();
            Err(Unnamed::NoneWhole { names: names.join(", ") })
        }
        None => Err(Unnamed::Nothing),
    }
}

/// A file that is named like a recording.
#[derive(Debug, Clone)]
struct Found {
    path: PathBuf,
    run_id: String,
    /// Unix time at which the flight began \[ns\]; 0 of a file that is no recording.
    began_unix_ns: u64,
}

impl Found {
    fn at(path: PathBuf) -> Self {
        let facts = facts_of(&path);
        let fact = |key: &str| facts.as_ref().and_then(|facts: &BTreeMap<_, _>| facts.get(key));
        let run_id = fact("run_id").cloned().unwrap_or_default();
        let began_unix_ns = fact("epoch_unix_ns").and_then(|text| text.parse().ok()).unwrap_or(0);
        Self { path, run_id, began_unix_ns }
    }
}

/// The only one of `found` whose name or run begins with `word`, or the one whose whole name it is.
fn begun_by(word: &str, mut found: Vec<Found>) -> Result<Option<PathBuf>, Unnamed> {
    let name = word.strip_suffix(".mcap").unwrap_or(word);
    let is_named = |found: &Found| stem(&found.path).starts_with(name);
    if found.iter().any(is_named) {
        found.retain(is_named);
    } else {
        found.retain(|found| found.run_id.starts_with(name));
    }
    if let Some(exact) = found.iter().position(|found| stem(&found.path) == name) {
        return Ok(Some(found.swap_remove(exact).path));
    }
    if found.len() > 1 {
        let names: Vec<String> = found.iter().map(|found| stem(&found.path)).collect();
        return Err(Unnamed::Several { word: word.to_owned(), names: names.join(", ") });
    }
    Ok(found.pop().map(|found| found.path))
}

/// Name of a recording: that of its file, without the ending.
#[must_use]
pub fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Recordings of a folder, the newest flight first, and at the end what is only named like one; none of a folder that
/// cannot be read.
#[must_use]
pub fn newest(folder: &Path) -> Vec<PathBuf> {
    found_in(folder).into_iter().map(|found| found.path).collect()
}

fn found_in(folder: &Path) -> Vec<Found> {
    let short = |path: PathBuf| path.strip_prefix(".").map(Path::to_owned).unwrap_or(path);
    let paths = of_folder(folder).unwrap_or_default().into_iter().map(short);
    let mut found: Vec<Found> = paths.map(Found::at).collect();
    // By when the flight began: a copy, or a file that was touched, is no newer flight.
    found.sort_by_key(|found| Reverse(found.began_unix_ns));
    found
}

/// Recordings of a folder, by name.
///
/// # Errors
/// The folder cannot be read.
pub fn of_folder(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let paths = std::fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path()));
    let mut found: Vec<PathBuf> =
        paths.filter(|path| path.extension().is_some_and(|kind| kind == "mcap")).collect();
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::{Found, Unnamed, begun_by};
    use std::path::PathBuf;

    fn found() -> Vec<Found> {
        let of = |(name, run_id): (&str, &str)| Found {
            path: PathBuf::from(format!("recordings/{name}.mcap")),
            run_id: run_id.to_owned(),
            began_unix_ns: 1,
        };
        [("7f3a", "7f3a"), ("7f41", "7f41"), ("7f3a-recovered", "7f3a"), ("gusty", "80aa")]
            .map(of)
            .to_vec()
    }

    #[test]
    fn the_beginning_of_a_name_means_the_only_recording_that_has_it() {
        let meant = |word: &str| begun_by(word, found()).unwrap();
        assert_eq!(meant("7f4"), Some(PathBuf::from("recordings/7f41.mcap")));
        assert_eq!(meant("7f3a-"), Some(PathBuf::from("recordings/7f3a-recovered.mcap")));
        assert_eq!(meant("9"), None);
    }

    #[test]
    fn a_recording_with_a_name_of_its_own_is_found_by_its_run_too() {
        for word in ["80", "80aa", "gus"] {
            assert_eq!(begun_by(word, found()).unwrap(), Some("recordings/gusty.mcap".into()));
        }
    }

    #[test]
    fn a_whole_name_means_its_recording_although_another_begins_with_it() {
        for word in ["7f3a", "7f3a.mcap"] {
            assert_eq!(begun_by(word, found()).unwrap(), Some("recordings/7f3a.mcap".into()));
        }
    }

    #[test]
    fn the_beginning_of_several_names_is_refused_with_all_of_them() {
        let Err(Unnamed::Several { word, names }) = begun_by("7f", found()) else {
            panic!("one of three")
        };
        assert_eq!((word.as_str(), names.as_str()), ("7f", "7f3a, 7f41, 7f3a-recovered"));
    }
}
