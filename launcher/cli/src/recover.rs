//! `morphquad recover`: a complete file of what a killed recorder has left.

use super::bar::busy;
use super::flown::Writers;
use super::options::{Format, RecoverArguments};
use super::refusal::{Done, Failure};
use host::exit;
use record::read::{Damage, RecordedFlight, RecoverError, recover};
use serde_json::json;
use std::io::Write;

/// Behind the name of a recording, in that of its complete copy.
pub(super) const RECOVERED: &str = "-recovered.mcap";

/// Writes the new file and prints what it holds.
pub(super) fn run(arguments: &RecoverArguments, out: &mut dyn Write) -> Done {
    let from = &arguments.file;
    let to = arguments.out.clone().unwrap_or_else(|| {
        let stem = from.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        from.with_file_name(format!("{stem}{RECOVERED}"))
    });
    let writer = RecordedFlight::open(from).ok().and_then(|flight| Writers::now().of(&flight));
    if let Some(run) = writer {
        let reason = format!(
            "{}: run {run} is active and still writes it; recover it if it is cut when the run is over",
            from.display()
        );
        return Err(Failure::plain(&reason, exit::USAGE));
    }
    let busy = busy("recovering");
    let recovered = recover(from, &to);
    drop(busy);
    let recovered = recovered.map_err(|error| {
        let code = match &error {
            RecoverError::Write { .. } | RecoverError::Exists { .. } => exit::UNFIT,
            RecoverError::Read(_) | RecoverError::Complete { .. } => exit::USAGE,
        };
        Failure::plain(&error, code)
    })?;
    let end_s = recovered.end_ns as f64 / 1e9;
    match arguments.format {
        Format::Text => {
            let (count, gaps, to) = (recovered.messages, recovered.gaps, to.display());
            writeln!(out, "{count} messages up to {end_s:.3} s, {gaps} missing between: {to}")?;
            if let Some(Damage { first, left_out, end, unknown }) = &recovered.damage {
                writeln!(out, "{} is {first}", from.display())?;
                writeln!(
                    out,
                    "left out: {left_out} damaged parts, {unknown} messages of unknown topics"
                )?;
                if let Some(end) = end {
                    writeln!(out, "what comes behind is lost: {end}")?;
                }
            }
        }
        Format::Json => {
            let object = json!({
                "file": to.display().to_string(),
                "messages": recovered.messages,
                "gaps": recovered.gaps,
                "end_s": end_s,
                "damage": recovered.damage.map(|damage| json!({
                    "first": damage.first,
                    "left_out": damage.left_out,
                    "unknown": damage.unknown,
                    "end": damage.end,
                })),
            });
            writeln!(out, "{object}")?;
        }
    }
    Ok(exit::PASS)
}
