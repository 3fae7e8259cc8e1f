//! Flights in one thread, without processes or shared memory: `run --in-process`, and what goes on from a
//! recorded one.

use super::RunOptions;
use super::setup::Speed;
use super::setup::{
    RunError, Unflown, clock_of, facts, pinned_cpu, progress_bar, require_processor, run_id, system,
};
use super::sinks::Sinks;
use super::summary::Summary;
use crate::in_process::{
    Conclusion, InProcess, InProcessError, Outside, StateSource, joins_executable,
};
use crate::setup::Pin;
use host::stay_on;
use observe::{FlightHash, Metrics, Observer};
use record::{self, Facts, Recorder};
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::watch::StopFlags;
use shared_types::{ClockMode, Role};
use std::path::{Path, PathBuf};

/// Logical time, and at most as much wall time, between two looks around \[ns\].
const LOOK_EVERY_NS: u64 = 20_000_000;

/// Flies a scenario in the calling thread and returns what came of it: the same summary, hash and
/// recording as with processes.
///
/// # Errors
/// [`RunError`] if the flight never started; what happens in flight is in the summary.
pub fn run_in_process(options: &RunOptions) -> Result<Summary, RunError> {
    let scenario = &options.scenario;
    if clock_of(scenario) == ClockMode::Realtime {
        return Err(RunError::RealtimeInProcess);
    }
    require_processor(options.pin)?;
    let mut outside = Outside::of(scenario.settings());
    if joins_executable(scenario.settings()) {
        // To wake a process on the same processor is the cheapest.
        outside.cpu = pinned_cpu(options.pin, ClockMode::Lockstep);
    } else if let Pin::Cpu(cpu) = options.pin {
        outside.cpu = Some(cpu);
    }
    outside.cpu.into_iter().for_each(stay_on);
    let begin = |sinks| {
        let state = StateSource::Estimator;
        InProcess::with_processes(scenario, state, (sinks, ()), &outside).map_err(not_ready)
    };
    Ok(fly_alone(options, None, 0, begin)?.summary)
}

/// Why a flight in one process cannot begin.
fn not_ready(error: InProcessError) -> RunError {
    match error {
        InProcessError::NoSlot { .. } => RunError::ScriptInProcess(error),
        error => RunError::NotReady(error.to_string()),
    }
}

/// A flight in the calling thread that is over.
#[derive(Debug)]
pub struct FlownAlone<O> {
    /// What came of it.
    pub summary: Summary,
    /// What has seen it beside the recording.
    pub observer: O,
    /// Hash of it.
    pub hash: FlightHash,
    /// Why it ended early, if a component failed.
    pub error: Option<InProcessError>,
}

/// Flies what `begin` makes of the sinks of a flight, from `from_ns` to its end, in the calling thread.
/// `branched` records from where on its scenario holds.
///
/// # Errors
/// [`RunError`] if the flight never started; what happens in flight is in the summary.
pub fn fly_alone<O: Observer + Default>(
    options: &RunOptions,
    branched: Option<record::Branched>,
    from_ns: u64,
    begin: impl FnOnce(Sinks) -> Result<InProcess<(Sinks, O)>, RunError>,
) -> Result<FlownAlone<O>, RunError> {
    let stop = StopFlags::watch_signals().map_err(system("watch signals"))?;
    let id = run_id();
    let path = options.recording_path(&id)?;
    let facts = Facts { branch: branched, ..facts(&id, options) };
    let sinks = sinks(&facts, path.as_deref(), options)?;
    let unflown = Unflown::of(path.as_deref());
    let mut flight = begin(sinks)?;
    unflown.begins();
    flight.stamp_by(mono_now_ns);
    let start_ns = mono_now_ns();
    let end = fly(&mut flight, options, &stop, from_ns);
    let wall_ns = mono_now_ns().saturating_sub(start_ns);
    let flown_ns = flight.flown_ns();
    let conclusion = conclude(&mut flight);
    let (sinks, observer) = flight.seen(core::mem::take);
    let hash = sinks.hash.clone();
    let (end, error) = match end {
        Ok(end) => (Ok(end), None),
        Err(error) => (Err(error.to_string()), Some(error)),
    };
    let ended = Ended { id, path, wall_ns, from_ns, flown_ns, end, conclusion };
    let summary = sum_up(sinks, options, ended)?;
    Ok(FlownAlone { summary, observer, hash, error })
}

/// Everything that takes the samples of a flight, with a recording at `path`.
fn sinks(facts: &Facts, path: Option<&Path>, options: &RunOptions) -> Result<Sinks, RunError> {
    let graph = options.scenario.graph().map_err(|error| RunError::Wiring(error.to_string()))?;
    let roles: Vec<Role> = graph.nodes().iter().map(|n| n.role).collect();
    let recording = path.map(|path| Recorder::create(path, facts)).transpose()?;
    Ok(Sinks::new(&roles, Metrics::of(&options.scenario), recording))
}

/// A flight that is over.
#[derive(Debug)]
pub struct Ended {
    /// Of the run.
    pub id: String,
    /// The recording.
    pub path: Option<PathBuf>,
    /// Host time that it took \[ns\].
    pub wall_ns: u64,
    /// Where it began \[ns\].
    pub from_ns: u64,
    /// Logical time through which every loop is complete \[ns\].
    pub flown_ns: u64,
    /// How it ended; the reason of a crash.
    pub end: Result<End, String>,
    /// What came of its slots.
    pub conclusion: Conclusion,
}

/// What came of the slots, reported as a flight of processes reports it.
fn conclude<O: Observer>(flight: &mut InProcess<O>) -> Conclusion {
    let conclusion = flight.conclude();
    for notice in &conclusion.notices {
        eprintln!("morphquad: {notice}");
    }
    conclusion
}

/// Sums up a flight that is over, and closes its recording.
///
/// # Errors
/// [`RunError`] if the scenario cannot be wired.
pub fn sum_up(mut sinks: Sinks, options: &RunOptions, ended: Ended) -> Result<Summary, RunError> {
    let scenario = &options.scenario;
    let graph = scenario.graph().map_err(|error| RunError::Wiring(error.to_string()))?;
    let Ended { id, path, wall_ns, from_ns, flown_ns, end, conclusion } = ended;
    sinks.metrics.finish();
    let mut summary = Summary {
        run_id: id,
        scenario: scenario.settings().scenario.name.clone(),
        clock: ClockMode::Lockstep,
        seed: scenario.settings().scenario.seed,
        from_ns,
        flown_ns,
        planned_ns: scenario.duration_ns(),
        wall_ns,
        processes: graph.nodes().iter().map(|n| (n.role, n.rate.hz())).collect(),
        hash: sinks.hash.hex(),
        log_hash: sinks.log_hash.hex(),
        metrics: core::mem::take(&mut sinks.metrics),
        audit: sinks.audit.clone(),
        recovered: conclusion.recovered,
        swaps: conclusion.swaps,
        orders: conclusion.orders,
        notices: conclusion.notices,
        lost: end.as_ref().err().cloned(),
        interrupted: end.as_ref().is_ok_and(|end| *end == End::Interrupted),
        cut_short: flown_ns < scenario.duration_ns(),
        recording: path,
        recording_error: sinks.recording_error.take(),
    };
    sinks.finish(&mut summary);
    Ok(summary)
}

/// How a flight ended that no defect ended.
#[derive(Debug, PartialEq)]
pub enum End {
    /// As planned.
    Flown,
    /// By the user.
    Interrupted,
}

/// Flies from `from_ns` to the end, or to the present instant of every loop once the user asks.
fn fly<O: Observer>(
    flight: &mut InProcess<(Sinks, O)>,
    options: &RunOptions,
    stop: &StopFlags,
    from_ns: u64,
) -> Result<End, InProcessError> {
    let duration_ns = options.scenario.duration_ns();
    let bar = options.progress.then(|| progress_bar(duration_ns));
    let start_ns = mono_now_ns();
    let mut end = Ok(End::Flown);
    let mut t_ns = from_ns;
    while t_ns < duration_ns && end.is_ok() {
        if stop.signalled() {
            eprintln!("morphquad: interrupted: stopping in order");
            end = Ok(End::Interrupted);
            break;
        }
        t_ns = next_look(options.speed, t_ns, start_ns).min(duration_ns);
        end = flight.fly_until(t_ns).map(|()| End::Flown);
        flight.seen(|(sinks, _)| sinks.flush_if_due(mono_now_ns()));
        if let Some(bar) = &bar {
            bar.set_position(t_ns / 1_000_000);
        }
    }
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    if end.is_ok() {
        flight.finish();
    }
    end
}

/// Logical time to fly to next; a paced flight waits here until it may \[ns\].
fn next_look(speed: Speed, t_ns: u64, start_ns: u64) -> u64 {
    let Speed::Times(times) = speed else { return t_ns + LOOK_EVERY_NS };
    let due = |t_ns: u64| start_ns.saturating_add(scaled(t_ns, 1.0 / times));
    let next_ns = t_ns + scaled(LOOK_EVERY_NS, times).clamp(1, LOOK_EVERY_NS);
    sleep_until(due(next_ns));
    next_ns
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive; saturates")]
fn scaled(ns: u64, factor: f64) -> u64 {
    (ns as f64 * factor) as u64
}
