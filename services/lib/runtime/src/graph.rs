//! Which loop waits for which: the flight's data flow as edges between release grids.
//!
//! A process publishes its *mark*: the instant of the first release it has not completely
//! published. Everything released before the mark is final. An edge turns marks into permission: a
//! step may run once every input it waits for is final up to that step's instant, so a process
//! runs whole intervals and not single ticks (conservative look-ahead, Chandy & Misra 1979). A loop
//! that announces until when it is quiet permits steps that far ahead of its mark.

mod bounds;

pub use bounds::{CREDIT_NS, READER_CAPACITY};

use crate::rate::Rate;
use shared_types::{Edge as EdgeKind, Role, Slot, TopicInfo, topics};
use thiserror::Error;

/// Number of roles that step.
pub const ROLES: usize = Role::STEPPING.len();

/// Marks of all roles \[ns\], indexed by [`Role::index`].
pub type Marks = [u64; ROLES];

/// How far the producer of an arrow has got, for the process that waits for it.
pub trait MarkView {
    /// Everything that travels along `edge` and was released before is final \[ns\].
    fn of(&self, edge: &Edge) -> u64;
    /// Mark of a role with one seat \[ns\].
    fn of_role(&self, role: Role) -> u64;
}

impl MarkView for Marks {
    fn of(&self, edge: &Edge) -> u64 {
        self.of_role(edge.from)
    }
    fn of_role(&self, role: Role) -> u64 {
        self.get(role.index()).copied().unwrap_or(0)
    }
}

/// Some of the roles that step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Roles([bool; ROLES]);

impl Roles {
    /// Every one.
    pub const ALL: Self = Self([true; ROLES]);

    /// Adds one; a role that does not step is never among them.
    pub fn insert(&mut self, role: Role) {
        if let Some(member) = self.0.get_mut(role.index()) {
            *member = true;
        }
    }

    /// True if `role` is among them.
    #[must_use]
    pub fn contains(self, role: Role) -> bool {
        self.0.get(role.index()).copied().unwrap_or(false)
    }
}

impl FromIterator<Role> for Roles {
    fn from_iter<I: IntoIterator<Item = Role>>(roles: I) -> Self {
        let mut all = Self::default();
        roles.into_iter().for_each(|role| all.insert(role));
        all
    }
}

/// What a loop does about releases it finds in the past (realtime only).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MissPolicy {
    /// Run only the newest due release.
    Skip,
    /// Run every due release in order.
    CatchUp,
    /// Run none of them and wait for the next one.
    Hold,
}

/// One loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Its seat.
    pub role: Role,
    /// Its release grid.
    pub rate: Rate,
    /// A source runs this far ahead of the plant \[ns\]; 0 for every other loop.
    pub lead_ns: u64,
    /// Realtime: how long after its release a step waits for inputs without latency, unless an edge
    /// has a deadline of its own. Logical time, so that a slower clock stretches it \[ns\].
    pub input_deadline_ns: u64,
    /// Realtime: what to do about missed releases.
    pub miss_policy: MissPolicy,
}

/// One arrow between two loops.
#[derive(Debug, Clone, Copy)]
pub struct Edge {
    /// Topic that flows along it.
    pub topic: &'static TopicInfo,
    /// Role that really produces the topic in this flight.
    pub from: Role,
    /// Consumer.
    pub to: Role,
    /// Latency from release to effect at this consumer \[ns\].
    pub latency_ns: u64,
    /// How much of it is this consumer's own, beyond the instant of effect that the samples themselves name \[ns\].
    pub held_back_ns: u64,
    /// Realtime: how long after its release the consumer's step waits for this edge, in logical
    /// time; 0 if it never does \[ns\].
    pub deadline_ns: u64,
    /// The consumer's step at t depends only on samples effective *before* t.
    pub strict: bool,
    /// Realtime: samples take effect when they are published, and not a latency after their release.
    /// When a sample is in effect then depends on the machine.
    pub asap: bool,
}

impl Edge {
    /// An arrow from outside the waiting graph, like an owner record's: samples take effect at
    /// their instant, and no loop waits for them.
    #[must_use]
    pub fn unwaited(topic: &'static TopicInfo, to: Role) -> Self {
        let strict = to == Role::Plant;
        Self {
            topic,
            from: topic.from,
            to,
            latency_ns: 0,
            held_back_ns: 0,
            deadline_ns: 0,
            strict,
            asap: false,
        }
    }

    /// True if the consumer's step at `t_ns` may run as far as this edge is concerned.
    #[must_use]
    pub fn permits(&self, t_ns: u64, mark_ns: u64) -> bool {
        t_ns < self.open_until_ns(mark_ns)
    }

    /// Steps of the consumer before this instant may run once the producer's mark is `mark_ns`:
    /// whatever is released from the mark on takes effect a latency later \[ns\].
    #[must_use]
    pub fn open_until_ns(&self, mark_ns: u64) -> u64 {
        mark_ns.saturating_add(self.latency_ns).saturating_add(u64::from(self.strict))
    }

    /// Instant from which a sample that names `valid_ns` is in effect for the consumer \[ns\].
    #[must_use]
    pub fn effect_ns(&self, valid_ns: u64) -> u64 {
        valid_ns.saturating_add(self.held_back_ns)
    }

    /// True if a sample that names `valid_ns` as its instant of effect belongs to the consumer's step at `t_ns`.
    #[must_use]
    pub fn in_effect(&self, valid_ns: u64, t_ns: u64) -> bool {
        let from_ns = self.effect_ns(valid_ns);
        from_ns < t_ns || (!self.strict && from_ns == t_ns)
    }
}

/// Why a flight cannot be wired as asked.
#[derive(Debug, Error, PartialEq)]
pub enum GraphError {
    /// A loop of edges without any delay: no process could ever start.
    #[error(
        "zero-latency loop {0}: declare a latency above 0 on one of its edges, for example `[latency] attitude_setpoint_s = 0.001`"
    )]
    ZeroLatencyLoop(String),
    /// More samples can be in flight than a reader keeps.
    #[error(
        "topic {topic}: up to {needed} samples can wait for {consumer}, but a reader keeps {capacity}: lower the rate of {producer} or raise the rate of {consumer}"
    )]
    BufferTooSmall {
        /// Topic name.
        topic: &'static str,
        /// Producer.
        producer: &'static str,
        /// Consumer.
        consumer: &'static str,
        /// Samples that can pile up.
        needed: u64,
        /// Samples a reader keeps.
        capacity: u64,
    },
}

/// The flight's loops and arrows.
#[derive(Debug, Clone)]
pub struct Graph {
    nodes: Vec<Node>,
    edges: Vec<Edge>,
    /// See [`Self::quiet_limit_ns`].
    quiet_limit_ns: u64,
}

/// Declared latency of each delayed topic, by topic name \[ns\].
pub type Latency<'a> = &'a dyn Fn(&TopicInfo) -> u64;

/// How late the plant takes in what is made of its own samples and has no latency: it would wait for each of its steps to
/// come back otherwise. Commands have a latency of their own \[ns\].
const FEEDBACK_NS: u64 = 20_000_000;

/// Role that holds a slot, or fills any other role, where `present` gives the roles that there are.
fn holder(role: Role, present: &dyn Fn(Role) -> bool) -> Role {
    let stand_in = || Slot::of(role).and_then(|slot| slot.spec().stand_in);
    if present(role) { role } else { stand_in().unwrap_or(role) }
}

impl Graph {
    /// Wires the topic table between the loops that take part.
    ///
    /// A slot without a process of its own is filled by its stand-in. Topics between absent roles fall away.
    ///
    /// # Errors
    /// [`GraphError`] if the wiring could deadlock or overflow a reader.
    pub fn new(nodes: Vec<Node>, latency: Latency) -> Result<Self, GraphError> {
        let present = |role: Role| nodes.iter().any(|n| n.role == role);
        let mut edges = Vec::new();
        for topic in topics::all() {
            let from = holder(topic.from, &present);
            for &to in topic.to {
                if from != to && present(from) && present(to) {
                    let node = |role: Role| nodes.iter().find(|n| n.role == role);
                    let strict = to == Role::Plant;
                    let leads = node(from).is_some_and(|n| n.lead_ns > 0);
                    let (latency_ns, held_back_ns) = match topic.edge {
                        EdgeKind::Delayed => (latency(topic), 0),
                        EdgeKind::ZeroLatency if strict && !leads => (FEEDBACK_NS, FEEDBACK_NS),
                        EdgeKind::ZeroLatency | EdgeKind::RecordOnly => (0, 0),
                    };
                    let waits = topic.edge == EdgeKind::ZeroLatency && !strict;
                    let deadline_ns = node(to).filter(|_| waits).map_or(0, |n| n.input_deadline_ns);
                    edges.push(Edge {
                        from,
                        latency_ns,
                        held_back_ns,
                        deadline_ns,
                        ..Edge::unwaited(topic, to)
                    });
                }
            }
        }
        let mut graph = Self { nodes, edges, quiet_limit_ns: 0 };
        graph.refuse_zero_latency_loops()?;
        graph.bound()?;
        Ok(graph)
    }

    /// The same graph, with a deadline of its own for each edge that `deadline_ns` has one for.
    #[must_use]
    pub fn with_deadlines(mut self, deadline_ns: &dyn Fn(&Edge) -> Option<u64>) -> Self {
        for edge in &mut self.edges {
            edge.deadline_ns = deadline_ns(edge).unwrap_or(edge.deadline_ns);
        }
        self
    }

    /// The same graph, in which samples of these topics take effect when they are published.
    #[must_use]
    pub fn with_asap(mut self, asap: &dyn Fn(&TopicInfo) -> bool) -> Self {
        for edge in &mut self.edges {
            edge.asap = asap(edge.topic);
        }
        self
    }

    /// The loops, in the order given.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The arrows, in topic-table order.
    #[must_use]
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// The loop that fills `role`.
    #[must_use]
    pub fn node(&self, role: Role) -> Option<&Node> {
        self.nodes.iter().find(|n| n.role == role)
    }

    /// The arrow that carries `topic` to `to`.
    #[must_use]
    pub fn edge(&self, topic: &TopicInfo, to: Role) -> Option<&Edge> {
        self.edges.iter().find(|e| e.to == to && e.topic.name == topic.name)
    }

    /// The edge by which `to` reads a topic, whether it waits for it or not.
    #[must_use]
    pub fn edge_or_unwaited(&self, topic: &'static TopicInfo, to: Role) -> Edge {
        let latency_ns = self.latency_ns(topic);
        let unwaited = || Edge { latency_ns, ..Edge::unwaited(topic, to) };
        self.edge(topic, to).copied().unwrap_or_else(unwaited)
    }

    /// Role that really produces a topic in this flight: that of a slot may be filled by its stand-in.
    #[must_use]
    pub fn producer(&self, topic: &TopicInfo) -> Role {
        self.slot_holder(topic.from)
    }

    /// Role whose process holds a slot, or fills any other role, in this flight.
    #[must_use]
    pub fn slot_holder(&self, slot: Role) -> Role {
        holder(slot, &|role| self.node(role).is_some())
    }

    /// Declared latency of a topic, 0 if no loop in the flight reads it \[ns\].
    #[must_use]
    pub fn latency_ns(&self, topic: &TopicInfo) -> u64 {
        let edge = self.edges.iter().find(|e| e.topic.name == topic.name);
        edge.map_or(0, |e| e.latency_ns.saturating_sub(e.held_back_ns))
    }

    /// True if samples of a topic take effect when they are published.
    #[must_use]
    pub fn is_asap(&self, topic: &TopicInfo) -> bool {
        self.edges.iter().any(|e| e.asap && e.topic.name == topic.name)
    }

    /// True if `node`'s step at `t_ns` may run, given all marks and the end of allowed time.
    #[must_use]
    pub fn runnable(&self, node: &Node, t_ns: u64, marks: &impl MarkView, allowed_ns: u64) -> bool {
        t_ns < self.open_until_ns(node, marks, allowed_ns)
    }

    /// The roles whose marks do not permit `node`'s step at `t_ns`.
    #[must_use]
    pub fn held_by(&self, node: &Node, t_ns: u64, marks: &impl MarkView) -> Roles {
        let holds = |e: &&Edge| e.to == node.role && !e.permits(t_ns, marks.of(e));
        let mut roles: Roles = self.edges.iter().filter(holds).map(|e| e.from).collect();
        if t_ns > marks.of_role(Role::Plant).saturating_add(node.lead_ns) && node.lead_ns > 0 {
            roles.insert(Role::Plant);
        }
        roles
    }

    /// End of the interval that `node` may run now: every release before it is permitted \[ns\].
    #[must_use]
    pub fn open_until_ns(&self, node: &Node, marks: &impl MarkView, allowed_ns: u64) -> u64 {
        let edges = self.edges.iter().filter(|e| e.to == node.role);
        let opened = edges.map(|e| e.open_until_ns(marks.of(e)));
        let led = (node.lead_ns > 0 && self.node(Role::Plant).is_some())
            .then(|| marks.of_role(Role::Plant).saturating_add(node.lead_ns).saturating_add(1));
        opened.chain(led).fold(allowed_ns, u64::min)
    }

    /// True if `role` needs to know how far `on` has got.
    #[must_use]
    pub fn waits_for(&self, role: Role, on: Role) -> bool {
        let paced = on == Role::Plant && self.node(role).is_some_and(|n| n.lead_ns > 0);
        paced || self.edges.iter().any(|e| e.from == on && e.to == role)
    }

    /// True if `role` reads the marks of another: because it waits for it, or to wake it only when that is due.
    #[must_use]
    pub fn reads_marks(&self, role: Role, of: Role) -> bool {
        self.waits_for(role, of) || (self.quiet_limit_ns(of) > 0 && self.waits_for(of, role))
    }

    /// Roles worth waking when `from` moves its mark from `old_ns` to `new_ns`.
    pub fn wakes(&self, from: Role, old_ns: u64, new_ns: u64) -> impl Iterator<Item = Role> + '_ {
        self.nodes.iter().filter(move |n| self.wakes_node(n, from, old_ns, new_ns)).map(|n| n.role)
    }

    fn wakes_node(&self, node: &Node, from: Role, old_ns: u64, new_ns: u64) -> bool {
        let by_edge = self
            .edges
            .iter()
            .any(|e| e.from == from && e.to == node.role && e.unblocks(node.rate, old_ns, new_ns));
        by_edge || node.is_paced_by(from, old_ns, new_ns)
    }

    fn refuse_zero_latency_loops(&self) -> Result<(), GraphError> {
        // Strict edges only look backwards, so they break a loop even at latency 0.
        let mut order: Vec<Role> = Vec::new();
        loop {
            let next = self.nodes.iter().map(|n| n.role).find(|&role| {
                !order.contains(&role)
                    && self.edges.iter().all(|e| {
                        e.to != role || e.strict || e.latency_ns > 0 || order.contains(&e.from)
                    })
            });
            match next {
                Some(role) => order.push(role),
                None if order.len() == self.nodes.len() => return Ok(()),
                None => return Err(GraphError::ZeroLatencyLoop(self.name_loop(&order))),
            }
        }
    }

    /// Follows undelayed arrows upstream among the roles that `ordered` leaves out until one comes
    /// again, and names that loop in the direction of the data.
    fn name_loop(&self, ordered: &[Role]) -> String {
        let mut path: Vec<Role> = Vec::new();
        let mut next = self.nodes.iter().map(|n| n.role).find(|role| !ordered.contains(role));
        while let Some(role) = next {
            if let Some(start) = path.iter().position(|&r| r == role) {
                path.drain(..start);
                break;
            }
            path.push(role);
            next = self
                .edges
                .iter()
                .find(|e| {
                    e.to == role && !e.strict && e.latency_ns == 0 && !ordered.contains(&e.from)
                })
                .map(|e| e.from);
        }
        path.reverse();
        path.extend(path.first().copied());
        path.iter().map(|r| r.label()).collect::<Vec<_>>().join(" -> ")
    }
}
