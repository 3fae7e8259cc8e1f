//! `morphquad doctor`: is this machine fit to fly in realtime?

use super::options::{DoctorArguments, Format};
use super::refusal::Done;
use host::exit;
use std::io::Write;

/// Examines, after mending if asked to; 0 if fit, 3 if not.
pub(super) fn run(arguments: &DoctorArguments, out: &mut dyn Write) -> Done {
    let fixed = if arguments.fix { doctor::fix() } else { Vec::new() };
    let report = doctor::Report { fixed, ..doctor::examine(&arguments.record) };
    match arguments.format {
        Format::Text => write!(out, "{report}")?,
        Format::Json => writeln!(out, "{}", report.to_json())?,
    }
    out.flush()?;
    Ok(if report.is_fit() { exit::PASS } else { exit::UNFIT })
}
