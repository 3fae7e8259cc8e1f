//! `morphquad plot`: numbers of a recording over time, as a picture.

use super::bar::busy;
use super::flown::{named_or_latest, recorded, unreadable};
use super::keep_safe::write_page;
use super::named::named;
use super::options::PlotArguments;
use super::refusal::{Done, Failure};
use host::exit;
use protocol::topic::known;
use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};
use viewers::plot::{PlotError, Signal, plot};

/// The recording, if one is named before the signals, and these.
fn parted(words: &[String]) -> Result<(Option<PathBuf>, &[String]), Failure> {
    let is_signal = |word: &String| {
        let topic = word.trim_start_matches('/').split(['.', ',']).next().unwrap_or_default();
        known(topic).is_some() && !Path::new(word).is_file()
    };
    let [first, signals @ ..] = words else { return Ok((None, words)) };
    if is_signal(first) {
        return Ok((None, words));
    }
    let file = named(Path::new(first)).map_err(|error| unreadable(&error))?;
    if signals.is_empty() {
        let told = if file.is_file() {
            "name what to draw, for example truth.position_w_m: `morphquad topic list` names topics"
        } else {
            "there is no such recording and no such topic: `morphquad topic list` names topics"
        };
        return Err(unreadable(&format!("{first}: {told}")));
    }
    Ok((Some(file), signals))
}

/// Draws a panel for each signal or list of signals.
pub(super) fn run(arguments: &PlotArguments, out: &mut dyn Write) -> Done {
    let (file, signals) = parted(&arguments.words)?;
    let file = named_or_latest(file.as_deref(), &mut std::io::stderr())?;
    let path = arguments.out.clone().unwrap_or_else(|| file.with_extension("png"));
    let ending = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_lowercase();
    if !["png", "svg", "pdf"].contains(&ending.as_str()) {
        let told = format!("--out {}: a picture ends with .png, .svg or .pdf", path.display());
        return Err(Failure::plain(&told, exit::USAGE));
    }
    let panel = |argument: &String| argument.split(',').map(Signal::parse).collect();
    let panels: Result<Vec<Vec<Signal>>, PlotError> = signals.iter().map(panel).collect();
    let panels = panels.map_err(|error| unreadable(&error))?;
    let from_s = arguments.from.map_or(f64::NEG_INFINITY, |from| from.as_secs_f64());
    let to_s = arguments.to.map_or(f64::INFINITY, |to| to.as_secs_f64());
    let flight = recorded(&file)?;
    let busy = busy("drawing");
    let figure = plot(&flight, &panels, (from_s, to_s)).map_err(|error| unreadable(&error))?;
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
