//! `morphquad ps`: the processes and slots of a running flight.

use super::options::{Format, PsArguments};
use super::refusal::Done;
use host::exit;
use miette::Diagnostic;
use protocol::control::client::{AskError, Conversation};
use protocol::control::load::Load;
use protocol::control::runs::{self, FindError};
use protocol::control::status::{ProcessStatus, RunStatus};
use protocol::control::{Refusal, Reply, Request};
use protocol::topic::live::ListenError;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use thiserror::Error;

/// Why a running flight did not do as asked.
#[derive(Debug, Error, Diagnostic)]
pub(super) enum Trouble {
    #[error(transparent)]
    Find(#[from] FindError),
    #[error(transparent)]
    Ask(#[from] AskError),
    #[error(transparent)]
    Listen(#[from] ListenError),
    #[error("{0}")]
    Refused(Refusal),
    #[error("{0}")]
    OutOfRange(String),
    #[error("the launcher answered another question: ask with the executable that flies")]
    Astray,
}

impl Trouble {
    pub(super) fn exit_code(&self) -> u8 {
        match self {
            Self::Find(_) | Self::OutOfRange(_) => exit::USAGE,
            Self::Ask(_) | Self::Listen(_) | Self::Astray => exit::UNFIT,
            Self::Refused(refusal) => refusal.exit_code,
        }
    }
}

/// Asks and shows; 0 with an answer, 2 if it is not clear which run is meant, 3 without an answer.
pub(super) fn run(arguments: &PsArguments, out: &mut dyn Write) -> Done {
    let answer = ask(arguments).map(|status| {
        let text = match arguments.format {
            Format::Text => table(&status),
            Format::Json => json_of(&status).to_string(),
        };
        (text, exit::PASS)
    });
    super::conclude(answer, Trouble::exit_code, out)
}

fn ask(arguments: &PsArguments) -> Result<RunStatus, Trouble> {
    let run = runs::find(arguments.run.run.as_deref())?;
    match Conversation::ask(&run, &Request::Ps)?.receive()? {
        Reply::Status(status) => Ok(status),
        Reply::Refused(refusal) => Err(Trouble::Refused(refusal)),
        Reply::Progress(_) | Reply::Done(_) | Reply::Ordered(_) => Err(Trouble::Astray),
    }
}

fn load(process: &ProcessStatus) -> Option<Load> {
    process.pid.and_then(Load::of)
}

/// The launcher's answer, with what only the system knows about each process.
fn json_of(status: &RunStatus) -> Value {
    let mut json = json!(status);
    let shown = json["processes"].as_array_mut().into_iter().flatten();
    for (shown, process) in shown.zip(&status.processes) {
        let load = load(process);
        shown["cpu_percent"] = json!(load.map(|load| load.cpu_percent));
        shown["rss_bytes"] = json!(load.map(|load| load.rss_bytes));
    }
    json
}

fn table(status: &RunStatus) -> String {
    let RunStatus { run, scenario, clock, flown_s, end_s, launcher_pid, .. } = status;
    let stage = if status.started { "running" } else { "getting ready" };
    let mut text = format!(
        "run {run}  {scenario}, {clock}, {stage}: {flown_s:.3} of {end_s:.3} s, launcher {launcher_pid}\n"
    );
    if let Some(recording) = &status.recording {
        let _ = writeln!(text, "recording {recording}");
    }
    let _ = writeln!(
        text,
        "\n{:<21}{:<12}{:>8}{:>5}{:>5}{:>9}  {:<11}{:>11}{:>9}{:>8}{:>8}",
        "PROCESS", "ROLE", "PID", "SEAT", "GEN", "RATE", "STATE", "AT", "AGE", "CPU", "RSS"
    );
    for process in &status.processes {
        let load = load(process);
        let cpu = load.map_or("-".to_owned(), |load| format!("{:.1}%", load.cpu_percent));
        let rss = load.map_or("-".to_owned(), |load| format!("{} MB", load.rss_bytes >> 20));
        let _ = writeln!(
            text,
            "{:<21}{:<12}{:>8}{:>5}{:>5}{:>9}  {:<11}{:>11}{:>9}{cpu:>8}{rss:>8}",
            process.name,
            process.role,
            process.pid.map_or("-".to_owned(), |pid| pid.to_string()),
            process.seat,
            process.generation,
            format!("{} Hz", process.rate_hz),
            process.state.label(),
            format!("{:.3} s", process.mark_s),
            age(process.mark_age_s),
        );
    }
    let _ = writeln!(text, "\n{:<12}{:>6}  {:<21}FALLBACK", "SLOT", "EPOCH", "OWNER");
    for slot in &status.slots {
        let name = |name: &Option<String>| name.clone().unwrap_or_else(|| "-".to_owned());
        let (owner, fallback) = (name(&slot.owner), name(&slot.fallback));
        let line = format!("{:<12}{:>6}  {owner:<21}{fallback:<21}", slot.slot, slot.epoch);
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}

fn age(age_s: f64) -> String {
    if age_s < 1.0 { format!("{:.0} ms", age_s * 1e3) } else { format!("{age_s:.1} s") }
}
