//! Recordings by name: files, the latest one, and the beginning of a name.

use core::cmp::Reverse;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Folder of recordings that are not placed elsewhere.
pub(super) const FOLDER: &str = "recordings";
/// What stands for the newest recording in that folder.
pub(super) const LATEST: &str = "latest";

/// Why a word means no single recording.
#[derive(Debug, Error)]
pub(super) enum Unnamed {
    #[error("there is no recording in {FOLDER}/ yet: `morphquad run` makes one")]
    Nothing,
    #[error("`{word}` begins the names of several recordings: {names}")]
    Several { word: String, names: String },
}

/// The file that a word means: itself if there is one, the newest in [`FOLDER`] for [`LATEST`], else the only one there
/// whose name begins with it. Another word is given back as it is.
///
/// # Errors
/// [`Unnamed`] if there is no recording yet, or the beginning is of several.
pub(super) fn named(word: &Path) -> Result<PathBuf, Unnamed> {
    if word.exists() {
        return Ok(word.to_owned());
    }
    if word == Path::new(LATEST) {
        return latest();
    }
    let is_bare = word.components().count() == 1;
    match word.to_str().filter(|text| is_bare && !text.is_empty()) {
        Some(text) => Ok(begun_by(text, newest(Path::new(FOLDER)))?.unwrap_or(word.to_owned())),
        None => Ok(word.to_owned()),
    }
}

/// The newest recording in [`FOLDER`].
///
/// # Errors
/// [`Unnamed::Nothing`].
pub(super) fn latest() -> Result<PathBuf, Unnamed> {
    newest(Path::new(FOLDER)).into_iter().next().ok_or(Unnamed::Nothing)
}

/// The only one of `found` whose name begins with `word`, or the one whose whole name it is.
fn begun_by(word: &str, mut found: Vec<PathBuf>) -> Result<Option<PathBuf>, Unnamed> {
    let name = word.strip_suffix(".mcap").unwrap_or(word);
    found.retain(|path| stem(path).starts_with(name));
    if let Some(exact) = found.iter().position(|path| stem(path) == name) {
        return Ok(Some(found.swap_remove(exact)));
    }
    if found.len() > 1 {
        let names: Vec<String> = found.iter().map(|path| stem(path)).collect();
        return Err(Unnamed::Several { word: word.to_owned(), names: names.join(", ") });
    }
    Ok(found.pop())
}

/// Name of a recording: that of its file, without the ending.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Recordings of a folder, the newest first; none of one that cannot be read.
pub(super) fn newest(folder: &Path) -> Vec<PathBuf> {
    let mut found = of_folder(folder).unwrap_or_default();
    found.sort_by_cached_key(|path| {
        Reverse(path.metadata().and_then(|found| found.modified()).ok())
    });
    let short = |path: PathBuf| path.strip_prefix(".").map(Path::to_owned).unwrap_or(path);
    found.into_iter().map(short).collect()
}

/// Recordings of a folder, by name.
///
/// # Errors
/// The folder cannot be read.
pub(super) fn of_folder(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let paths = std::fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path()));
    let mut found: Vec<PathBuf> =
        paths.filter(|path| path.extension().is_some_and(|kind| kind == "mcap")).collect();
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::{Unnamed, begun_by};
    use std::path::PathBuf;

    fn found() -> Vec<PathBuf> {
        ["recordings/7f3a.mcap", "recordings/7f41.mcap", "recordings/7f3a-recovered.mcap"]
            .map(PathBuf::from)
            .to_vec()
    }

    #[test]
    fn the_beginning_of_a_name_means_the_only_recording_that_has_it() {
        let meant = |word: &str| begun_by(word, found()).unwrap();
        assert_eq!(meant("7f4"), Some(PathBuf::from("recordings/7f41.mcap")));
        assert_eq!(meant("7f3a-"), Some(PathBuf::from("recordings/7f3a-recovered.mcap")));
        assert_eq!(meant("8"), None);
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
