//! Random flights: rates, latencies and leads, with and without a position loop.

use super::flight::Plan;
use proptest::prelude::*;
use runtime::{Graph, GraphError, MissPolicy, Node, Rate};
use shared_types::{Role, topics};

/// Everything that may differ from flight to flight.
#[derive(Debug, Clone)]
pub(crate) struct Wiring {
    /// By role.
    pub(crate) rates_hz: [f64; 7],
    pub(crate) wrench_latency_ns: u64,
    pub(crate) setpoint_latency_ns: u64,
    pub(crate) applied_latency_ns: u64,
    pub(crate) trip_latency_ns: u64,
    pub(crate) pilot_lead_ns: u64,
    pub(crate) disturbance_lead_ns: u64,
    pub(crate) with_position: bool,
    pub(crate) end_ns: u64,
}

impl Default for Wiring {
    fn default() -> Self {
        Self {
            rates_hz: [1000.0, 1000.0, 100.0, 500.0, 200.0, 100.0, 100.0],
            wrench_latency_ns: 1_000_000,
            setpoint_latency_ns: 1_000_000,
            applied_latency_ns: 1_000_000,
            trip_latency_ns: 1_000_000,
            pilot_lead_ns: 200_000_000,
            disturbance_lead_ns: 5_000_000,
            with_position: true,
            end_ns: 300_000_000,
        }
    }
}

impl Wiring {
    pub(crate) fn graph(&self) -> Result<Graph, GraphError> {
        let nodes = Role::STEPPING
            .into_iter()
            .filter(|&role| self.with_position || role != Role::Position)
            .map(|role| Node {
                role,
                rate: Rate::from_hz(self.rates_hz[role.index()]).expect("a possible rate"),
                lead_ns: match role {
                    Role::Pilot => self.pilot_lead_ns,
                    Role::Disturbance => self.disturbance_lead_ns,
                    _ => 0,
                },
                input_deadline_ns: 0,
                miss_policy: MissPolicy::CatchUp,
            })
            .collect();
        Graph::new(nodes, &|topic| match topic.name {
            name if name == topics::WRENCH_COMMAND.info.name => self.wrench_latency_ns,
            name if name == topics::ATTITUDE_SETPOINT.info.name => self.setpoint_latency_ns,
            name if name == topics::TRIP.info.name => self.trip_latency_ns,
            name if name == topics::APPLIED_SETPOINT.info.name => self.applied_latency_ns,
            _ => 0,
        })
    }

    /// The flight, unless the graph refuses it.
    pub(crate) fn plan(&self, state_every: u64) -> Option<Plan> {
        let graph = self.graph().ok()?;
        Some(Plan { graph, end_ns: self.end_ns, state_every })
    }
}

/// Any wiring; about one in twenty is refused (a loop without delay).
pub(crate) fn wirings() -> impl Strategy<Value = Wiring> {
    let rates = [
        vec![1000.0, 500.0, 2000.0, 997.0],
        vec![1000.0, 500.0, 150.0, 333.333, 400.0],
        vec![150.0, 100.0, 50.0, 20.0, 333.0],
        vec![150.0, 500.0, 1000.0, 333.0, 50.0],
        vec![200.0, 77.7, 1000.0, 9.9],
        vec![100.0, 33.3, 10.0, 150.0, 500.0],
        vec![100.0, 250.0, 33.3, 10.0],
    ]
    .map(prop::sample::select);
    let latencies = [
        vec![0, 1, 1_000_000, 2_500_001],
        vec![0, 1_000_000, 20_000_000, 1],
        vec![0, 1_000_000, 6_666_666],
        vec![1_000_000, 1, 11_000_000],
    ]
    .map(prop::sample::select);
    let leads = [
        vec![1, 2, 5_000_000, 200_000_000, 33_333_333],
        vec![1, 1_000_000, 5_000_000, 101_010_102],
    ]
    .map(prop::sample::select);
    (rates, latencies, leads, any::<bool>(), 20_000_000..260_000_000_u64).prop_map(
        |(rates_hz, latencies, leads, with_position, end_ns)| Wiring {
            rates_hz,
            wrench_latency_ns: latencies[0],
            setpoint_latency_ns: latencies[1],
            applied_latency_ns: latencies[2],
            trip_latency_ns: latencies[3],
            pilot_lead_ns: leads[0],
            disturbance_lead_ns: leads[1],
            with_position,
            end_ns,
        },
    )
}
