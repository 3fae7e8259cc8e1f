//! A whole flight in one thread: the launcher's components behind queues instead of shared memory.

mod wires;

use launcher::components::{self, Component, ComponentVisitor};
use launcher::run::FlightHash;
use launcher::scenario::Scenario;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use runtime::executor::{StateSink, StepStamps};
use runtime::graph::{CREDIT_NS, Marks, ROLES};
use runtime::input::InputSet as _;
use runtime::{Executor, Graph, Node, Service};
use shared_types::{Header, Role};
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::rc::Rc;
use wires::Wires;

/// Which of the steps that may run does run.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Order {
    /// The earliest.
    Time,
    /// Any.
    Random(u64),
    /// One loop until it must wait, then the next, upstream last.
    AsFarAsPossible,
}

/// An executor with its type forgotten.
trait Stepper {
    fn mark_ns(&self) -> u64;
    fn step(&mut self);
}

impl<S: Service> Stepper for Executor<S> {
    fn mark_ns(&self) -> u64 {
        Self::mark_ns(self)
    }
    fn step(&mut self) {
        self.inputs.receive();
        self.run_step(StepStamps { release_mono_ns: 0, now_mono_ns: || 0 });
    }
}

/// Counts states and forgets them.
struct StateCounter(Rc<Cell<u64>>);

impl StateSink for StateCounter {
    fn send(&mut self, _header: &Header, state: &[u8]) {
        assert!(!state.is_empty());
        self.0.set(self.0.get() + 1);
    }
    fn serve_late_joiners(&mut self) {}
}

/// Connects whatever component it is given.
struct Connect<'a> {
    graph: &'a Graph,
    node: Node,
    wires: &'a mut Wires,
    states: Rc<Cell<u64>>,
}

impl ComponentVisitor for Connect<'_> {
    type Output = Box<dyn Stepper>;
    fn visit<S: Service + 'static>(self, component: Component<S>) -> Box<dyn Stepper> {
        let Component { service, state_every } = component;
        let mut executor = Executor::new(service, self.node, 0, state_every);
        self.wires.connect(self.graph, &mut executor);
        executor.connect_state(Box::new(StateCounter(self.states)));
        Box::new(executor)
    }
}

/// One loop of the flight.
struct Loop {
    node: Node,
    stepper: Box<dyn Stepper>,
    states: Rc<Cell<u64>>,
    steps: u64,
}

/// A flight in progress.
pub(crate) struct Cockpit {
    graph: Graph,
    loops: Vec<Loop>,
    wires: Wires,
    marks: Marks,
    end_ns: u64,
}

impl Cockpit {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let graph = scenario.graph().expect("a loaded scenario has a graph");
        let mut wires = Wires::new(Rc::new(RefCell::new(FlightHash::default())));
        let loops = graph.nodes().iter().map(|&node| {
            let states = Rc::new(Cell::new(0));
            let visitor =
                Connect { graph: &graph, node, wires: &mut wires, states: Rc::clone(&states) };
            let stepper = components::build(node.role, scenario, visitor);
            Loop { node, stepper: stepper.expect("a valid component"), states, steps: 0 }
        });
        let loops = loops.collect();
        let position = graph.node(Role::Position).map_or(Role::Pilot, |node| node.role);
        wires.own(&graph, Role::Attitude, Role::Attitude);
        wires.own(&graph, Role::Position, position);
        Self { graph, loops, wires, marks: [0; ROLES], end_ns: scenario.duration_ns() }
    }

    /// Runs every release before `t_ns` and the end of the flight; allocations made in the steps of
    /// each role.
    pub(crate) fn fly_until(&mut self, t_ns: u64, order: Order) -> BTreeMap<&'static str, u64> {
        let end_ns = t_ns.min(self.end_ns);
        let mut allocations: BTreeMap<_, u64> =
            self.loops.iter().map(|l| (l.node.role.label(), 0)).collect();
        let mut rng =
            ChaCha8Rng::seed_from_u64(if let Order::Random(seed) = order { seed } else { 0 });
        let mut last = 0;
        loop {
            let runnable = self.runnable(end_ns);
            let Some(&first) = runnable.first() else { break };
            let chosen = match order {
                Order::Time => {
                    runnable.into_iter().min_by_key(|&i| self.loops[i].stepper.mark_ns())
                }
                Order::Random(_) => Some(runnable[rng.random_range(0..runnable.len())]),
                Order::AsFarAsPossible if runnable.contains(&last) => Some(last),
                Order::AsFarAsPossible => runnable.last().copied(),
            };
            last = chosen.unwrap_or(first);
            let chosen = &mut self.loops[last];
            let measured = allocation_counter::measure(|| chosen.stepper.step());
            chosen.steps += 1;
            self.marks[chosen.node.role.index()] = chosen.stepper.mark_ns();
            *allocations.entry(chosen.node.role.label()).or_default() += measured.count_total;
        }
        let unfinished = self.loops.iter().find(|l| l.stepper.mark_ns() < end_ns);
        assert!(unfinished.is_none(), "the flight hangs");
        allocations
    }

    /// Loops whose next step may run.
    fn runnable(&self, end_ns: u64) -> Vec<usize> {
        let slowest_ns = self.loops.iter().map(|l| l.stepper.mark_ns()).min().unwrap_or(0);
        let allowed_ns = slowest_ns.saturating_add(CREDIT_NS).min(end_ns);
        let may_run =
            |l: &Loop| self.graph.runnable(&l.node, l.stepper.mark_ns(), &self.marks, allowed_ns);
        (0..self.loops.len()).filter(|&index| may_run(&self.loops[index])).collect()
    }

    /// Steps of all loops so far.
    pub(crate) fn steps(&self) -> u64 {
        self.loops.iter().map(|l| l.steps).sum()
    }

    /// States published so far, by role.
    pub(crate) fn states(&self) -> BTreeMap<&'static str, u64> {
        self.loops.iter().map(|l| (l.node.role.label(), l.states.get())).collect()
    }

    /// Flight hash so far.
    pub(crate) fn hash(&self) -> String {
        self.wires.hash()
    }

    /// Positions sent on a topic so far.
    pub(crate) fn positions(&self, topic: &str) -> Vec<[f64; 3]> {
        self.wires.positions(topic)
    }
}
