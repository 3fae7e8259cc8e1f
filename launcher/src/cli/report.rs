//! `morphquad report`: a recording judged, told and drawn.

use super::options::{Format, ReportArguments};
use super::refusal::{Done, Failure};
use crate::exit;
use crate::record::read::RecordedFlight;
use crate::report::{Report, document, pictures};
use crate::results::ResultsFolder;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Reports on one recording or on all of a folder; 1 if a gate fails.
pub(super) fn run(arguments: &ReportArguments, out: &mut dyn Write) -> Done {
    let flights = if arguments.file.is_dir() {
        let files = recordings_in(&arguments.file)?;
        let open = |path: &PathBuf| RecordedFlight::open(path).map_err(|error| unfit(&error));
        files.iter().map(open).collect::<Result<Vec<_>, _>>()?
    } else {
        vec![super::flown::open(&arguments.file)?]
    };
    let bar = super::bar::bar(flights.len(), "recordings");
    let mut reports = Vec::with_capacity(flights.len());
    for flight in &flights {
        reports.push(Report::of(flight).map_err(|error| unfit(&error))?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(folder) = &arguments.png {
        write_pictures(&reports, folder)?;
    }
    if let Some(path) = &arguments.html {
        std::fs::write(path, document(&reports)).map_err(|error| {
            let path = path.display();
            unfit(&format!("cannot write {path}: {error}; give --html a file that you may write"))
        })?;
    }
    tell(&reports, arguments, out)?;
    let passes = reports.iter().all(Report::passes);
    Ok(if passes { exit::PASS } else { exit::GATE_FAILED })
}

fn unfit(error: &dyn std::fmt::Display) -> Failure {
    Failure::plain(&error, exit::UNFIT)
}

fn tell(
    reports: &[Report],
    arguments: &ReportArguments,
    out: &mut dyn Write,
) -> Result<(), Failure> {
    match arguments.format {
        Format::Json => {
            let told: serde_json::Value = match reports {
                [one] if !arguments.file.is_dir() => one.to_json(),
                several => several.iter().map(Report::to_json).collect(),
            };
            writeln!(out, "{told}")?;
        }
        Format::Text if arguments.file.is_dir() => {
            let passed = reports.iter().filter(|report| report.passes()).count();
            let word = if passed == reports.len() { "PASS" } else { "FAIL" };
            writeln!(out, "{word}: {passed} of {} flights pass.", reports.len())?;
            for report in reports {
                writeln!(out, "{}: {}", report.file, report.sentence)?;
            }
        }
        Format::Text => {
            for report in reports {
                write!(out, "{report}")?;
            }
        }
    }
    if let (Format::Text, Some(path)) = (arguments.format, &arguments.html) {
        writeln!(out, "{}: open it in a browser", path.display())?;
    }
    out.flush()?;
    Ok(())
}

/// Every recording of a folder, by name.
fn recordings_in(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error: &dyn std::fmt::Display| {
        let folder = folder.display();
        unfit(&format!("cannot report on {folder}: {error}; give a recording or a folder of them"))
    };
    let entries = std::fs::read_dir(folder).map_err(|error| failed(&error))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut files: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|extension| extension == "mcap"))
        .collect();
    files.sort();
    if files.is_empty() { Err(failed(&"it holds no file *.mcap")) } else { Ok(files) }
}

/// One picture each, in a folder of its own for each of several recordings.
fn write_pictures(reports: &[Report], folder: &Path) -> Result<(), Failure> {
    for report in reports {
        let name = Path::new(&report.file).file_stem().unwrap_or_default();
        let folder = if reports.len() > 1 { folder.join(name) } else { folder.to_owned() };
        let failed = |error| Failure::report(error, exit::UNFIT);
        let mut folder = ResultsFolder::create(&folder).map_err(failed)?;
        for (name, figure) in pictures(report) {
            folder.bitmap(name, &figure).map_err(failed)?;
        }
    }
    Ok(())
}
