//! `morphquad bench loops`: a realtime flight as it is flown, with its floor beside it.

mod sums;

use super::BenchError;
use super::facts::BenchFacts;
use super::floor::{Floor, FloorPlan};
use super::measure::{Chains, Steps, Window};
use super::peer::load::Load;
use super::peer::{Peer, Seat};
use super::place::{Place, Policy};
use super::report::{FORMAT, FORMAT_VERSION, LoopsReport, Terms};
use document::ScenarioError;
use flight::run_measured;
use observe::stopwatch::Stopwatch;
use observe::usage::MachineTime;
use runtime::Graph;
use scenario::{Override, Scenario, delayed_topics};
use shared_types::{LoopStats, Role};
use simulate::{Pin, RunOptions, Speed, Summary};
use std::path::PathBuf;
use sums::{Sums, floor_plan};

/// Longest flight whose steps are measured alone \[s\].
const ALONE_S: f64 = 5.0;

/// What to fly and how to measure.
#[derive(Debug)]
pub struct LoopsPlan {
    /// In realtime.
    pub scenario: Scenario,
    /// The same in lockstep, for steps alone.
    pub alone: Scenario,
    /// Policy and processors.
    pub place: Place,
    /// What else the machine does meanwhile.
    pub load: Load,
    /// At the beginning of the flight, apart \[ns\].
    pub warm_up_ns: u64,
    /// Folder for a recording.
    pub record: Option<PathBuf>,
    /// Whether to measure the machine alone in the same run.
    pub with_floor: bool,
    /// Whether to show progress.
    pub progress: bool,
}

/// What came of it.
#[derive(Debug)]
pub struct Measured {
    /// In figures.
    pub report: LoopsReport,
    /// Each loop's steps, by name, for pictures.
    pub steps: Vec<(String, Steps)>,
    /// Each path's chains, by name.
    pub chains: Vec<(String, Chains)>,
    /// How the flight went.
    pub summary: Summary,
    /// Host instant of logical time 0 \[ns\].
    pub start_mono_ns: u64,
}

/// Edits that fly a scenario in realtime, scheduled as the place has it; with asap edges everywhere, if
/// that is asked for.
///
/// # Errors
/// None that a place could cause.
pub fn edits(place: &Place, asap: bool) -> Result<Vec<Override>, ScenarioError> {
    let mut edits = vec![Override::set(&format!("realtime.policy={}", place.policy.label()))?];
    if place.policy == Policy::Fifo {
        edits.push(Override::set(&format!("realtime.priority={}", place.priority))?);
    }
    if asap {
        let names: Vec<_> = delayed_topics().map(|name| format!("{name:?}")).collect();
        edits.push(Override::set(&format!("realtime.asap=[{}]", names.join(",")))?);
    }
    edits.extend([Override::clock("realtime"), Override::speed("1")]);
    Ok(edits)
}

/// Edits for the steps alone: no longer than it needs, and without a script for processes.
///
/// # Errors
/// None.
pub fn edits_alone(duration_s: f64) -> Result<Vec<Override>, ScenarioError> {
    Ok(vec![
        Override::clock("lockstep"),
        Override::set(&format!("scenario.duration_s={:?}", duration_s.min(ALONE_S)))?,
    ])
}

impl LoopsPlan {
    /// Loops and arrows.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn graph(&self) -> Result<Graph, BenchError> {
        self.scenario.graph().map_err(|error| BenchError::Wiring(error.to_string()))
    }

    /// What must be the same for its result to be compared with another.
    #[must_use]
    pub fn terms(&self, graph: &Graph) -> Terms {
        let rates = graph.nodes().iter().map(|n| (n.role.label().to_owned(), n.rate.hz()));
        Terms {
            facts: BenchFacts::read(),
            scenario: self.scenario.settings().scenario.name.clone(),
            scenario_hash: scenario_hash(&self.scenario),
            rates_hz: rates.collect(),
            place: self.place.clone(),
            load: self.load.label().to_owned(),
        }
    }
}

/// Flies and measures.
///
/// # Errors
/// [`BenchError`] if nothing was measured; what happens in flight is in the summary.
pub fn measure(plan: &LoopsPlan) -> Result<Measured, BenchError> {
    let scenario = &plan.scenario;
    let graph = plan.graph()?;
    let seat = Seat { fifo: plan.place.fifo(), ..Seat::default() };
    // A service that is flown by an executable of its own has no step here.
    let alone = super::alone::steps_alone(&plan.alone, seat).unwrap_or_default();
    let mut load = plan.load.begin(&plan.place)?;
    let floor_plan = if plan.with_floor { floor_plan(&graph) } else { FloorPlan::default() };
    let floor = plan.with_floor.then(|| Floor::prepare(&floor_plan, &plan.place)).transpose()?;
    let watch = floor
        .as_ref()
        .map_or_else(Stopwatch::default, |floor| Stopwatch::notifying(floor.starter()));
    let before = MachineTime::read();
    let options = RunOptions {
        scenario: scenario.clone(),
        speed: Speed::Times(1.0),
        record: plan.record.clone(),
        name: None,
        pin: Pin::None,
        disorder: None,
        progress: plan.progress,
        live: None,
    };
    let (summary, watch) = run_measured(&options, watch)?;
    // A load that has ended by itself, on a full disk for one, was none.
    load.iter_mut().try_for_each(Peer::stop::<()>)?;
    let steal_percent = MachineTime::read().stolen_percent_since(&before);
    let data = floor.map(Floor::finish).transpose()?.unwrap_or_default();
    let window = Window {
        warm_ns: plan.warm_up_ns,
        start_mono_ns: watch.start_mono_ns,
        end_ns: summary.flown_ns,
    };
    let sums = Sums { plan, graph: &graph, watch: &watch, data: &data, alone: &alone, window };
    let (loops, steps) = sums.loops();
    let (paths, chains) = sums.paths(&steps);
    let report = LoopsReport {
        format: FORMAT.to_owned(),
        format_version: FORMAT_VERSION,
        terms: plan.terms(&graph),
        duration_s: summary.flown_ns as f64 / 1e9,
        warm_up_s: plan.warm_up_ns as f64 / 1e9,
        loops,
        launcher: sums.cost(Role::Supervisor, 0, &LoopStats::default()),
        paths,
        floor: sums.floor(&floor_plan, steal_percent),
        notices: summary.notices.clone(),
    };
    Ok(Measured { report, steps, chains, summary, start_mono_ns: watch.start_mono_ns })
}

/// Hash of all settings but how long is flown.
fn scenario_hash(scenario: &Scenario) -> String {
    let mut table: toml::Table = scenario.to_toml().parse().unwrap_or_default();
    if let Some(section) = table.get_mut("scenario").and_then(toml::Value::as_table_mut) {
        section.remove("duration_s");
    }
    blake3::hash(table.to_string().as_bytes()).to_hex().chars().take(16).collect()
}
