//! `morphquad recover`: a complete file of what a killed recorder has left.

use super::bar::busy;
use super::options::{Format, RecoverArguments};
use super::refusal::{Done, Failure};
use crate::exit;
use crate::record::read::{RecoverError, recover};
use serde_json::json;
use std::io::Write;

/// Writes the new file and tells what it holds.
pub(super) fn run(arguments: &RecoverArguments, out: &mut dyn Write) -> Done {
    let from = &arguments.file;
    let to = arguments.out.clone().unwrap_or_else(|| {
        let stem = from.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        from.with_file_name(format!("{stem}-recovered.mcap"))
    });
    let busy = busy("recovering");
    let recovered = recover(from, &to);
    drop(busy);
    let recovered = recovered.map_err(|error| {
        let code = match &error {
            RecoverError::Write { .. } => exit::UNFIT,
            RecoverError::Read(_) | RecoverError::Complete { .. } => exit::USAGE,
        };
        Failure::plain(&error, code)
    })?;
    let end_s = recovered.end_ns as f64 / 1e9;
    match arguments.format {
        Format::Text => {
            let (count, gaps, to) = (recovered.messages, recovered.gaps, to.display());
            writeln!(out, "{count} messages up to {end_s:.3} s, {gaps} missing between: {to}")?;
            if let Some(damage) = &recovered.damage {
                writeln!(out, "what comes behind is lost: {damage}")?;
            }
        }
        Format::Json => {
            let told = json!({
                "file": to,
                "messages": recovered.messages,
                "gaps": recovered.gaps,
                "end_s": end_s,
                "damage": recovered.damage,
            });
            writeln!(out, "{told}")?;
        }
    }
    Ok(exit::PASS)
}
