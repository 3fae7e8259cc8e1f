//! What a process must know of its flight, as the launcher leaves it in the run's folder.
//!
//! The file is TOML, so that controllers in other languages read it too.

use crate::HostError;
use crate::realtime::{Policy, Realtime, Setup};
use runtime::graph::Edge;
use runtime::priority::Schedule;
use runtime::{Graph, MissPolicy, Node, Rate};
use serde::{Deserialize, Serialize};
use shared_types::{Role, TopicInfo};
use std::io;
use std::path::Path;
use timing::Script;
use vehicle::{Geometry, Quadratic, VehicleParameters};

/// The file's name in the run's folder.
pub const FILE: &str = "flight.toml";
/// Its name while it is written.
const FRESH: &str = ".flight.toml";

/// Clock, loops, arrows and modelled vehicle of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flight {
    /// `lockstep` or `realtime`.
    pub clock: Clock,
    /// Seconds of the flight in a second by the wall clock; of no meaning in lockstep.
    pub speed: f64,
    /// How long the flight goes on after the launcher's death, for another launcher to come \[s\].
    pub grace_s: f64,
    /// How long the vehicle hovers without a new reference before it descends \[s\].
    pub hover_s: f64,
    /// How long hover and landing take \[s\].
    pub landing_s: f64,
    /// Heading at the start \[rad\].
    pub start_yaw_rad: f64,
    /// What realtime loops ask of the system.
    realtime: Realtime,
    /// The vehicle as all loops model it.
    vehicle: Vehicle,
    /// The loops that take part, in data-flow order.
    loops: Vec<Loop>,
    /// Which loop waits for which, and how old what arrives is.
    edges: Vec<Arrow>,
    /// What happens to the time of loops and samples, on a clock that the launcher moves.
    pub timing: Option<Script>,
}

/// How a flight's clock runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// Simulated time.
    Lockstep,
    /// Logical time follows the wall clock.
    Realtime,
}

/// What a flight is described from.
#[derive(Debug, Clone)]
pub struct Facts<'a> {
    /// Clock.
    pub clock: Clock,
    /// See [`Flight::grace_s`].
    pub grace_s: f64,
    /// See [`Flight::hover_s`].
    pub hover_s: f64,
    /// See [`Flight::landing_s`].
    pub landing_s: f64,
    /// See [`Flight::start_yaw_rad`].
    pub start_yaw_rad: f64,
    /// What all realtime loops ask of the system.
    pub realtime: Realtime,
    /// What each asks for.
    pub claims: &'a [(Role, Claim)],
    /// The vehicle as it is modelled.
    pub vehicle: &'a VehicleParameters,
    /// Loops and arrows.
    pub graph: &'a Graph,
    /// See [`Flight::timing`].
    pub timing: Option<Script>,
}

/// A loop's share of the machine.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// Priority under `SCHED_FIFO`; 0 for none.
    pub priority: u8,
    /// Share of each period that it may compute, under `SCHED_DEADLINE`.
    pub budget_share: f64,
    /// Processors to stay on; none for any.
    pub cpus: Vec<usize>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Loop {
    role: String,
    rate_hz: f64,
    lead_ns: u64,
    input_deadline_ns: u64,
    miss_policy: Miss,
    claim: Claim,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Miss {
    Skip,
    CatchUp,
    Hold,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Arrow {
    topic: String,
    from: String,
    to: String,
    latency_ns: u64,
    deadline_ns: u64,
    /// Written for readers in other languages; here it follows from the consumer.
    strict: bool,
    asap: bool,
}

/// [`VehicleParameters`], each geometry law as `[c0, c1, c2]` over β in degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Vehicle {
    mass_kg: f64,
    gravity_m_s2: f64,
    yaw_coefficient_m: f64,
    rotor_thrust_max_n: f64,
    rotor_lag_s: f64,
    drag_n_s_m: f64,
    servo_rate_limit_rad_s: f64,
    servo_lag_s: f64,
    inertia_scale: f64,
    arm_length_m: [f64; 3],
    inertia_xx_kg_m2: [f64; 3],
    inertia_yy_kg_m2: [f64; 3],
    inertia_zz_kg_m2: [f64; 3],
}

impl Flight {
    /// Describes a flight.
    #[must_use]
    pub fn new(facts: Facts) -> Self {
        let Facts { clock, grace_s, hover_s, landing_s, start_yaw_rad, realtime, claims, .. } =
            facts;
        let Facts { vehicle, graph, timing, .. } = facts;
        let of_node = |node: &Node| {
            let own = claims.iter().find(|(role, _)| *role == node.role);
            Loop::new(node, own.map(|(_, claim)| claim.clone()).unwrap_or_default())
        };
        Self {
            clock,
            speed: 1.0,
            grace_s,
            hover_s,
            landing_s,
            start_yaw_rad,
            realtime,
            vehicle: vehicle.into(),
            loops: graph.nodes().iter().map(of_node).collect(),
            edges: graph.edges().iter().map(Arrow::from).collect(),
            timing,
        }
    }

    /// Reads what the launcher has left in a run's folder.
    ///
    /// # Errors
    /// There is no such file, or it is of another build.
    pub fn read(folder: &Path) -> Result<Self, HostError> {
        let path = folder.join(FILE);
        let wrong = |reason: String| HostError::Flight { path: path.clone(), reason };
        let text = std::fs::read_to_string(&path).map_err(|error| wrong(error.to_string()))?;
        toml::from_str(&text).map_err(|error| wrong(error.to_string()))
    }

    /// Leaves it in a run's folder, whole or not at all: a process may be reading what was there.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, folder: &Path) -> io::Result<()> {
        let text = toml::to_string(self).map_err(io::Error::other)?;
        let fresh = folder.join(FRESH);
        std::fs::write(&fresh, text)?;
        std::fs::rename(fresh, folder.join(FILE))
    }

    /// True if logical time follows the wall clock.
    #[must_use]
    pub fn is_realtime(&self) -> bool {
        self.clock == Clock::Realtime
    }

    /// What the loop of a role asks of the system; `None` in lockstep, where nothing is urgent.
    #[must_use]
    pub fn setup(&self, role: Role) -> Option<Setup> {
        let own = self.loops.iter().find(|own| own.role == role.label())?;
        let Realtime { policy, lock_memory, timer_slack_ns, .. } = self.realtime;
        self.is_realtime().then(|| Setup {
            schedule: own.schedule(policy),
            cpus: own.claim.cpus.clone(),
            lock_memory,
            timer_slack_ns,
        })
    }

    /// Whether to refuse to fly without what the loops ask for.
    #[must_use]
    pub fn is_strict(&self) -> bool {
        self.realtime.strict
    }

    /// The vehicle as all loops model it.
    #[must_use]
    pub fn vehicle(&self) -> VehicleParameters {
        self.vehicle.into()
    }

    /// Rate of a role's loop \[Hz\]; `None` if no process fills it in this flight.
    #[must_use]
    pub fn rate_hz(&self, role: Role) -> Option<f64> {
        self.loops.iter().find(|l| l.role == role.label()).map(|l| l.rate_hz)
    }

    /// Declared latency of a topic, from the step that sends it to its effect \[s\]; 0 if no loop reads it.
    #[must_use]
    pub fn latency_s(&self, topic: &TopicInfo) -> f64 {
        let arrow = self.edges.iter().find(|arrow| arrow.topic == topic.name);
        arrow.map_or(0.0, |arrow| arrow.latency_ns as f64 * 1e-9)
    }

    /// Loops and arrows.
    ///
    /// # Errors
    /// The file names a role or a rate that this build does not know, or cannot be wired.
    pub fn graph(&self) -> Result<Graph, HostError> {
        let nodes = self.loops.iter().map(Loop::node).collect::<Result<Vec<_>, _>>()?;
        let latency_ns = |topic: &TopicInfo| {
            let arrow = self.edges.iter().find(|arrow| arrow.topic == topic.name);
            arrow.map_or(0, |arrow| arrow.latency_ns)
        };
        let deadline_ns = |edge: &Edge| {
            let is_edge = |a: &&Arrow| a.topic == edge.topic.name && a.to == edge.to.label();
            self.edges.iter().find(is_edge).map(|arrow| arrow.deadline_ns)
        };
        let asap = |topic: &TopicInfo| self.edges.iter().any(|a| a.asap && a.topic == topic.name);
        Ok(Graph::new(nodes, &latency_ns)?.with_deadlines(&deadline_ns).with_asap(&asap))
    }
}

impl Loop {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a period"
    )]
    fn schedule(&self, policy: Policy) -> Option<Schedule> {
        match policy {
            Policy::Other => None,
            Policy::Fifo => Some(self.claim.priority).filter(|p| *p > 0).map(Schedule::Fifo),
            Policy::Deadline => {
                let period_ns = 1e9 / self.rate_hz;
                let budget_ns = (self.claim.budget_share * period_ns) as u64;
                Some(Schedule::Deadline { budget_ns, period_ns: period_ns as u64 })
            }
        }
    }

    fn new(node: &Node, claim: Claim) -> Self {
        Self {
            claim,
            role: node.role.label().to_owned(),
            rate_hz: node.rate.hz(),
            lead_ns: node.lead_ns,
            input_deadline_ns: node.input_deadline_ns,
            miss_policy: match node.miss_policy {
                MissPolicy::Skip => Miss::Skip,
                MissPolicy::CatchUp => Miss::CatchUp,
                MissPolicy::Hold => Miss::Hold,
            },
        }
    }

    fn node(&self) -> Result<Node, HostError> {
        let role = Role::STEPPING.into_iter().find(|role| role.label() == self.role);
        Ok(Node {
            role: role.ok_or_else(|| HostError::Flight {
                path: FILE.into(),
                reason: format!("no loop is called {}", self.role),
            })?,
            rate: Rate::from_hz(self.rate_hz)?,
            lead_ns: self.lead_ns,
            input_deadline_ns: self.input_deadline_ns,
            miss_policy: match self.miss_policy {
                Miss::Skip => MissPolicy::Skip,
                Miss::CatchUp => MissPolicy::CatchUp,
                Miss::Hold => MissPolicy::Hold,
            },
        })
    }
}

impl From<&Edge> for Arrow {
    fn from(edge: &Edge) -> Self {
        Self {
            topic: edge.topic.name.to_owned(),
            from: edge.from.label().to_owned(),
            to: edge.to.label().to_owned(),
            latency_ns: edge.latency_ns,
            deadline_ns: edge.deadline_ns,
            strict: edge.strict,
            asap: edge.asap,
        }
    }
}

impl From<&VehicleParameters> for Vehicle {
    fn from(vehicle: &VehicleParameters) -> Self {
        let law = |Quadratic { c0, c1, c2 }| [c0, c1, c2];
        Self {
            mass_kg: vehicle.mass_kg,
            gravity_m_s2: vehicle.gravity_m_s2,
            yaw_coefficient_m: vehicle.yaw_coefficient_m,
            rotor_thrust_max_n: vehicle.rotor_thrust_max_n,
            rotor_lag_s: vehicle.rotor_lag_s,
            drag_n_s_m: vehicle.drag_n_s_m,
            servo_rate_limit_rad_s: vehicle.servo_rate_limit_rad_s,
            servo_lag_s: vehicle.servo_lag_s,
            inertia_scale: vehicle.inertia_scale,
            arm_length_m: law(vehicle.geometry.arm_length_m),
            inertia_xx_kg_m2: law(vehicle.geometry.inertia_xx_kg_m2),
            inertia_yy_kg_m2: law(vehicle.geometry.inertia_yy_kg_m2),
            inertia_zz_kg_m2: law(vehicle.geometry.inertia_zz_kg_m2),
        }
    }
}

impl From<Vehicle> for VehicleParameters {
    fn from(vehicle: Vehicle) -> Self {
        let law = |[c0, c1, c2]: [f64; 3]| Quadratic { c0, c1, c2 };
        Self {
            mass_kg: vehicle.mass_kg,
            gravity_m_s2: vehicle.gravity_m_s2,
            yaw_coefficient_m: vehicle.yaw_coefficient_m,
            rotor_thrust_max_n: vehicle.rotor_thrust_max_n,
            rotor_lag_s: vehicle.rotor_lag_s,
            drag_n_s_m: vehicle.drag_n_s_m,
            servo_rate_limit_rad_s: vehicle.servo_rate_limit_rad_s,
            servo_lag_s: vehicle.servo_lag_s,
            inertia_scale: vehicle.inertia_scale,
            geometry: Geometry {
                arm_length_m: law(vehicle.arm_length_m),
                inertia_xx_kg_m2: law(vehicle.inertia_xx_kg_m2),
                inertia_yy_kg_m2: law(vehicle.inertia_yy_kg_m2),
                inertia_zz_kg_m2: law(vehicle.inertia_zz_kg_m2),
            },
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use shared_types::topics;
    use timing::{SampleEffect, SampleEntry, Window};

    /// A third of a millisecond has no short decimal form.
    pub(crate) fn flight() -> (Flight, Graph, VehicleParameters) {
        let node = |role, hz, policy| Node {
            role,
            rate: Rate::from_hz(hz).unwrap(),
            lead_ns: 7,
            input_deadline_ns: 333_333,
            miss_policy: policy,
        };
        let nodes = vec![
            node(Role::Plant, 1000.0, MissPolicy::CatchUp),
            node(Role::Estimator, 333.333, MissPolicy::CatchUp),
            node(Role::Attitude, 150.0, MissPolicy::Skip),
            node(Role::Pilot, 50.0, MissPolicy::Hold),
        ];
        let graph = Graph::new(nodes, &|_| 1_234_567).unwrap();
        let graph = graph
            .with_deadlines(&|edge| (edge.to == Role::Attitude).then_some(99))
            .with_asap(&|topic| topic.name == topics::WRENCH_COMMAND.info.name);
        let geometry = Geometry { arm_length_m: Quadratic::constant(0.1), ..Geometry::default() };
        let vehicle =
            VehicleParameters { mass_kg: 0.1 + 0.2, geometry, ..VehicleParameters::default() };
        let sample = SampleEntry {
            topic: topics::IMU.info.name.to_owned(),
            window: Window { from_ns: 3, until_ns: u64::MAX },
            effect: SampleEffect::Lost,
        };
        let script = Script::new(7, Vec::new(), vec![sample]);
        let facts = Facts {
            clock: Clock::Realtime,
            grace_s: 30.0,
            hover_s: 2.0,
            landing_s: 4.5,
            start_yaw_rad: 1.0 / 3.0,
            realtime: Realtime {
                policy: Policy::Fifo,
                lock_memory: true,
                timer_slack_ns: 7,
                strict: false,
            },
            claims: &[(Role::Attitude, Claim { priority: 12, budget_share: 0.25, cpus: vec![1] })],
            vehicle: &vehicle,
            graph: &graph,
            timing: Some(script),
        };
        (Flight::new(facts), graph, vehicle)
    }

    #[test]
    fn what_the_launcher_writes_is_what_a_process_reads_to_the_bit() {
        let (flight, graph, vehicle) = flight();
        let folder = tempfile::tempdir().unwrap();
        flight.write(folder.path()).unwrap();
        let read = Flight::read(folder.path()).unwrap();
        assert_eq!(read, flight);
        assert_eq!(read.vehicle(), vehicle);
        let shown = |graph: &Graph| format!("{graph:?}");
        assert_eq!(shown(&read.graph().unwrap()), shown(&graph));
        assert_eq!(read.rate_hz(Role::Attitude), Some(150.0));
        assert_eq!(read.rate_hz(Role::Position), None);
        let latency_s = read.latency_s(&topics::WRENCH_COMMAND.info);
        assert_eq!(latency_s.to_bits(), (1_234_567.0 * 1e-9_f64).to_bits());
        let setup = read.setup(Role::Attitude).unwrap();
        let wanted = Setup {
            schedule: Some(Schedule::Fifo(12)),
            cpus: vec![1],
            lock_memory: true,
            timer_slack_ns: 7,
        };
        assert_eq!(setup, wanted);
        assert_eq!(read.setup(Role::Plant).unwrap().schedule, None);
        assert_eq!(read.setup(Role::Position), None);
    }

    #[test]
    fn a_run_without_the_file_or_with_another_builds_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = Flight::read(folder.path()).unwrap_err().to_string();
        assert!(missing.contains(FILE) && missing.contains("same build"), "{missing}");
        std::fs::write(folder.path().join(FILE), "clock = \"sundial\"").unwrap();
        let other = Flight::read(folder.path()).unwrap_err().to_string();
        assert!(other.contains("sundial") || other.contains("clock"), "{other}");
    }
}
