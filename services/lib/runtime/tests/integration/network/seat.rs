//! One process of the network: an executor with its ports, which can be dropped and built again.

use super::transport::{Network, Outbox, Shared, StateKeeper, StatsSink, shared};
use core::convert::Infallible;
use runtime::{
    Component, Executor, Graph, Input, InputCounts, InputVisitor, Node, Output, OutputVisitor,
    Place, Service, StepStamps,
};
use shared_types::{Header, Role, Sample, Topic};
use std::rc::Rc;

/// A process without its type.
pub(crate) trait Seat {
    fn node(&self) -> Node;
    fn mark_ns(&self) -> u64;
    fn quiet_until_ns(&self, known_ns: u64) -> u64;
    fn receive(&mut self);
    fn step(&mut self);
    fn counts(&self) -> InputCounts;
    /// Drops the process, keeps `survivors` of its unseen publications, and starts a successor from
    /// the last state that was seen.
    fn restart(&mut self, survivors: usize);
    fn flush(&self);
    /// Makes the oldest `count` unseen publications visible.
    fn deliver(&self, count: usize);
    fn unseen(&self) -> usize;
}

pub(crate) struct Worker {
    executor: Executor,
    /// Makes a successor's component.
    build: fn(u64) -> Component,
    graph: Graph,
    network: Network,
    outbox: Outbox,
    last_state: Shared<Option<(Header, Vec<u8>)>>,
    state_every: u64,
    generation: u32,
}

impl Worker {
    pub(crate) fn new<S: Service + Default + 'static>(
        graph: &Graph,
        node: Node,
        network: &Network,
        state_every: u64,
    ) -> Self {
        let build = |state_every| Component::new(S::default(), state_every);
        let mut worker = Self {
            executor: Executor::new(build(state_every), node, Place::default()),
            build,
            graph: graph.clone(),
            network: network.clone(),
            outbox: shared(std::collections::VecDeque::new()),
            last_state: shared(None),
            state_every,
            generation: 0,
        };
        worker.connect();
        worker
    }

    fn connect(&mut self) {
        let role = self.executor.node().role;
        let mut ports =
            Ports { network: &self.network, graph: &self.graph, role, outbox: &self.outbox };
        let Ok(()) = self.executor.component.visit_inputs(&mut ports);
        let Ok(()) = self.executor.component.visit_outputs(&mut ports);
        self.executor.stats.connect(Box::new(StatsSink { log: Rc::clone(&self.network.log) }), 0);
        let (outbox, last) = (Rc::clone(&self.outbox), Rc::clone(&self.last_state));
        self.executor.connect_state(Box::new(StateKeeper { outbox, last }));
    }
}

impl Seat for Worker {
    fn node(&self) -> Node {
        *self.executor.node()
    }
    fn mark_ns(&self) -> u64 {
        self.executor.mark_ns()
    }
    fn quiet_until_ns(&self, known_ns: u64) -> u64 {
        self.executor.quiet_until_ns(known_ns)
    }
    fn receive(&mut self) {
        self.executor.component.receive();
    }
    fn step(&mut self) {
        let role = self.executor.node().role;
        let mut measure = Measure { network: &self.network, role };
        let Ok(()) = self.executor.component.visit_inputs(&mut measure);
        self.executor.run_step(StepStamps::UNTIMED);
    }
    fn counts(&self) -> InputCounts {
        self.executor.component.counts()
    }
    fn restart(&mut self, survivors: usize) {
        self.deliver(survivors);
        self.outbox.borrow_mut().clear();
        self.generation += 1;
        self.network.log.borrow_mut().restarts += 1;
        let node = *self.executor.node();
        let place = Place { seat: 0, generation: self.generation };
        self.executor = Executor::new((self.build)(self.state_every), node, place);
        self.connect();
        if let Some((_, state)) = &*self.last_state.borrow() {
            self.executor.restore(state).expect("the state of the same build fits");
        }
    }
    fn flush(&self) {
        self.deliver(usize::MAX);
    }
    fn deliver(&self, count: usize) {
        for _ in 0..count {
            let next = self.outbox.borrow_mut().pop_front();
            let Some(publication) = next else { break };
            publication();
        }
    }
    fn unseen(&self) -> usize {
        self.outbox.borrow().len()
    }
}

struct Ports<'a> {
    network: &'a Network,
    graph: &'a Graph,
    role: Role,
    outbox: &'a Outbox,
}

impl InputVisitor for Ports<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let edge = self.graph.edge(&topic.info, self.role).copied();
        input.connect(self.network.reader(topic, self.role), edge);
        Ok(())
    }
}

impl OutputVisitor for Ports<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        let latency_ns = self.graph.latency_ns(&topic.info);
        output.connect(self.network.writer(topic, self.outbox), latency_ns);
        Ok(())
    }
}

/// Notes how many samples wait just before a step takes its share.
struct Measure<'a> {
    network: &'a Network,
    role: Role,
}

impl InputVisitor for Measure<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let waiting = input.waiting() as u64 + self.network.queued(topic, self.role);
        let mut log = self.network.log.borrow_mut();
        let peak = log.peaks.entry((topic.info.name, self.role.index())).or_default();
        *peak = waiting.max(*peak);
        Ok(())
    }
}
