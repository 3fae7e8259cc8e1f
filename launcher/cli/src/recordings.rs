//! `morphquad recordings`: which there are, and what one of them is.

use super::flown::{named_or_latest, recorded, unreadable};
use super::named::{FOLDER, newest, of_folder, stem};
use super::options::{Format, RecordingsCommand, RecordingsListArguments, RecordingsShowArguments};
use super::refusal::Done;
use core::time::Duration;
use host::exit;
use humantime::format_rfc3339_seconds;
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
                json!({"file": file, "bytes": bytes, "began": began(flight), "facts": flight.facts()})
            }
            Err(error) => json!({"file": file, "bytes": bytes, "unreadable": error.to_string()}),
        }
    }

    /// Cells of its line.
    fn cells(&self) -> [String; 7] {
        let size = format!("{:.1} MB", self.length as f64 * 1e-6);
        let Ok(flight) = &self.flight else {
            let empty = String::new;
            let cannot = "cannot be read".into();
            return [stem(&self.path), cannot, empty(), empty(), empty(), empty(), size];
        };
        let [run, scenario, seed, clock] =
            ["run_id", "scenario", "seed", "clock"].map(|key| fact(flight, key));
        [stem(&self.path), began(flight), run, scenario, seed, clock, size]
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
            let head =
                ["NAME", "BEGAN", "RUN", "SCENARIO", "SEED", "CLOCK", "SIZE"].map(str::to_owned);
            let lines: Vec<[String; 7]> =
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
fn write_line(lines: &[[String; 7]], line: &[String; 7], out: &mut dyn Write) -> io::Result<()> {
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
        let mut told = Entry { path, length, flight: Ok(flight) }.to_json();
        told["line"] = json!(report.line);
        told["lacks"] = json!(report.lacks);
        told["again"] = json!(report.again);
        writeln!(out, "{told}")?;
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
