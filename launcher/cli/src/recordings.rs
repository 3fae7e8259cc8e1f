//! `morphquad recordings`: which there are, and what one of them is.

use super::flown::{Writers, named_or_latest, recorded, unreadable};
use super::options::{Format, RecordingsCommand, RecordingsListArguments, RecordingsShowArguments};
use super::refusal::Done;
use core::time::Duration;
use host::exit;
use humantime::format_rfc3339_seconds;
use record::named::{FOLDER, newest, of_folder, stem};
use record::read::{ReadError, RecordedFlight};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;
use viewers::report::Report;

/// Does what is asked for.
pub(super) fn run(command: &RecordingsCommand, out: &mut dyn Write) -> Done {
    match command {
        RecordingsCommand::List(arguments) => list(arguments, out),
        RecordingsCommand::Show(arguments) => show(arguments, out),
    }
}

/// What a list shows of each recording.
const COLUMNS: [&str; 8] = ["NAME", "BEGAN", "RUN", "SCENARIO", "SEED", "CLOCK", "VERDICT", "SIZE"];

/// What the head and the end of a file contain.
struct Entry {
    path: PathBuf,
    length: u64,
    flight: Result<RecordedFlight, ReadError>,
    /// The line that every output about this flight begins with, or why the file does not have it.
    line: Result<String, &'static str>,
}

impl Entry {
    fn of(path: PathBuf, writers: &Writers) -> Self {
        let flight = RecordedFlight::open(&path);
        let line = flight.as_ref().map_err(|_| "").and_then(|flight| {
            let verdict =
                flight.closing_summary().and_then(|mut summary| summary.remove("verdict"));
            verdict.ok_or_else(|| writers.of(flight).map_or("cut", |_| "in flight"))
        });
        Self::with_line(path, flight, line)
    }

    fn with_line(
        path: PathBuf,
        flight: Result<RecordedFlight, ReadError>,
        line: Result<String, &'static str>,
    ) -> Self {
        let length = path.metadata().map_or(0, |found| found.len());
        Self { path, length, flight, line }
    }

    fn to_json(&self) -> Value {
        let (file, bytes) = (self.path.display().to_string(), self.length);
        match &self.flight {
            Ok(flight) => {
                let line = self.line.as_ref().ok();
                let (began, facts) = (began(flight), flight.facts());
                json!({"file": file, "bytes": bytes, "began": began, "line": line, "facts": facts})
            }
            Err(error) => json!({"file": file, "bytes": bytes, "unreadable": error.to_string()}),
        }
    }

    /// Cells of its line.
    fn cells(&self) -> [String; COLUMNS.len()] {
        let size = format!("{:.1} MB", self.length as f64 * 1e-6);
        let Ok(flight) = &self.flight else {
            let empty = String::new;
            let cannot = "cannot be read".into();
            let [run, scenario, seed, clock, verdict] = core::array::from_fn(|_| empty());
            return [stem(&self.path), cannot, run, scenario, seed, clock, verdict, size];
        };
        let [run, scenario, seed, clock] =
            ["run_id", "scenario", "seed", "clock"].map(|key| fact(flight, key));
        let verdict = match &self.line {
            Ok(line) => line.split_whitespace().next().unwrap_or_default(),
            Err(why) => why,
        };
        [stem(&self.path), began(flight), run, scenario, seed, clock, verdict.to_owned(), size]
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
    let writers = Writers::now();
    let entries = newest(folder).into_iter().map(|path| Entry::of(path, &writers));
    let entries: Vec<Entry> = entries.collect();
    match format {
        Format::Json => {
            let all: Vec<Value> = entries.iter().map(Entry::to_json).collect();
            writeln!(out, "{}", Value::from(all))?;
        }
        Format::Text if entries.is_empty() => {
            writeln!(out, "no recordings in {}: `morphquad run` makes one", folder.display())?;
        }
        Format::Text => {
            let head = std::iter::once(COLUMNS.map(str::to_owned));
            let lines: Vec<_> = head.chain(entries.iter().map(Entry::cells)).collect();
            for line in &lines {
                write_line(&lines, line, out)?;
            }
        }
    }
    out.flush()?;
    Ok(exit::PASS)
}

/// The cells of a line below those of the others.
fn write_line<const N: usize>(
    lines: &[[String; N]],
    line: &[String; N],
    out: &mut dyn Write,
) -> io::Result<()> {
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let cells = line.iter().enumerate();
    let cells: Vec<String> =
        cells.map(|(column, cell)| format!("{cell:0$}", width(column).unwrap_or(0))).collect();
    writeln!(out, "{}", cells.join("  ").trim_end())
}

/// What one recording is, with the verdict of its flight.
fn show(arguments: &RecordingsShowArguments, out: &mut dyn Write) -> Done {
    let path = named_or_latest(arguments.file.as_deref(), &mut io::stderr())?;
    let flight = recorded(&path)?;
    let busy = super::bar::busy("reading");
    let report = Report::of(&flight);
    drop(busy);
    let report = report.map_err(|error| unreadable(&error))?;
    let length = path.metadata().map_or(0, |found| found.len());
    if arguments.format == Format::Json {
        let mut object = Entry::with_line(path, Ok(flight), Ok(report.line)).to_json();
        object["lacks"] = json!(report.lacks);
        object["again"] = json!(report.again);
        writeln!(out, "{object}")?;
    } else {
        let fact = |key: &str| fact(&flight, key);
        writeln!(out, "{}", report.line)?;
        writeln!(out, "  file      {}, {:.1} MB", report.file, length as f64 * 1e-6)?;
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
