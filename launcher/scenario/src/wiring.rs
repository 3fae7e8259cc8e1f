//! From a scenario to the flight's graph: loops with their rates, arrows with their latencies.

use super::settings::{Clock, LatencySettings, Settings};
use crate::services::{Assignment, Loop};
use runtime::graph::Edge;
use runtime::{Graph, GraphError, MissPolicy, Node, Rate, RateError};
use shared_types::time::ns_from_s;
use shared_types::{Role, TopicInfo, topics};
use thiserror::Error;

/// Realtime: how long a loop waits for its inputs unless the scenario sets it. Half of the
/// shortest declared latency, so that the other half is left to compute; never more than half of the
/// loop's own period.
const INPUT_DEADLINE_S: f64 = 0.0005;

/// An estimate without its inertial sample is worth nothing: the estimator waits for a stall of the
/// plant to pass, and its consumers have deadlines of their own.
const ESTIMATOR_DEADLINE_S: f64 = 0.02;

/// Why a scenario has no graph.
#[derive(Debug, Error)]
pub enum WiringError {
    /// A loop's rate.
    #[error("{section}.rate_hz: {error}")]
    Rate {
        /// Section of the loop.
        section: &'static str,
        /// What is wrong.
        error: RateError,
    },
    /// The wiring as a whole.
    #[error(transparent)]
    Graph(#[from] GraphError),
}

/// Section of a scenario that configures the loop of `role`.
#[must_use]
pub fn section(role: Role) -> &'static str {
    Loop::of(role).map_or("launcher", |first| first.section)
}

/// The graph of a flight with these settings.
pub(super) fn graph(settings: &Settings) -> Result<Graph, WiringError> {
    let rig = settings.pilot.is_rig();
    let nodes = Role::STEPPING
        .into_iter()
        .filter(|role| !(rig && *role == Role::Position))
        .filter(|role| settings.monitor.enabled || *role != Role::Monitor)
        .map(|role| node(settings, role))
        .collect::<Result<Vec<_>, _>>()?;
    let graph = Graph::new(nodes, &|topic| latency_ns(&settings.latency, topic))?;
    let deadline_s = |edge: &Edge| settings.realtime.deadline_s(edge.to, edge.topic.name);
    let graph = graph.with_deadlines(&|edge| deadline_s(edge).map(ns_from_s));
    // Without a time that steps take there is no instant of publication.
    let by_wall = settings.scenario.clock == Clock::Realtime || !settings.timing.is_empty();
    let asap = |topic: &TopicInfo| settings.realtime.asap.iter().any(|name| name == topic.name);
    Ok(graph.with_asap(&|topic| by_wall && asap(topic)))
}

fn node(settings: &Settings, role: Role) -> Result<Node, WiringError> {
    let rate_hz = Assignment::of(settings).rate_hz(role, settings);
    let rate = Rate::from_hz(rate_hz)
        .map_err(|error| WiringError::Rate { section: section(role), error })?;
    let lead_ns = match role {
        Role::Pilot => ns_from_s(settings.pilot.common.lead_s),
        // Far enough ahead that pacing it costs few wake-ups, near enough for live commands.
        Role::Disturbance => 20 * rate.period_ns(),
        _ => 0,
    };
    let own = settings.realtime.of(role);
    let input_deadline_s = own.and_then(|own| own.input_deadline_s);
    let input_deadline_ns = input_deadline_s.map_or_else(
        || match role {
            Role::Estimator => ns_from_s(ESTIMATOR_DEADLINE_S),
            _ => ns_from_s(INPUT_DEADLINE_S).min(rate.period_ns() / 2),
        },
        ns_from_s,
    );
    let miss_policy = own.and_then(|own| own.miss_policy);
    let miss_policy = miss_policy.map_or(default_policy(role), MissPolicy::from);
    Ok(Node { role, rate, lead_ns, input_deadline_ns, miss_policy })
}

/// Physics, estimate and sources must not lose a step; a controller's old command is worth nothing, and
/// neither is a judgement of what is over.
fn default_policy(role: Role) -> MissPolicy {
    match role {
        role if role.is_slot() || role == Role::Monitor => MissPolicy::Skip,
        _ => MissPolicy::CatchUp,
    }
}

/// How often a sensor's topic is published, which is less often than the plant steps.
pub(super) fn sensor_rate(settings: &Settings, topic: &TopicInfo) -> Option<Rate> {
    // A missing sensor publishes nothing; 1 Hz is the lowest rate that there is.
    let rate_hz = settings.plant.sensors().rate_hz(topic)?.max(1);
    Rate::from_hz(rate_hz.into()).ok()
}

fn latency_ns(latency: &LatencySettings, topic: &TopicInfo) -> u64 {
    declared(latency)
        .into_iter()
        .find(|(name, _)| *name == topic.name)
        .map_or(0, |(_, s)| ns_from_s(s))
}

/// Names of the topics of which a scenario declares how long after their release samples take effect.
pub fn delayed_topics() -> impl Iterator<Item = &'static str> {
    declared(&LatencySettings::default()).into_iter().map(|(name, _)| name)
}

fn declared(latency: &LatencySettings) -> [(&'static str, f64); 4] {
    [
        (topics::WRENCH_COMMAND.info.name, latency.wrench_command_s),
        (topics::ATTITUDE_SETPOINT.info.name, latency.attitude_setpoint_s),
        (topics::APPLIED_SETPOINT.info.name, latency.applied_setpoint_s),
        (topics::TRIP.info.name, latency.trip_s),
    ]
}
