//! `morphquad replay FILE --branch`: one flight taken up in the middle, or many.

use super::bar::bar;
use super::options::{BranchArguments, Format, ReplayArguments};
use super::refusal::Done;
use experiments::branch::sweep::{Interrupted, Sweep};
use experiments::branch::{At, Branch, BranchError, Change, ChangeError, FlownBranch, run_branch};
use experiments::campaign::{Axis, Case, MAX_CASES, Outcome, quoted, report, values};
use figures::results::{ResultsError, ResultsFolder};
use host::exit;
use miette::Diagnostic;
use record::Branched;
use record::read::{ReadError, RecordedFlight};
use runtime::watch::StopFlags;
use shared_types::Role;
use simulate::in_process::{Difference, InProcessError, Tape};
use simulate::{Pin, RunError, RunOptions, Speed};
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
    #[error("{file} is {branched}; at {at_s} s it cannot be taken up with the changed scenario")]
    #[diagnostic(help(
        "branch from the recording of run {}, or here at an instant after {} s by which every loop \
         has published its state", branched.parent_run, branched.at_ns as f64 / 1e9
    ))]
    Branched { file: String, branched: Branched, at_s: f64 },
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
            Self::Read(ReadError::TooLong { .. }) => exit::UNFIT,
            Self::Read(_) | Self::Branch(_) | Self::Branched { .. } | Self::Argument { .. } => {
                exit::USAGE
            }
            Self::Interrupted | Self::Run(RunError::Interrupted) => exit::INTERRUPTED,
            _ => exit::UNFIT,
        }
    }
}

/// Flies one branch or a sweep of them. One branch ends as a run does, and with 1 if nothing was
/// changed and it still is another flight.
pub(super) fn run(replay: &ReplayArguments, at: At, out: &mut dyn Write) -> Done {
    let many = !replay.branch.sweep.is_empty() || replay.branch.seeds.is_some();
    let flown = match &replay.branch.out {
        _ if many => fly_many(replay, at),
        Some(_) => {
            let remedy = "leave --out away, or fly many with --sweep or --seeds";
            Err(argument("one branch writes no table", remedy))
        }
        None => fly_one(replay, at),
    };
    super::conclude(flown, Trouble::exit_code, out)
}

/// A branch and the recording that it is of.
struct Prepared {
    branch: Branch,
    run: String,
    /// The change with which the recording was flown in its turn.
    branched: Option<Branched>,
    /// False if the file ends early.
    complete: bool,
}

fn prepare(file: &Path, at: At) -> Result<Prepared, Trouble> {
    let recorded = RecordedFlight::open(file)?;
    let branched = recorded.branched().cloned();
    let graph = recorded.scenario().graph().map_err(InProcessError::from);
    let graph = graph.map_err(BranchError::from)?;
    let at_ns = at.instant_ns(graph.node(Role::Plant).map(|plant| plant.rate));
    let refused = |branched: &Branched| {
        let file = file.display().to_string();
        Trouble::Branched { file, branched: branched.clone(), at_s: at_ns as f64 / 1e9 }
    };
    if let Some(branched) = branched.as_ref().filter(|branched| at_ns < branched.at_ns) {
        return Err(refused(branched));
    }
    recorded.require_memory()?;
    let mut tape = Tape::default();
    let closing = recorded.visit(&mut tape)?;
    closing.require_no_holes(file)?;
    let complete = closing.complete;
    let run = recorded.facts().get("run_id").cloned().unwrap_or_default();
    let scenario = recorded.scenario().clone();
    match (Branch::prepare(scenario, Arc::new(tape), complete, at), &branched) {
        (Ok(branch), _) => Ok(Prepared { branch, run, branched, complete }),
        // Its last states are still of the time before the change.
        (Err(BranchError::NotRepeated { .. }), Some(branched)) => Err(refused(branched)),
        (Err(error), _) => Err(error.into()),
    }
}

fn fly_one(replay: &ReplayArguments, at: At) -> Result<(String, u8), Trouble> {
    let arguments = &replay.branch;
    let Prepared { branch, run, branched, complete } = prepare(&replay.file, at)?;
    let change = change(replay);
    let changed = branch.change(&change).map_err(BranchError::from)?;
    // A service that refuses its state fails here, before there is a recording.
    branch.resume(&changed, ())?;
    let options = RunOptions {
        scenario: changed.scenario.clone(),
        speed: Speed::Max,
        record: arguments.record.clone(),
        name: None,
        pin: Pin::None,
        disorder: None,
        progress: io::stderr().is_terminal(),
        live: None,
    };
    let origin = format!("branch of run {run} at {} s{}", seconds(&branch), flags(&change));
    let branched = change
        .changes_steps(branch.scenario())
        .then_some(())
        .filter(|()| !branch.is_whole(&change))
        .map(|()| Branched {
            parent_run: run.clone(),
            at_ns: branch.at_ns(),
            changes: flags(&change).trim_start().to_owned(),
        })
        .or(branched);
    let flown = run_branch(&branch, &changed, &options, &origin, branched)?;
    let FlownBranch { summary, since, same, first } = flown;
    let identical = first.is_none() && same > 0;
    let departs = change.is_none(branch.scenario()) && !identical && !summary.interrupted;
    let code = summary.exit_code();
    let code = if departs && code == exit::PASS { exit::FAILED } else { code };
    let compared_to_s = branch.recorded_ns().min(summary.flown_ns) as f64 / 1e9;
    let text = match replay.format {
        Format::Json => {
            let mut json = summary.to_json();
            json["branch"] = in_json(&branch, &run, same, first.as_ref());
            json["branch"]["complete"] = complete.into();
            json["branch"]["compared_to_s"] = compared_to_s.into();
            json["branch"]["since"] = since.to_json();
            json.to_string()
        }
        Format::Text => {
            let compared = match &first {
                Some(first) => format!("first difference {first}"),
                None if !identical => "nothing could be compared: the file ends there".to_owned(),
                None if complete => format!("identical from there on: {same} samples compared"),
                None => format!(
                    "identical up to {compared_to_s} s, where the file no longer holds everything: \
                     {same} samples compared"
                ),
            };
            let since = report::in_a_line(&since);
            let summary = summary.to_string();
            let (line, rest) = summary.split_once('\n').unwrap_or((&summary, ""));
            format!("{line}\n{origin}: {compared}\nsince the branch: {since}\nin all:\n{rest}")
        }
    };
    Ok((text, code))
}

fn seconds(branch: &Branch) -> f64 {
    branch.at_ns() as f64 / 1e9
}

fn change(replay: &ReplayArguments) -> Change {
    let BranchArguments { swap, seed, duration, .. } = replay.branch.clone();
    Change { set: replay.set.clone(), swap, seed, duration }
}

/// The changes as they were asked for.
fn flags(change: &Change) -> String {
    let set = change.set.iter().map(|setting| format!(" --set {}", quoted(setting)));
    let swap = change.swap.iter().map(|swap| format!(" --swap {}", quoted(swap)));
    let seed = change.seed.map(|seed| format!(" --seed {seed}"));
    let end = change.duration.map(|duration| format!(" --for {}s", duration.as_secs_f64()));
    set.chain(swap).chain(seed).chain(end).collect()
}

fn in_json(branch: &Branch, run: &str, same: u64, first: Option<&Difference>) -> serde_json::Value {
    let first = first.map(|first| {
        serde_json::json!({
            "t_s": first.release_ns as f64 / 1e9,
            "topic": first.topic,
            "field": first.field,
            "old": first.old,
            "new": first.new,
        })
    });
    serde_json::json!({
        "of_run": run,
        "at_s": seconds(branch),
        "identical": first.is_none() && same > 0,
        "same_samples": same,
        "first_difference": first,
    })
}

/// Refuses a sweep of more cases than a campaign may have, and one that sets a key twice.
fn refuse_unflyable(axes: &[Axis], seeds: &[u64]) -> Result<(), Trouble> {
    let counts = axes.iter().map(|axis| axis.values.len()).chain([seeds.len()]);
    if counts.fold(1, usize::saturating_mul) > MAX_CASES {
        let what = format!("the sweep has more than {MAX_CASES} cases");
        return Err(argument(what, "take fewer values, or fewer seeds"));
    }
    let mut others = axes.iter().enumerate();
    let twice = others.find(|(at, axis)| axes[..*at].iter().any(|before| before.key == axis.key));
    let Some((_, Axis { key, .. })) = twice else { return Ok(()) };
    Err(argument(format!("{key} is swept twice"), "write all its values into one --sweep"))
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
    let out = arguments.out.as_deref().unwrap_or(Path::new("branches"));
    let mut folder = ResultsFolder::create(out)?;
    let Prepared { branch, run, .. } = prepare(file, at)?;
    let own = branch.scenario().settings().scenario.seed;
    let one = vec![arguments.seed.unwrap_or(own)];
    let reseed = seeds.is_some() || arguments.seed.is_some();
    let seeds = seeds.unwrap_or(one);
    refuse_unflyable(&axes, &seeds)?;
    let cases = Case::all(&axes, &seeds);
    let sweep = Sweep { branch: &branch, change: &change, axes: &axes, reseed };
    refuse_misspelt(&sweep, &cases)?;
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
            json["line"] = report::line(&format!("branches of run {run}"), &flown).into();
            json["branch"] = serde_json::json!({"of_run": run, "at_s": seconds(&branch)});
            json["files"] = files.into();
            json.to_string()
        }
        Format::Text => format!(
            "{}\n{} branches of run {run} at {} s; figures of the vehicle are of what was flown since then, those of the loops of the whole flight\n{}\n{}\n\
             (the commands print the same figures as `since the branch`)\nwrote {}",
            report::line(&format!("branches of run {run}"), &flown),
            flown.len(),
            seconds(&branch),
            report::figures(&flown),
            report::worst_cases(&axes, &flown, WORST, &command),
            files.join(", "),
        ),
    };
    Ok((text, code))
}

/// What cannot be changed in any branch is an error, not a table full of refusals: the first shows it.
fn refuse_misspelt(sweep: &Sweep<'_>, cases: &[Case]) -> Result<(), Trouble> {
    let Some(Err(error)) = cases.first().map(|case| sweep.branch.change(&sweep.change(case)))
    else {
        return Ok(());
    };
    let ChangeError::Scenario(problems) = &error else {
        // Another end of the flight may be possible.
        let may_fly = matches!(error, ChangeError::Short { .. });
        return if may_fly { Ok(()) } else { Err(BranchError::from(error).into()) };
    };
    let Some(problem) = problems.problems().find(|problem| problem.is_malformed()) else {
        return Ok(());
    };
    let swept = sweep.axes.iter().any(|axis| axis.key == problem.key());
    let flag = if swept { "--sweep " } else { "" };
    Err(argument(format!("{flag}{problem}"), problem.remedy()))
}

/// Worst branches listed.
const WORST: usize = 5;

/// The command line that flies one branch of a sweep alone and records it.
fn command(file: &Path, at: At, sweep: &Sweep<'_>, case: &Case) -> String {
    let file = quoted(&file.display().to_string());
    format!(
        "morphquad replay {file} --branch {at}{} --record recordings",
        flags(&sweep.change(case))
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
