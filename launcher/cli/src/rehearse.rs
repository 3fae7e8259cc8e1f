//! `morphquad rehearse`: whether a controller may take a slot over, before it does.

use super::options::{Format, RehearseArguments};
use super::refusal::{Done, Failure};
use core::fmt::Write as _;
use host::exit;
use rehearsal::Measure;
use runtime::clock::mono_now_ns;
use rustix::process::{Resource, Rlimit, Signal, nice, set_parent_process_death_signal, setrlimit};
use scenario::candidate::Candidate;
use scenario::{Override, Scenario};
use shared_types::time::ns_from_s;
use shared_types::{PerSlot, Slot};
use simulate::rehearse::{Rehearsal, RehearsalFigures, Role, Verdict, verdict, watch};
use std::io::{Read as _, Write};
use std::path::{Path, PathBuf};
use swap::RehearsalSpec;

/// Runs the command.
pub(super) fn run(arguments: &RehearseArguments, out: &mut dyn Write) -> Done {
    if let Some(file) = &arguments.spec {
        return serve(file, arguments.nice, out);
    }
    let scenario = scenario(arguments)?;
    let spec = spec(arguments, &scenario)?;
    if let Some(draw) = arguments.scenario_of {
        let rehearsal = Rehearsal::prepare(spec).map_err(|r| Failure::plain(&r, exit::UNFIT))?;
        let derived = rehearsal.scenario(draw.into(), Role::Candidate);
        let derived = derived.map_err(|refusal| Failure::plain(&refusal, exit::UNFIT))?;
        write!(out, "{}", derived.to_toml())?;
        return Ok(exit::PASS);
    }
    let outcome = verdict(spec, &mut until(scenario.settings().rehearsal.wall_max_s));
    let text = match arguments.format {
        Format::Json => line(&outcome)?,
        Format::Text => {
            let grade = if outcome.accepted { "ACCEPTED" } else { "REFUSED" };
            let figures = outcome.measured().map(table).unwrap_or_default();
            format!("{grade}  {}\n{figures}", outcome.message)
        }
    };
    answer(&text, &outcome, out)
}

/// Writes a verdict; its code is its own, whether or not the text is read.
fn answer(text: &str, outcome: &Verdict, out: &mut dyn Write) -> Done {
    let code = if outcome.accepted { exit::PASS } else { exit::FAILED };
    crate::finished(out.write_all(text.as_bytes()).and_then(|()| out.flush()), code)
}

/// False once so much wall time is over.
fn until(wall_max_s: f64) -> impl FnMut() -> bool {
    let end_ns = mono_now_ns().saturating_add(ns_from_s(wall_max_s));
    move || mono_now_ns() < end_ns
}

/// As a launcher has it done: in a process of its own, which adds `by` to its nice value.
fn serve(file: &Path, by: i32, out: &mut dyn Write) -> Done {
    // Without permission for either the rehearsal is as good, and its end is its own.
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
    let _ = nice(by);
    let text = if file == Path::new("-") {
        let mut text = String::new();
        std::io::stdin().read_to_string(&mut text).map(|_| text)
    } else {
        std::fs::read_to_string(file)
    };
    let unusable = |error: &dyn core::fmt::Display| {
        let reason =
            format!("{}: {error}: write what `rehearse` is to fly as JSON", file.display());
        Failure::plain(&reason, exit::USAGE)
    };
    let text = text.map_err(|error| unusable(&error))?;
    let spec: RehearsalSpec = serde_json::from_str(&text).map_err(|error| unusable(&error))?;
    let scenario = Scenario::from_text("the flight's scenario", &spec.scenario, &[]);
    let wall_max_s = scenario.map_or(0.0, |s| s.settings().rehearsal.wall_max_s);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
    let cpu_s = wall_max_s.ceil() as u64 + 1;
    let _ = setrlimit(Resource::Cpu, Rlimit { current: Some(cpu_s), maximum: Some(cpu_s + 1) });
    let outcome = verdict(spec, &mut until(wall_max_s));
    answer(&line(&outcome)?, &outcome, out)
}

fn line(outcome: &Verdict) -> Result<String, Failure> {
    let json = serde_json::to_string(outcome);
    json.map(|json| json + "\n").map_err(|error| Failure::plain(&error, exit::UNFIT))
}

fn scenario(arguments: &RehearseArguments) -> Result<Scenario, Failure> {
    let set = arguments.set.iter().map(|argument| Override::set(argument));
    let controller = arguments.controller.iter().map(|argument| Override::controller(argument));
    let edits: Result<Vec<Override>, _> = set.chain(controller).collect();
    let loaded = edits.and_then(|mut edits| {
        edits.extend(arguments.seed.map(Override::seed));
        edits.push(Override::clock("lockstep"));
        Scenario::load(arguments.scenario.as_deref().unwrap_or_default(), &edits)
    });
    loaded.map_err(|error| Failure::report(error, exit::USAGE))
}

/// Flies to the instant of the swap and names the controller that is to take over there.
fn spec(arguments: &RehearseArguments, scenario: &Scenario) -> Result<RehearsalSpec, Failure> {
    let swap = arguments.swap.as_deref().unwrap_or_default();
    let usage = |reason: String| Failure::plain(&reason, exit::USAGE);
    let form = "write --swap SLOT=NAME, for example --swap attitude=attitude-lqr";
    let (head, config) = match swap.split_once(",config=") {
        Some((head, config)) => (head, Some(PathBuf::from(config))),
        None => (swap, None),
    };
    let parts = head.split_once('=').and_then(|(slot, name)| Some((Slot::named(slot)?, name)));
    let (slot, name) = parts.ok_or_else(|| usage(format!("--swap {swap}: {form}")))?;
    let found = Candidate::find(slot, name);
    let candidate = found.map_err(|none| usage(format!("{}: {}", none.what, none.remedy)))?;
    let candidate = match candidate {
        Candidate::Service(name) => name.to_owned(),
        Candidate::Executable(path) => path.display().to_string(),
    };
    let at_ns = u64::try_from(arguments.at.as_nanos()).unwrap_or(u64::MAX);
    if at_ns >= scenario.duration_ns() {
        let end_s = scenario.settings().scenario.duration_s;
        return Err(usage(format!("--at: the flight ends at {end_s} s: name an instant before")));
    }
    if let Some(s) = other_owner_s(scenario).filter(|s| ns_from_s(*s) < at_ns) {
        let what = format!("the scenario's script may give a slot to another controller at {s} s");
        return Err(usage(format!(
            "--at: {what}: name an instant before, or a scenario without it, and with --controller who flies"
        )));
    }
    let snapshot = watch::snapshot_of(scenario, at_ns);
    let snapshot = snapshot.map_err(|error| Failure::plain(&error, exit::UNFIT))?;
    let snapshot = snapshot.ok_or_else(|| {
        usage(
            "--at: the vehicle knows nothing yet: name a later instant, for example 1s".to_owned(),
        )
    })?;
    Ok(RehearsalSpec {
        scenario: scenario.to_toml().to_owned(),
        snapshot,
        slot,
        owners: PerSlot::default(),
        owner: None,
        candidate,
        config,
        seed: scenario.settings().scenario.seed,
        swap: arguments.number,
    })
}

/// When a script first swaps, or kills or stops a process, after which another controller may command \[s\].
fn other_owner_s(scenario: &Scenario) -> Option<f64> {
    let settings = scenario.settings();
    let swaps = settings.swap.iter().map(|swap| swap.at_s);
    swaps.chain(settings.fault.iter().map(|fault| fault.at_s)).min_by(f64::total_cmp)
}

/// A row for each challenge: candidate and limit of each measure.
fn table(figures: &RehearsalFigures) -> String {
    let mut text = String::new();
    let mut last = None;
    for figure in &figures.figures {
        let at = (figure.draw, figure.at_s.to_bits());
        if last != Some(at) {
            let flight = if figure.draw == 0 { "mean" } else { "draw" };
            let (draw, what) = (figure.draw, figure.challenge.description());
            let _ =
                writeln!(text, "  {flight} {draw}, {:.2} s after the flip: {what}", figure.at_s);
            last = Some(at);
        }
        let mark = if figure.is_within() { ' ' } else { '!' };
        let [is, may, owner] =
            [figure.candidate, figure.limit, figure.owner].map(|value| figure.measure.shown(value));
        let name = Measure::description(figure.measure);
        let _ = writeln!(text, "  {mark} {name:<42}{is:>14} of {may:>14}   owner {owner:>14}");
    }
    text
}
