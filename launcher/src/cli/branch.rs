//! `morphquad replay FILE --branch`: one flight taken up in the middle, or many.

use super::bar::bar;
use super::options::{BranchArguments, Format, ReplayArguments};
use crate::branch::sweep::{Interrupted, Sweep};
use crate::branch::{At, Branch, BranchError, Change};
use crate::campaign::{Axis, Case, Outcome, quoted, report, values};
use crate::exit;
use crate::in_process::{Difference, Tape};
use crate::record::read::{ReadError, RecordedFlight};
use crate::results::{ResultsError, ResultsFolder};
use crate::run::{Branched, Pin, RunError, RunOptions, Speed, run_branch};
use miette::Diagnostic;
use runtime::watch::StopFlags;
use std::io::{self, IsTerminal as _, Write};
use std::path::Path;
use std::sync::Arc;
use thiserror::Error;

/// Why nothing was flown.
#[derive(Debug, Error, Diagnostic)]
enum Trouble {
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Branch(#[from] BranchError),
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Results(#[from] ResultsError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Report(#[from] report::ReportError),
    #[error("{what}")]
    #[diagnostic(help("{remedy}"))]
    Argument { what: String, remedy: String },
    #[error("cannot watch signals: {0}")]
    Signals(io::Error),
    #[error("interrupted: a sweep keeps nothing")]
    Interrupted,
}

impl Trouble {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Read(_) | Self::Branch(_) | Self::Argument { .. } => exit::USAGE,
            Self::Interrupted | Self::Run(RunError::Interrupted) => exit::INTERRUPTED,
            _ => exit::UNFIT,
        }
    }
}

/// Flies one branch or a sweep of them. One branch ends as a run does, and with 1 if nothing was
/// changed and it still is another flight.
pub(super) fn run(
    replay: &ReplayArguments,
    at: At,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> io::Result<u8> {
    let many = !replay.branch.sweep.is_empty() || replay.branch.seeds.is_some();
    let flown = if many { fly_many(replay, at) } else { fly_one(replay, at) };
    match flown {
        Ok((text, code)) => {
            writeln!(out, "{}", text.trim_end())?;
            Ok(code)
        }
        Err(error) => {
            let code = error.exit_code();
            writeln!(diagnostics, "{:?}", miette::Report::new(error))?;
            Ok(code)
        }
    }
}

fn prepare(file: &Path, at: At) -> Result<(Branch, String), Trouble> {
    let recorded = RecordedFlight::open(file)?;
    let mut tape = Tape::default();
    recorded.visit(&mut tape)?;
    let run = recorded.facts().get("run_id").cloned().unwrap_or_default();
    Ok((Branch::prepare(recorded.scenario().clone(), Arc::new(tape), at)?, run))
}

fn fly_one(replay: &ReplayArguments, at: At) -> Result<(String, u8), Trouble> {
    let arguments = &replay.branch;
    let (branch, run) = prepare(&replay.file, at)?;
    let change = change(replay);
    let changed = branch.change(&change).map_err(BranchError::from)?;
    // Who refuses its state says so here, before there is a recording.
    branch.resume(&changed, ())?;
    let options = RunOptions {
        scenario: changed.scenario.clone(),
        speed: Speed::Max,
        record: arguments.record.clone(),
        pin: Pin::None,
        disorder: None,
        progress: io::stderr().is_terminal(),
    };
    let origin = format!("branch of run {run} at {} s{}", seconds(&branch), told(&change));
    let Branched { summary, same, first } = run_branch(&branch, &changed, &options, &origin)?;
    let departs = change.is_none() && first.is_some() && !summary.interrupted;
    let code = summary.exit_code();
    let code = if departs && code == exit::PASS { exit::GATE_FAILED } else { code };
    let text = match replay.format {
        Format::Json => {
            let mut json = summary.to_json();
            json["branch"] = in_json(&branch, &run, same, first.as_ref());
            json.to_string()
        }
        Format::Text => {
            let compared = first.as_ref().map_or_else(
                || format!("identical from there on: {same} samples compared"),
                |first| format!("first difference {first}"),
            );
            format!("{origin}: {compared}\n{summary}")
        }
    };
    Ok((text, code))
}

fn seconds(branch: &Branch) -> f64 {
    branch.at_ns() as f64 * 1e-9
}

fn change(replay: &ReplayArguments) -> Change {
    let BranchArguments { swap, seed, duration, .. } = replay.branch.clone();
    Change { set: replay.set.clone(), swap, seed, duration }
}

/// The changes as they were asked for.
fn told(change: &Change) -> String {
    let set = change.set.iter().map(|setting| format!(" --set {}", quoted(setting)));
    let swap = change.swap.iter().map(|swap| format!(" --swap {}", quoted(swap)));
    let seed = change.seed.map(|seed| format!(" --seed {seed}"));
    let end = change.duration.map(|duration| format!(" --for {}s", duration.as_secs_f64()));
    set.chain(swap).chain(seed).chain(end).collect()
}

fn in_json(branch: &Branch, run: &str, same: u64, first: Option<&Difference>) -> serde_json::Value {
    let first = first.map(|first| {
        serde_json::json!({
            "t_s": first.release_ns as f64 * 1e-9,
            "topic": first.topic,
            "field": first.field,
            "old": first.old,
            "new": first.new,
        })
    });
    serde_json::json!({
        "of_run": run,
        "at_s": seconds(branch),
        "identical": first.is_none(),
        "same_samples": same,
        "first_difference": first,
    })
}

fn fly_many(replay: &ReplayArguments, at: At) -> Result<(String, u8), Trouble> {
    let (file, arguments) = (&replay.file, &replay.branch);
    let change = change(replay);
    let axes = arguments.sweep.iter().map(|text| axis(text)).collect::<Result<Vec<_>, _>>()?;
    let seeds = arguments.seeds.as_deref().map(values::seeds).transpose();
    let seeds = seeds.map_err(|what| argument(what, "write --seeds 0..999"))?;
    if arguments.record.is_some() {
        let remedy = "leave --record away, and record the branch that is of interest alone";
        return Err(argument("a sweep records nothing", remedy));
    }
    let mut folder = ResultsFolder::create(&arguments.out)?;
    let (branch, run) = prepare(file, at)?;
    // A swap that cannot be is an error, not a table full of refusals.
    branch.change(&Change { set: Vec::new(), ..change.clone() }).map_err(BranchError::from)?;
    let own = branch.scenario().settings().scenario.seed;
    let one = vec![arguments.seed.unwrap_or(own)];
    let reseed = seeds.is_some() || arguments.seed.is_some();
    let cases = Case::all(&axes, &seeds.unwrap_or(one));
    let sweep = Sweep { branch: &branch, change: &change, axes: &axes, reseed };
    let stop = StopFlags::watch_signals().map_err(Trouble::Signals)?;
    let bar = bar(cases.len(), "branches");
    let flown = sweep.fly(&cases, &|| stop.signalled(), &|| bar.inc(1));
    bar.finish_and_clear();
    let outcomes = flown.map_err(|Interrupted| Trouble::Interrupted)?;
    let flown: Vec<(Case, Outcome)> = cases.into_iter().zip(outcomes).collect();
    report::write("branches", &report::table(&axes, &flown), &mut folder)?;
    let code = report::exit_code(&flown);
    let command = |case: &Case| command(file, at, &sweep, case);
    let files: Vec<_> = folder.written().iter().map(|path| path.display().to_string()).collect();
    let text = match replay.format {
        Format::Json => {
            let mut json = report::to_json(&axes, &flown, WORST, &command);
            json["branch"] = serde_json::json!({"of_run": run, "at_s": seconds(&branch)});
            json["files"] = files.into();
            json.to_string()
        }
        Format::Text => format!(
            "{} branches of run {run} at {} s\n{}\n{}\nwrote {}",
            flown.len(),
            seconds(&branch),
            report::figures(&flown),
            report::worst_cases(&axes, &flown, WORST, &command),
            files.join(", "),
        ),
    };
    Ok((text, code))
}

/// Worst branches listed.
const WORST: usize = 5;

/// The command line that flies one branch of a sweep alone and records it.
fn command(file: &Path, at: At, sweep: &Sweep<'_>, case: &Case) -> String {
    let file = quoted(&file.display().to_string());
    format!(
        "morphquad replay {file} --branch {at}{} --record recordings",
        told(&sweep.change(case))
    )
}

/// `KEY=a..b/n`, or `KEY=[v, w]`.
fn axis(text: &str) -> Result<Axis, Trouble> {
    let remedy =
        "write --sweep KEY=a..b/n, for example --sweep plant.mismatch.mass_scale=0.9..1.1/5";
    let (key, range) = text
        .split_once('=')
        .ok_or_else(|| argument(format!("--sweep {text} has no `=`"), remedy))?;
    let values = match range.trim().parse::<toml::Value>() {
        Ok(toml::Value::Array(list)) if !list.is_empty() => {
            list.iter().map(toml::Value::to_string).collect()
        }
        _ => values::range(range)
            .map_err(|what| argument(format!("--sweep {text}: {what}"), remedy))?,
    };
    Ok(Axis { key: key.trim().to_owned(), values })
}

fn argument(what: impl Into<String>, remedy: impl Into<String>) -> Trouble {
    Trouble::Argument { what: what.into(), remedy: remedy.into() }
}
