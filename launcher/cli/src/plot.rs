//! `morphquad plot`: numbers of a recording over time, as a picture.

use super::bar::busy;
use super::flown::{recorded, unreadable};
use super::keep_safe::write_page;
use super::options::PlotArguments;
use super::refusal::{Done, Failure};
use host::exit;
use std::ffi::OsStr;
use std::io::Write;
use viewers::plot::{PlotError, Signal, plot};

/// Draws a panel for each argument.
pub(super) fn run(arguments: &PlotArguments, out: &mut dyn Write) -> Done {
    let path = arguments.out.clone().unwrap_or_else(|| arguments.file.with_extension("png"));
    let ending = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_lowercase();
    if !["png", "svg", "pdf"].contains(&ending.as_str()) {
        let told = format!("--out {}: a picture ends with .png, .svg or .pdf", path.display());
        return Err(Failure::plain(&told, exit::USAGE));
    }
    let signals = |argument: &String| argument.split(',').map(Signal::parse).collect();
    let panels: Result<Vec<Vec<Signal>>, PlotError> =
        arguments.signals.iter().map(signals).collect();
    let panels = panels.map_err(|error| unreadable(&error))?;
    let from_s = arguments.from.map_or(f64::NEG_INFINITY, |from| from.as_secs_f64());
    let to_s = arguments.to.map_or(f64::INFINITY, |to| to.as_secs_f64());
    let flight = recorded(&arguments.file)?;
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
