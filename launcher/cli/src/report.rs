//! `morphquad report`: a recording judged, reported and drawn.

use super::flown::{self, Writers, unreadable};
use super::keep_safe::write_page;
use super::options::{Format, ReportArguments};
use super::recover::RECOVERED;
use super::refusal::{Done, Failure};
use document::shell_path;
use figures::results::ResultsFolder;
use host::exit;
use record::read::{RecordedFlight, facts_of};
use record::{Clock, named};
use replay::{Parting, are_of_one_scenario, parting};
use shared_types::time::s_from_ns;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use viewers::report::{Folder, Parted, Report, document, pictures};

/// Reports on one recording or on all of a folder; 1 if a gate fails, 2 if a file cannot be read.
pub(super) fn run(
    arguments: &ReportArguments,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> Done {
    if !arguments.more.is_empty() {
        let first = arguments.file.as_deref().unwrap_or(Path::new("."));
        let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = shell_path(folder.unwrap_or(Path::new(".")));
        let reason = format!(
            "report takes one recording, or all of a folder, not several: try `morphquad report {folder}`"
        );
        return Err(unreadable(&reason));
    }
    let file = flown::named_or_latest(arguments.file.as_deref(), diagnostics)?;
    let is_folder = file.is_dir();
    let folder = if is_folder {
        of_folder(&recordings_in(&file)?)
    } else {
        let flight = flown::open(&file)?;
        if let Some(run) = Writers::now().of(&flight) {
            let file = file.display();
            return Err(unreadable(&format!(
                "{file}: {}; look at it with `morphquad top --run {run}`",
                still_writes(&run)
            )));
        }
        let busy = super::bar::busy("reading");
        let report = Report::of(&flight);
        drop(busy);
        let mut report = report.map_err(|error| unreadable(&error))?;
        report.parted = parted(&flight, &known(&beside(flight.path())));
        Folder { reports: vec![report], ..Folder::default() }
    };
    if let Some(path) = &arguments.png {
        write_pictures(&folder.reports, path)?;
    }
    if let Some(path) = &arguments.html {
        write_page(path, document(&folder), "--html")?;
    }
    let verdict = match &folder {
        Folder { unread, .. } if !unread.is_empty() => exit::USAGE,
        // Nothing has passed where nothing was judged.
        Folder { reports, .. } if reports.is_empty() => exit::USAGE,
        Folder { reports, .. } if !reports.iter().all(Report::passes) => exit::FAILED,
        _ => exit::PASS,
    };
    match show(&folder, is_folder, arguments, out) {
        // A reader that has seen enough, such as `head`, makes no pass of a fail.
        Err(Failure::Unwritten(error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(verdict),
        written => written.map(|()| verdict),
    }
}

/// Whatever can be reported of a folder's files; what cannot be read, or is not to be judged, is named.
fn of_folder(files: &[PathBuf]) -> Folder {
    let bar = super::bar::bar(files.len(), "recordings");
    let mut folder = Folder::default();
    let writers = Writers::now();
    let known = known(files);
    for path in files {
        let file = || path.display().to_string();
        bar.inc(1);
        if let Some(copy) = recovered(path).filter(|copy| files.contains(copy)) {
            let why = format!("recovered as {}, which is judged instead", copy.display());
            folder.left_out.push((file(), why));
            continue;
        }
        let flight = RecordedFlight::open(path);
        if let Some(run) = flight.as_ref().ok().and_then(|flight| writers.of(flight)) {
            folder.left_out.push((file(), still_writes(&run)));
            continue;
        }
        let report = flight.map_err(|error| error.to_string()).and_then(|flight| {
            let mut report = Report::of(&flight).map_err(|error| error.to_string())?;
            report.parted = parted(&flight, &known);
            Ok(report)
        });
        match report {
            Ok(report) => folder.reports.push(report),
            Err(why) => folder.unread.push((file(), why)),
        }
    }
    bar.finish_and_clear();
    folder
}

/// A flight is compared with so many others of its scenario, the newest.
const COMPARED: usize = 20;

/// Recordings with what their heads say.
type Known = Vec<(PathBuf, BTreeMap<String, String>)>;

fn known(files: &[PathBuf]) -> Known {
    files.iter().filter_map(|path| Some((path.clone(), facts_of(path)?))).collect()
}

/// The newest of `known` that is of the same scenario as a flight in simulated time, and of another flight.
fn parted(flight: &RecordedFlight, known: &Known) -> Option<Parted> {
    if flight.clock() != Clock::Lockstep {
        return None;
    }
    let alike = |(path, facts): &&(PathBuf, BTreeMap<String, String>)| {
        let mut keys = ["scenario", "seed", "clock"].iter();
        path.file_name() != flight.path().file_name()
            && keys.all(|key| facts.get(*key) == flight.facts().get(*key))
    };
    let mut others: Vec<_> = known.iter().filter(alike).collect();
    others.sort_by_key(|(_, facts)| facts.get("epoch_unix_ns"));
    let newest = others.iter().rev().take(COMPARED);
    newest.filter_map(|(path, _)| RecordedFlight::open(path).ok()).find_map(|other| {
        let other = Some(&other).filter(|other| are_of_one_scenario(flight, other))?;
        let parting = parting(flight, other).ok()??;
        let text = parting.to_string();
        let Parting { release_ns, topic, writer, .. } = parting;
        Some(Parted {
            file: other.path().display().to_string(),
            at_s: s_from_ns(release_ns),
            topic: topic.to_owned(),
            writer: writer.to_string(),
            text,
        })
    })
}

/// The recordings in the folder of one.
fn beside(path: &Path) -> Vec<PathBuf> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    named::of_folder(folder.unwrap_or(Path::new("."))).unwrap_or_default()
}

fn still_writes(run: &str) -> String {
    format!("run {run} is active and still writes it; it is judged when the run is over")
}

/// Where `recover` puts the complete copy of a recording.
fn recovered(path: &Path) -> Option<PathBuf> {
    let stem = path.file_stem()?.to_string_lossy();
    Some(path.with_file_name(format!("{stem}{RECOVERED}")))
}

fn show(
    folder: &Folder,
    is_folder: bool,
    arguments: &ReportArguments,
    out: &mut dyn Write,
) -> Result<(), Failure> {
    match (arguments.format, &folder.reports[..]) {
        (Format::Json, [one]) if !is_folder => writeln!(out, "{}", one.to_json())?,
        (Format::Json, _) => writeln!(out, "{}", folder.to_json())?,
        (Format::Text, reports) if is_folder => {
            writeln!(out, "{}", folder.sentence())?;
            for report in reports {
                writeln!(out, "{}: {}", report.file, report.line)?;
                if let Some(parted) = &report.parted {
                    writeln!(out, "  {parted}")?;
                }
            }
            for (_, why) in &folder.unread {
                writeln!(out, "{why}")?;
            }
            for (file, why) in &folder.left_out {
                writeln!(out, "{file}: {why}")?;
            }
        }
        (Format::Text, reports) => {
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
        unreadable(&format!(
            "cannot report on {folder}: {error}; give a recording or a folder of them"
        ))
    };
    let files = named::of_folder(folder).map_err(|error| failed(&error))?;
    if files.is_empty() { Err(failed(&"it holds no file *.mcap")) } else { Ok(files) }
}

/// One picture each, in a folder of its own for each of several recordings.
fn write_pictures(reports: &[Report], folder: &Path) -> Result<(), Failure> {
    for report in reports {
        let name = Path::new(&report.file).file_stem().unwrap_or_default();
        let folder = if reports.len() > 1 { folder.join(name) } else { folder.to_owned() };
        let failed = |error| Failure::report(error, exit::UNFIT);
        let mut folder = ResultsFolder::named_by("--png DIR", &folder).map_err(failed)?;
        for (name, figure) in pictures(report) {
            folder.bitmap(name, &figure).map_err(failed)?;
        }
    }
    Ok(())
}
