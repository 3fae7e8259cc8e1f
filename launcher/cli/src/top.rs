//! `morphquad top`.

use super::options::{Cli, Format, TopArguments};
use super::ps::Trouble;
use super::refusal::{Done, Failure};
use anstream::adapter::strip_str;
use host::exit;
use protocol::control::runs;
use runtime::clock::{mono_now_ns, sleep_until};
use serde_json::json;
use std::ffi::OsString;
use std::io::{self, IsTerminal as _, Write};
use viewers::top::draw::plain;
use viewers::top::screen::{GaugeReader, show, status_of};
use viewers::top::snapshot::Usage;

/// How long one look takes \[ns\].
const LOOK_NS: u64 = 1_000_000_000;

/// Shows a run until asked to stop, or once.
pub(super) fn run(arguments: &TopArguments, out: &mut dyn Write) -> Done {
    let refuse = |trouble: Trouble| {
        let code = trouble.exit_code();
        Failure::report(trouble, code)
    };
    let found = runs::find(arguments.run.run.as_deref()).map_err(|error| refuse(error.into()))?;
    let first = status_of(&found).map_err(|error| refuse(error.into()))?;
    let reader = GaugeReader::open(&found).map_err(|error| refuse(error.into()))?;
    let on_terminal = io::stdout().is_terminal() && io::stdin().is_terminal();
    if !arguments.once && on_terminal {
        show(&found, &reader, first, execute)?;
        return Ok(exit::PASS);
    }
    // The first look is what processor time is counted from.
    let (mut usage, begin_ns) = (Usage::default(), mono_now_ns());
    let _ = reader.snapshot(first, &mut usage, 0.0);
    sleep_until(begin_ns + LOOK_NS);
    let status = status_of(&found).map_err(|error| refuse(error.into()))?;
    let snapshot =
        reader.snapshot(status, &mut usage, mono_now_ns().saturating_sub(begin_ns) as f64 / 1e9);
    match arguments.format {
        Format::Text => write!(out, "{}", plain(&snapshot))?,
        Format::Json => {
            let mut all = json!(snapshot.status);
            all["loops"] = json!(snapshot.loops);
            all["dropped"] = json!(snapshot.dropped);
            if let Some(object) = all.as_object_mut() {
                object.remove("processes");
            }
            writeln!(out, "{all}")?;
        }
    }
    out.flush()?;
    Ok(exit::PASS)
}

/// Runs a command typed on the screen, and returns all that it prints.
fn execute(arguments: Vec<String>) -> Vec<String> {
    let arguments: Vec<OsString> = arguments.into_iter().map(Into::into).collect();
    // A help is printed on the terminal, which here is the screen's.
    if let Some(help) = Cli::of(&arguments).err().filter(|error| !error.use_stderr()) {
        return help.render().to_string().lines().map(str::to_owned).collect();
    }
    let (mut out, mut diagnostics) = (Vec::new(), Vec::new());
    let code = super::execute(arguments.into_iter(), &mut out, &mut diagnostics);
    let text = [out, diagnostics].concat();
    // Complaints are coloured for the terminal, which here is the screen's.
    let text = strip_str(&String::from_utf8_lossy(&text)).to_string();
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let mut lines: Vec<String> = lines.map(str::to_owned).collect();
    if code != exit::PASS && lines.is_empty() {
        lines.push(format!("ended with {code}"));
    }
    lines
}
