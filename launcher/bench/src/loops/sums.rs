//! Figures of a measured flight, each with its floor beside it.

use super::LoopsPlan;
use crate::floor::{FloorData, FloorPlan};
use crate::measure::{Chains, FIGURES, SETPOINT_HOLD, Steps, Window, taken, totals};
use crate::peer::floor::Payload;
use crate::report::{
    Cost, Counts, Figure, FloorReport, LinkReport, LoopReport, MAX_MISS_SHARE, PathReport,
};
use crate::series::{Quantiles, Series};
use observe::stopwatch::Stopwatch;
use runtime::{Graph, Node};
use scenario::services::Assignment;
use shared_types::{LoopStats, Role, Seat as LoopSeat, topics};
use std::collections::BTreeMap;

/// Name of the ping that a role's first input is compared with.
fn ping_of(role: Role) -> Option<(&'static str, Payload)> {
    match role {
        Role::Estimator => Some(("imu", Payload::Imu)),
        Role::Attitude => Some(("estimate to attitude", Payload::StateEstimate)),
        Role::Position => Some(("estimate to position", Payload::StateEstimate)),
        // At the rate of the loop that sends it.
        Role::Plant => Some(("command", Payload::WrenchCommand)),
        _ => None,
    }
}

/// What to measure of the machine alone, beside these loops.
pub(super) fn floor_plan(graph: &Graph) -> FloorPlan {
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
pub(super) struct Sums<'a> {
    pub(super) plan: &'a LoopsPlan,
    pub(super) graph: &'a Graph,
    pub(super) watch: &'a Stopwatch,
    pub(super) data: &'a FloorData,
    pub(super) alone: &'a BTreeMap<Role, Series>,
    pub(super) window: Window,
}

impl Sums<'_> {
    pub(super) fn loops(&self) -> (Vec<LoopReport>, Vec<(String, Steps)>) {
        let assignment = Assignment::of(self.plan.scenario.settings());
        let mut upstream = None;
        let (mut reports, mut all) = (Vec::new(), Vec::new());
        // Steps are known by the stamps of what they publish; the monitor is silent while all is well.
        for node in self.graph.nodes().iter().filter(|node| node.role != Role::Monitor) {
            let seats = LoopSeat::all(node.role).map(|seat| {
                let key = (node.role, seat.index);
                let of = |warm| Steps::of(self.watch, key, node.rate, &self.window, warm);
                (key, of(true), of(false))
            });
            let mut seats: Vec<_> = seats.collect();
            // A loop that no process ran still belongs to the flight: it is reported, without figures.
            let none_stepped = seats.iter().all(|(_, steps, _)| steps.ran == 0);
            seats.retain(|((_, seat), steps, _)| steps.ran > 0 || (none_stepped && *seat == 0));
            let alone = seats.len() == 1;
            for (key, steps, cold) in seats {
                let mut seen = self.watch.looks.iter().flat_map(|look| &look.seen);
                let seen = seen.find(|s| (s.role, s.seat) == key).map(|s| s.name.as_str());
                let usual = assignment.name(node.role);
                let mut name = seen.unwrap_or(usual).to_owned();
                if key.1 > 0 {
                    name = format!("{name}@{}", key.1);
                }
                if node.role == Role::Estimator {
                    upstream = steps.compute.quantiles();
                }
                let due = steps.due(node.rate, &self.window, alone);
                reports.push(self.report(node, key.1, &name, (&steps, &cold, due), upstream));
                all.push((name, steps));
            }
        }
        all.retain(|(_, steps): &(String, Steps)| steps.ran > 0);
        (reports, all)
    }

    fn report(
        &self,
        node: &Node,
        seat: u32,
        name: &str,
        (steps, cold, due): (&Steps, &Steps, u64),
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
            // A process that was started again counts from nothing, and one that is gone not at all.
            skipped: totals.skipped.max(due.saturating_sub(steps.ran)),
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
            achieved_hz: (due > 0).then(|| node.rate.hz() * (steps.ran as f64 / due as f64)),
            holds: counts.miss_share() <= MAX_MISS_SHARE,
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

    pub(super) fn cost(&self, role: Role, seat: u32, totals: &LoopStats) -> Option<Cost> {
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

    pub(super) fn paths(
        &self,
        steps: &[(String, Steps)],
    ) -> (Vec<PathReport>, Vec<(String, Chains)>) {
        let assignment = Assignment::of(self.plan.scenario.settings());
        let name = |role: Role| assignment.name(role);
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

    pub(super) fn floor(&self, plan: &FloorPlan, steal_percent: f64) -> FloorReport {
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
