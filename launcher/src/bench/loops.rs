//! `morphquad bench loops`: a realtime flight as it is flown, with its floor beside it.

use super::BenchError;
use super::facts::BenchFacts;
use super::floor::{Floor, FloorData, FloorPlan};
use super::load::Load;
use super::measure::{Chains, FIGURES, SETPOINT_HOLD, Steps, Window, taken, totals};
use super::peer::Seat;
use super::peer::floor::Payload;
use super::place::{Place, Policy};
use super::report::{
    Cost, Counts, FORMAT, FORMAT_VERSION, Figure, FloorReport, LinkReport, LoopReport, LoopsReport,
    MOST_MISSES, PathReport, Terms,
};
use super::series::{Quantiles, Series};
use super::stopwatch::Stopwatch;
use super::usage::MachineTime;
use crate::components::Crew;
use crate::run::{Pin, RunOptions, Speed, Summary, run_measured};
use crate::scenario::{Override, Scenario, ScenarioError, delayed_topics};
use runtime::{Graph, Node};
use shared_types::{LoopStats, Role, Seat as LoopSeat, topics};
use std::collections::BTreeMap;
use std::path::PathBuf;

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
/// [`BenchError`] if nothing was measured; what happens in the air is in the summary.
pub fn measure(plan: &LoopsPlan) -> Result<Measured, BenchError> {
    let scenario = &plan.scenario;
    let graph = plan.graph()?;
    let seat = Seat { fifo: plan.place.fifo(), ..Seat::default() };
    // Whoever is flown by an executable of its own has no step here.
    let alone = super::solve::steps_alone(&plan.alone, seat).unwrap_or_default();
    let _load = plan.load.begin(&plan.place)?;
    let floor_plan = if plan.with_floor { floor_plan(&graph) } else { FloorPlan::default() };
    let floor = plan.with_floor.then(|| Floor::prepare(&floor_plan, &plan.place)).transpose()?;
    let watch =
        floor.as_ref().map_or_else(Stopwatch::default, |floor| Stopwatch::telling(floor.starter()));
    let before = MachineTime::read();
    let options = RunOptions {
        scenario: scenario.clone(),
        speed: Speed::Times(1.0),
        record: plan.record.clone(),
        pin: Pin::None,
        disorder: None,
        progress: plan.progress,
    };
    let (summary, watch) = run_measured(&options, watch)?;
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
    Ok(Measured { report, steps, chains, summary })
}

/// Hash of all settings but how long is flown.
fn scenario_hash(scenario: &Scenario) -> String {
    let mut table: toml::Table = scenario.to_toml().parse().unwrap_or_default();
    if let Some(section) = table.get_mut("scenario").and_then(toml::Value::as_table_mut) {
        section.remove("duration_s");
    }
    blake3::hash(table.to_string().as_bytes()).to_hex().chars().take(16).collect()
}

/// Name of the ping that a role's first input is compared with.
fn ping_of(role: Role) -> Option<(&'static str, Payload)> {
    match role {
        Role::Estimator => Some(("imu", Payload::Imu)),
        Role::Attitude => Some(("estimate to attitude", Payload::StateEstimate)),
        Role::Position => Some(("estimate to position", Payload::StateEstimate)),
        // At the rate of who sends it.
        Role::Plant => Some(("command", Payload::WrenchCommand)),
        _ => None,
    }
}

fn floor_plan(graph: &Graph) -> FloorPlan {
    let mut plan = FloorPlan::default();
    for node in graph.nodes() {
        let hz = node.rate.hz();
        if plan.timers.iter().all(|known| known.to_bits() != hz.to_bits()) {
            plan.timers.push(hz);
        }
        let from = if node.role == Role::Plant { Role::Attitude } else { node.role };
        if let (Some((name, payload)), Some(from)) = (ping_of(node.role), graph.node(from)) {
            plan.pings.push((name, payload, from.rate.hz()));
        }
    }
    plan
}

/// Everything that figures are made of.
struct Sums<'a> {
    plan: &'a LoopsPlan,
    graph: &'a Graph,
    watch: &'a Stopwatch,
    data: &'a FloorData,
    alone: &'a BTreeMap<Role, Series>,
    window: Window,
}

impl Sums<'_> {
    fn loops(&self) -> (Vec<LoopReport>, Vec<(String, Steps)>) {
        let crew = Crew::of(self.plan.scenario.settings());
        let mut upstream = None;
        let (mut reports, mut all) = (Vec::new(), Vec::new());
        for node in self.graph.nodes() {
            for seat in LoopSeat::all(node.role) {
                let key = (node.role, seat.index);
                let steps = |warm| Steps::of(self.watch, key, node.rate, &self.window, warm);
                let (steps, cold) = (steps(true), steps(false));
                if steps.ran == 0 {
                    continue;
                }
                let mut seen = self.watch.looks.iter().flat_map(|look| &look.seen);
                let seen = seen.find(|s| (s.role, s.seat) == key).map(|s| s.name.as_str());
                let usual = crew.name(node.role).unwrap_or(node.role.label());
                let mut name = seen.unwrap_or(usual).to_owned();
                if seat.index > 0 {
                    name = format!("{name}@{}", seat.index);
                }
                if node.role == Role::Estimator {
                    upstream = steps.compute.quantiles();
                }
                reports.push(self.report(node, seat.index, &name, (&steps, &cold), upstream));
                all.push((name, steps));
            }
        }
        (reports, all)
    }

    fn report(
        &self,
        node: &Node,
        seat: u32,
        name: &str,
        (steps, cold): (&Steps, &Steps),
        upstream: Option<Quantiles>,
    ) -> LoopReport {
        let figures = FIGURES.into_iter().filter_map(|figure| {
            let flown = steps.figure(figure)?.quantiles()?;
            let floor = self.floor_of(node, figure, upstream);
            let warm_up = cold.figure(figure).and_then(Series::quantiles);
            Some((figure.to_owned(), Figure::new(flown, floor, warm_up)))
        });
        let totals = totals(self.watch, node.role, seat, &self.window).unwrap_or_default();
        let counts = Counts {
            steps: steps.ran,
            deadline_misses: totals.input_deadline_misses,
            overruns: steps.overruns,
            skipped: totals.skipped,
            caught_up: totals.caught_up,
            late_samples: totals.late_samples,
            rescued_waits: totals.rescued_waits,
        };
        LoopReport {
            name: name.to_owned(),
            role: node.role.label().to_owned(),
            seat,
            timed: ping_of(node.role).is_none() || node.role == Role::Plant,
            rate_hz: node.rate.hz(),
            achieved_hz: steps.rate_hz(),
            holds: counts.miss_share() <= MOST_MISSES,
            warm_up_steps: cold.ran,
            figures: figures.collect(),
            counts,
            cost: self.cost(node.role, seat, &totals),
        }
    }

    fn floor_of(
        &self,
        node: &Node,
        figure: &str,
        upstream: Option<Quantiles>,
    ) -> Option<Quantiles> {
        let (hz, within) = (node.rate.hz(), self.window.mono_ns());
        match figure {
            "lateness" => self.data.lateness(hz, within).quantiles(),
            "period" => self.data.period_deviation(hz, within).quantiles(),
            "hop" => self.ping(node.role),
            "age" if node.role == Role::Estimator => self.ping(node.role),
            "age" => {
                let parts = [self.ping(Role::Estimator)?, upstream?, self.ping(node.role)?];
                Quantiles::sum(&parts)
            }
            "compute" => self.alone.get(&node.role).and_then(Series::quantiles),
            _ => None,
        }
    }

    fn ping(&self, role: Role) -> Option<Quantiles> {
        self.data.hops(ping_of(role)?.0, self.window.mono_ns()).quantiles()
    }

    fn cost(&self, role: Role, seat: u32, totals: &LoopStats) -> Option<Cost> {
        let taken = taken(&self.watch.looks, role, seat, &self.window);
        if taken.settled_ns == 0 {
            return None;
        }
        let (settled, moved) = (taken.settled, taken.moved);
        let per_s = |count: u64| count as f64 / (taken.settled_ns as f64 * 1e-9);
        Some(Cost {
            cpu_percent: 100.0 * settled.cpu_ns as f64 / taken.settled_ns as f64,
            rss_mb: settled.rss_bytes as f64 / f64::from(1 << 20),
            minor_faults: settled.minor_faults,
            major_faults: settled.major_faults,
            allocations: totals.allocations,
            transport_allocations: totals.transport_allocations,
            faults_while_joining: moved.minor_faults + moved.major_faults,
            allocations_while_joining: totals.allocations_at_changes,
            voluntary_switches_per_s: per_s(settled.voluntary_switches),
            involuntary_switches_per_s: per_s(settled.involuntary_switches),
        })
    }

    fn paths(&self, steps: &[(String, Steps)]) -> (Vec<PathReport>, Vec<(String, Chains)>) {
        let crew = Crew::of(self.plan.scenario.settings());
        let name = |role: Role| crew.name(role).unwrap_or(role.label());
        let compute = |role: Role| -> Option<Quantiles> {
            let found = steps.iter().find(|(known, _)| known == name(role));
            found.and_then(|(_, steps)| steps.compute.quantiles())
        };
        let hop = |role: Role| {
            let name = ping_of(role).map_or("", |(name, _)| name);
            (format!("ping {name}"), self.ping(role))
        };
        let solve = |role: Role| (format!("{} step", name(role)), compute(role));
        let (of_attitude, of_position) = (
            Chains::of_attitude(self.watch, &self.window),
            Chains::of_position(self.watch, &self.window),
        );
        // Logical time, which no machine makes shorter.
        let held = of_position.names().iter().position(|link| *link == SETPOINT_HOLD);
        let held = held.and_then(|index| of_position.link(index).quantiles());
        let (attitude, position) = (
            vec![
                hop(Role::Estimator),
                solve(Role::Estimator),
                hop(Role::Attitude),
                solve(Role::Attitude),
                hop(Role::Plant),
            ],
            vec![
                hop(Role::Estimator),
                solve(Role::Estimator),
                hop(Role::Position),
                solve(Role::Position),
                (SETPOINT_HOLD.to_owned(), held),
                solve(Role::Attitude),
                hop(Role::Plant),
            ],
        );
        let ways = [
            (name(Role::Attitude), of_attitude, attitude),
            (name(Role::Position), of_position, position),
        ];
        let (mut reports, mut all) = (Vec::new(), Vec::new());
        for (through, chains, parts) in ways {
            let name = format!("imu > estimator > {through} > gate");
            if let Some(report) = self.path(&name, &chains, parts) {
                reports.push(report);
                all.push((name, chains));
            }
        }
        (reports, all)
    }

    fn path(
        &self,
        name: &str,
        chains: &Chains,
        parts: Vec<(String, Option<Quantiles>)>,
    ) -> Option<PathReport> {
        let links = chains.names().into_iter().enumerate().filter_map(|(index, name)| {
            let took = chains.link(index).quantiles()?;
            Some(LinkReport { name: name.to_owned(), took })
        });
        let complete = parts.iter().all(|(_, took)| took.is_some());
        let floor = Quantiles::sum(parts.iter().filter_map(|(_, took)| took.as_ref()));
        let parts =
            parts.into_iter().filter_map(|(name, took)| Some(LinkReport { name, took: took? }));
        Some(PathReport {
            name: name.to_owned(),
            total: Figure::new(
                chains.from_publication().quantiles()?,
                floor.filter(|_| complete),
                None,
            ),
            until_effect: Figure::new(
                chains.until_effect().quantiles()?,
                floor.filter(|_| complete),
                None,
            ),
            from_release: chains.from_release().quantiles()?,
            links: links.collect(),
            floor_parts: parts.collect(),
            hold_us: if self.graph.is_asap(&topics::WRENCH_COMMAND.info) {
                0.0
            } else {
                self.plan.scenario.settings().latency.wrench_command_s * 1e6
            },
            untraced: chains.untraced,
            unseen: chains.unseen,
            warm_up: chains.cold,
        })
    }

    fn floor(&self, plan: &FloorPlan, steal_percent: f64) -> FloorReport {
        let within = self.window.mono_ns();
        let timer = |hz: &f64| Some((*hz, self.data.lateness(*hz, within).quantiles()?));
        let ping = |(name, ..): &(&'static str, Payload, f64)| {
            Some(((*name).to_owned(), self.data.hops(name, within).quantiles()?))
        };
        FloorReport {
            timers: plan.timers.iter().filter_map(timer).collect(),
            pings: plan.pings.iter().filter_map(ping).collect(),
            steal_percent,
        }
    }
}
