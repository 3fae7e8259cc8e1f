//! Where a flight is taken up in the middle: states of every component, and what was on its way between them.

use super::marks::FlightMarks;
use super::tape::Tape;
use core::convert::Infallible;
use runtime::graph::{Edge, ROLES};
use runtime::input::{Input, InputVisitor};
use runtime::{Component, Graph, MarkView as _, StateHeader};
use shared_types::{Role, Sample, Topic};
use std::sync::Arc;

/// Where and from what a flight is taken up.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    pub(super) tape: Arc<Tape>,
    /// Everything released before is done \[ns\].
    pub(super) at_ns: u64,
    /// Of each role, by [`Role::index`]; none if it has not stepped yet.
    pub(super) states: [Option<Vec<u8>>; ROLES],
    /// The states are those of `at_ns`, not of the keyframes before it.
    pub(super) exact: bool,
    /// What each role reads and writes, if the states are exact.
    pub(super) ports: [Option<u64>; ROLES],
}

impl Checkpoint {
    /// The last states on `tape` before `at_ns`. A flight that goes on from here repeats what lies
    /// between them and `at_ns`.
    #[must_use]
    pub fn before(tape: Arc<Tape>, at_ns: u64) -> Self {
        let mut states = [const { None }; ROLES];
        for role in Role::STEPPING {
            states[role.index()] = tape.last_state_before(role, at_ns).map(<[u8]>::to_vec);
        }
        Self { tape, at_ns, states, exact: false, ports: [None; ROLES] }
    }

    /// The instant \[ns\].
    #[must_use]
    pub fn at_ns(&self) -> u64 {
        self.at_ns
    }

    /// What was published until then, and perhaps after.
    #[must_use]
    pub fn tape(&self) -> &Arc<Tape> {
        &self.tape
    }

    /// How many times the process of a role had been restarted.
    pub(super) fn generation(&self, role: Role) -> u32 {
        self.tape.generation_at(role, self.at_ns)
    }

    pub(super) fn state(&self, role: Role) -> Option<&[u8]> {
        self.states.get(role.index())?.as_deref()
    }

    /// State from which a component takes over, if the state of `role` is of another kind with the same
    /// ports: sequences and latches of the predecessor, the memory of the component as it is.
    pub(super) fn taken_over(&self, role: Role, component: &Component) -> Option<Vec<u8>> {
        let state = self.state(role)?;
        let same_ports = *self.ports.get(role.index())? == Some(component.layout().ports_hash());
        let same_kind = StateHeader::has_layout(state, component.layout().hash());
        (same_ports && !same_kind).then(|| component.succeeding(state)).flatten()
    }

    /// The instant at which every loop goes on, if the states are exactly of it \[ns\].
    pub(super) fn exact_ns(&self) -> Option<u64> {
        self.exact.then_some(self.at_ns)
    }
}

/// Gives the inputs of one loop what its producers will not produce again.
pub(super) struct Feed<'a> {
    pub(super) tape: &'a Tape,
    pub(super) graph: &'a Graph,
    pub(super) marks: &'a FlightMarks,
    pub(super) role: Role,
    pub(super) at_ns: u64,
}

impl InputVisitor for Feed<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let edge = self.graph.edge(&topic.info, self.role).copied();
        let from = edge.unwrap_or_else(|| Edge::unwaited(&topic.info, self.role)).from;
        // What does not step, the supervisor, produces nothing any more.
        let before_ns = if from.is_stepping() {
            self.at_ns.min(self.marks.of_role(from))
        } else {
            self.at_ns.saturating_add(1)
        };
        let latched = input.latest().map_or(0, |sample| sample.header().sequence);
        for sample in self.tape.waiting(topic, latched, before_ns) {
            input.offer(*sample);
        }
        Ok(())
    }
}
