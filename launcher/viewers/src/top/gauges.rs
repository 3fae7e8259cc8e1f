//! How loops do, by what they publish: stamps of the last second, totals of the flight.

use protocol::topic::header;
use runtime::seat_of_loop;
use serde::Serialize;
use shared_types::wire::Value as _;
use shared_types::{Header, LoopStats, Role, TopicInfo, topics};
use std::collections::{BTreeMap, VecDeque};

/// How far back samples are looked at, in logical time \[ns\].
const WINDOW_NS: u64 = 1_000_000_000;
/// Inertial samples whose instants are remembered.
const REMEMBERED: usize = 4096;

/// A topic that each loop publishes at every step.
const PULSES: [&TopicInfo; 6] = [
    &topics::IMU.info,
    &topics::STATE_ESTIMATE.info,
    &topics::ATTITUDE_SETPOINT.info,
    &topics::WRENCH_COMMAND.info,
    &topics::DISTURBANCE.info,
    &topics::MORPH_COMMAND.info,
];

/// Topics to listen to.
#[must_use]
pub fn wanted() -> Vec<&'static TopicInfo> {
    PULSES.into_iter().chain([&topics::LOOP_STATS.info]).collect()
}

/// Middle and end of a distribution \[us\].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Half are below.
    pub median_us: f64,
    /// All are below.
    pub max_us: f64,
}

/// What is measured of one loop.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Gauge {
    /// Steps per logical second.
    pub hz: Option<f64>,
    /// From the intended release to the start of the step.
    pub lateness: Option<Spread>,
    /// From the start of the step to the publication.
    pub compute: Option<Spread>,
    /// Age of the inertial sample that the step descends from, at its start.
    pub input_age: Option<Spread>,
    /// Releases left out and deadlines missed in the whole flight.
    pub missed: u64,
    /// Samples that came after their step.
    pub late_samples: u64,
}

/// Stamps of one step.
#[derive(Debug, Clone, Copy)]
struct Step {
    release_ns: u64,
    lateness_ns: u64,
    compute_ns: u64,
    input_age_ns: Option<u64>,
}

/// Everything that has been received.
#[derive(Debug, Default)]
pub struct Gauges {
    steps: BTreeMap<(Role, u32), VecDeque<Step>>,
    totals: BTreeMap<(Role, u32), LoopStats>,
    /// The last release of all \[ns\].
    newest_ns: u64,
    /// Publication of inertial samples by sequence \[ns\].
    imu: VecDeque<(u64, u64)>,
}

impl Gauges {
    /// Takes a packed sample.
    pub fn take(&mut self, topic: &TopicInfo, packed: &[u8]) {
        let Some(header) = header(packed) else { return };
        if topic.name == topics::LOOP_STATS.info.name {
            if packed.len() == LoopStats::PACKED_SIZE {
                let stats = LoopStats::unpack(packed);
                self.totals.insert((stats.role, seat_of_loop(header.seat)), stats);
            }
            return;
        }
        let Some(pulse) = PULSES.iter().find(|pulse| pulse.name == topic.name) else { return };
        if pulse.from == Role::Plant {
            self.imu.push_back((header.sequence, header.publish_mono_ns));
            if self.imu.len() > REMEMBERED {
                self.imu.pop_front();
            }
        }
        self.step(pulse.from, &header);
    }

    fn step(&mut self, role: Role, header: &Header) {
        let cause = header.cause_sequence;
        let is_caused = cause > 0 && role != Role::Plant;
        let published_ns = is_caused
            .then(|| self.imu.binary_search_by_key(&cause, |(sequence, _)| *sequence).ok())
            .flatten()
            .map(|at| self.imu[at].1);
        let steps = self.steps.entry((role, header.seat)).or_default();
        // A restarted loop publishes its last step again.
        if steps.back().is_some_and(|last| last.release_ns >= header.release_ns) {
            return;
        }
        steps.push_back(Step {
            release_ns: header.release_ns,
            lateness_ns: header.start_mono_ns.saturating_sub(header.release_mono_ns),
            compute_ns: header.publish_mono_ns.saturating_sub(header.start_mono_ns),
            input_age_ns: published_ns.map(|at_ns| header.start_mono_ns.saturating_sub(at_ns)),
        });
        self.newest_ns = self.newest_ns.max(header.release_ns);
        let oldest_ns = header.release_ns.saturating_sub(WINDOW_NS);
        while steps.front().is_some_and(|step| step.release_ns < oldest_ns) {
            steps.pop_front();
        }
    }

    /// The figures of a loop.
    #[must_use]
    pub fn of(&self, role: Role, seat: u32) -> Gauge {
        let totals = self.totals.get(&(role, seat)).copied().unwrap_or_default();
        let mut gauge = Gauge {
            missed: totals.skipped + totals.input_deadline_misses,
            late_samples: totals.late_samples,
            ..Gauge::default()
        };
        let Some(steps) = self.steps.get(&(role, seat)) else { return gauge };
        // A loop that has stopped is followed by no step that would make its old ones go.
        let oldest_ns = self.newest_ns.saturating_sub(WINDOW_NS);
        let outdated = steps.partition_point(|step| step.release_ns < oldest_ns);
        let steps = || steps.range(outdated..);
        if let (Some(first), Some(last)) = (steps().next(), steps().next_back())
            && last.release_ns > first.release_ns
        {
            let span_s = (last.release_ns - first.release_ns) as f64 / 1e9;
            gauge.hz = Some((steps().len() - 1) as f64 / span_s);
        }
        gauge.lateness = spread(steps().map(|step| step.lateness_ns));
        gauge.compute = spread(steps().map(|step| step.compute_ns));
        gauge.input_age = spread(steps().filter_map(|step| step.input_age_ns));
        gauge
    }
}

fn spread(values: impl Iterator<Item = u64>) -> Option<Spread> {
    let mut values: Vec<u64> = values.collect();
    values.sort_unstable();
    let us = |ns: u64| ns as f64 / 1e3;
    Some(Spread { median_us: us(*values.get(values.len() / 2)?), max_us: us(*values.last()?) })
}
