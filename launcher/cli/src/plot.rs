//! `morphquad plot`: numbers of recordings over time, as a picture.

use super::bar::busy;
use super::flown::{named_or_latest, recorded, unreadable};
use super::keep_safe::write_page;
use super::options::PlotArguments;
use super::refusal::{Done, Failure};
use host::exit;
use protocol::topic::known;
use record::named::named;
use record::read::RecordedFlight;
use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};
use viewers::plot::{PlotError, Signal, plot};

/// True for what is to be drawn, misspelt or not, and false for what is or can only be a recording.
fn is_signal(argument: &str) -> bool {
    let signal = argument.trim_start_matches('/');
    let topic = signal.split(['.', ',']).next().unwrap_or_default();
    if known(topic).is_some() {
        return !Path::new(argument).is_file();
    }
    let is_path =
        signal.contains('/') || Path::new(signal).extension().is_some_and(|kind| kind == "mcap");
    signal.contains('.') && !is_path && named(Path::new(argument)).is_ok_and(|file| !file.is_file())
}

/// The recordings that are named before the signals, and these.
fn parted(arguments: &[String]) -> Result<(Vec<PathBuf>, &[String]), Failure> {
    let recordings =
        arguments.iter().position(|argument| is_signal(argument)).unwrap_or(arguments.len());
    let (recordings, signals) = arguments.split_at(recordings);
    let files = recordings.iter().map(|argument| named(Path::new(argument)));
    let files: Vec<PathBuf> = files.collect::<Result<_, _>>().map_err(|e| unreadable(&e))?;
    let Some(last) = recordings.last().filter(|_| signals.is_empty()) else {
        return Ok((files, signals));
    };
    let reason = if files.iter().all(|file| file.is_file()) {
        "name what to draw, for example truth.position_w_m: `morphquad topic list` names topics"
    } else {
        "there is no such recording and no such topic: `morphquad topic list` names topics"
    };
    Err(unreadable(&format!("{last}: {reason}")))
}

/// Draws a panel for each signal or list of signals.
pub(super) fn run(arguments: &PlotArguments, out: &mut dyn Write) -> Done {
    let (mut files, signals) = parted(&arguments.words)?;
    if files.is_empty() {
        files.push(named_or_latest(None, &mut std::io::stderr())?);
    }
    let path = arguments.out.clone().unwrap_or_else(|| files[0].with_extension("png"));
    let ending = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_lowercase();
    if !["png", "svg", "pdf"].contains(&ending.as_str()) {
        let reason = format!("--out {}: a picture ends with .png, .svg or .pdf", path.display());
        return Err(Failure::plain(&reason, exit::USAGE));
    }
    let panel = |argument: &String| argument.split(',').map(Signal::parse).collect();
    let panels: Result<Vec<Vec<Signal>>, PlotError> = signals.iter().map(panel).collect();
    let panels = panels.map_err(|error| unreadable(&error))?;
    let from_s = arguments.from.map_or(f64::NEG_INFINITY, |from| from.as_secs_f64());
    let to_s = arguments.to.map_or(f64::INFINITY, |to| to.as_secs_f64());
    let flights: Vec<RecordedFlight> =
        files.iter().map(|file| recorded(file)).collect::<Result<_, _>>()?;
    let busy = busy("drawing");
    let figure = plot(&flights, &panels, (from_s, to_s)).map_err(|error| unreadable(&error))?;
    let picture = match ending.as_str() {
        "svg" => Ok(figure.to_svg().into_bytes()),
        "pdf" => Ok(figure.to_pdf()),
        _ => figure.to_png(),
    };
    let picture = picture.map_err(|error| Failure::plain(&error, exit::UNFIT))?;
    drop(busy);
    write_page(&path, picture, "--out")?;
    writeln!(out, "{}", path.display())?;
    out.flush()?;
    Ok(exit::PASS)
}
