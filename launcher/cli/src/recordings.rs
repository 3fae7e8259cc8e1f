//! Recordings by name, and `morphquad recordings`: which there are, and what one of them is.

use super::flown::{recorded, unreadable};
use super::options::{Format, RecordingsCommand, RecordingsListArguments, RecordingsShowArguments};
use super::refusal::Done;
use core::cmp::Reverse;
use core::time::Duration;
use host::exit;
use humantime::format_rfc3339_seconds;
use record::read::{ReadError, RecordedFlight};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;
use thiserror::Error;
use viewers::report::Report;

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

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Recordings of a folder, the newest first; none of one that cannot be read.
pub(super) fn newest(folder: &Path) -> Vec<PathBuf> {
    let mut found = of_folder(folder).unwrap_or_default();
    found.sort_by_key(|path| Reverse(path.metadata().and_then(|found| found.modified()).ok()));
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

/// Does what is asked for.
pub(super) fn run(command: &RecordingsCommand, out: &mut dyn Write) -> Done {
    match command {
        RecordingsCommand::List(arguments) => list(arguments, out),
        RecordingsCommand::Show(arguments) => show(arguments, out),
    }
}

/// What the head of a file says of it.
struct Entry {
    path: PathBuf,
    length: u64,
    flight: Result<RecordedFlight, ReadError>,
}

impl Entry {
    fn of(path: PathBuf) -> Self {
        let length = path.metadata().map_or(0, |found| found.len());
        let flight = RecordedFlight::open(&path);
        Self { path, length, flight }
    }

    fn to_json(&self) -> Value {
        let (file, bytes) = (&self.path, self.length);
        match &self.flight {
            Ok(flight) => {
                json!({"file": file, "bytes": bytes, "recorded": began(flight), "facts": flight.facts()})
            }
            Err(error) => json!({"file": file, "bytes": bytes, "unreadable": error.to_string()}),
        }
    }

    /// Cells of its line.
    fn cells(&self) -> [String; 6] {
        let size = format!("{:.1} MB", self.length as f64 * 1e-6);
        let Ok(flight) = &self.flight else {
            let empty = String::new;
            return [stem(&self.path), "cannot be read".into(), empty(), empty(), empty(), size];
        };
        let [scenario, seed, clock] = ["scenario", "seed", "clock"].map(|key| fact(flight, key));
        [stem(&self.path), began(flight), scenario, seed, clock, size]
    }
}

fn fact(flight: &RecordedFlight, key: &str) -> String {
    flight.facts().get(key).cloned().unwrap_or_default()
}

/// When the flight began, in UTC.
fn began(flight: &RecordedFlight) -> String {
    let since_1970 = Duration::from_nanos(flight.epoch_unix_ns());
    format_rfc3339_seconds(UNIX_EPOCH + since_1970).to_string()
}

/// A line for each recording of a folder, the newest first.
fn list(arguments: &RecordingsListArguments, out: &mut dyn Write) -> Done {
    let RecordingsListArguments { folder, format } = arguments;
    if folder.as_path() != Path::new(FOLDER) {
        // One that is named must be there; the usual one is made by the first flight.
        of_folder(folder)
            .map_err(|error| unreadable(&format!("cannot list {}: {error}", folder.display())))?;
    }
    let entries: Vec<Entry> = newest(folder).into_iter().map(Entry::of).collect();
    match format {
        Format::Json => {
            let all: Vec<Value> = entries.iter().map(Entry::to_json).collect();
            writeln!(out, "{}", Value::from(all))?;
        }
        Format::Text if entries.is_empty() => {
            writeln!(out, "no recordings in {}: `morphquad run` makes one", folder.display())?;
        }
        Format::Text => {
            let head = ["NAME", "BEGAN", "SCENARIO", "SEED", "CLOCK", "SIZE"].map(str::to_owned);
            let lines: Vec<[String; 6]> =
                std::iter::once(head).chain(entries.iter().map(Entry::cells)).collect();
            for line in &lines {
                write_line(&lines, line, out)?;
            }
        }
    }
    out.flush()?;
    Ok(exit::PASS)
}

/// The cells of a line below those of the others.
fn write_line(lines: &[[String; 6]], line: &[String; 6], out: &mut dyn Write) -> io::Result<()> {
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let cells = line.iter().enumerate();
    let cells: Vec<String> =
        cells.map(|(column, cell)| format!("{cell:0$}", width(column).unwrap_or(0))).collect();
    writeln!(out, "{}", cells.join("  ").trim_end())
}

/// What one recording is, with the verdict of its flight.
fn show(arguments: &RecordingsShowArguments, out: &mut dyn Write) -> Done {
    let flight = recorded(&arguments.file)?;
    let busy = super::bar::busy("reading");
    let report = Report::of(&flight);
    drop(busy);
    let report = report.map_err(|error| unreadable(&error))?;
    let entry = Entry::of(arguments.file.clone());
    if arguments.format == Format::Json {
        let mut told = entry.to_json();
        told["line"] = json!(report.line);
        told["lacks"] = json!(report.lacks);
        told["again"] = json!(report.again);
        writeln!(out, "{told}")?;
    } else {
        let fact = |key: &str| fact(&flight, key);
        writeln!(out, "{}", report.line)?;
        writeln!(out, "  file      {}, {:.1} MB", report.file, entry.length as f64 * 1e-6)?;
        writeln!(out, "  run       {}, {}, seed {}", fact("run_id"), fact("clock"), fact("seed"))?;
        writeln!(out, "  began     {}", began(&flight))?;
        writeln!(out, "  by        morphquad {} ({})", fact("version"), fact("git"))?;
        writeln!(out, "  machine   {}, Linux {}", fact("cpu_model"), fact("kernel"))?;
        if !report.lacks.is_empty() {
            writeln!(out, "  lacks     {}", report.lacks)?;
        }
        writeln!(out, "  again     {}", report.again)?;
    }
    out.flush()?;
    Ok(exit::PASS)
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
