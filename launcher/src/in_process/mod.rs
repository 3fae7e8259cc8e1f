//! A whole flight in one thread: the components of the processes, behind queues instead of shared
//! memory, with the same executor, the same graph and the same bytes.
//!
//! [`InProcess`] is for studies, tests and benches; nothing in it touches the machine, so flights
//! may fly side by side on threads. Open `wires.rs` for the queues and `perfect_state.rs` for the
//! only component that a real run does not have.

mod perfect_state;
mod wires;

pub use perfect_state::PerfectState;

use crate::components::{self, Component, ComponentVisitor};
use crate::run::{FlightHash, Metrics};
use crate::scenario::{Scenario, WiringError};
use core::cell::{Cell, RefCell};
use runtime::executor::{StateSink, StepStamps};
use runtime::graph::{CREDIT_NS, Marks, ROLES};
use runtime::input::InputSet as _;
use runtime::{Executor, Graph, Node, Service};
use shared_types::{Header, Role, Sample, Topic};
use std::rc::Rc;
use thiserror::Error;
use wires::Wires;

/// Who tells the controllers where the vehicle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StateSource {
    /// The estimator, as in a run.
    Estimator,
    /// The plant itself: what the control loops do without estimation errors. For rigs and studies.
    Truth,
}

/// Sees every sample of a flight, in the order published.
pub trait Observer: 'static {
    /// Called once per sample. Allocations made here are the observer's own.
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T);
}

impl Observer for () {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, _sample: &T) {}
}

impl Observer for FlightHash {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.add(&topic.info, sample);
    }
}

impl Observer for Metrics {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        Self::observe(self, topic, sample);
    }
}

impl<A: Observer, B: Observer> Observer for (A, B) {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.0.observe(topic, sample);
        self.1.observe(topic, sample);
    }
}

/// Why a flight cannot be flown to its end.
#[derive(Debug, Error)]
pub enum InProcessError {
    /// The loops cannot be wired.
    #[error(transparent)]
    Wiring(#[from] WiringError),
    /// A component refuses its configuration.
    #[error("{role}: {error}")]
    Component {
        /// Label of the role it fills.
        role: &'static str,
        /// Its complaint.
        error: String,
    },
    /// No step may run although the flight is not over: the graph is wrong.
    #[error("the flight hangs at {t_s} s: no loop may step, {role} is the furthest behind")]
    Stuck {
        /// Mark of the slowest loop \[s\].
        t_s: f64,
        /// Its label.
        role: &'static str,
    },
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
    fn send(&mut self, _header: &Header, _state: &[u8]) {
        self.0.set(self.0.get() + 1);
    }
    fn serve_late_joiners(&mut self) {}
}

/// Connects whatever component it is given.
struct Connect<'a, O> {
    graph: &'a Graph,
    node: Node,
    wires: &'a mut Wires<O>,
}

impl<O: Observer> ComponentVisitor for Connect<'_, O> {
    type Output = Loop;
    fn visit<S: Service + 'static>(self, component: Component<S>) -> Loop {
        let mut executor = Executor::new(component.service, self.node, 0, component.state_every);
        self.wires.connect(self.graph, &mut executor);
        let states = Rc::new(Cell::new(0));
        executor.connect_state(Box::new(StateCounter(Rc::clone(&states))));
        Loop { node: self.node, stepper: Box::new(executor), states, steps: 0 }
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
pub struct InProcess<O> {
    graph: Graph,
    loops: Vec<Loop>,
    observer: Rc<RefCell<O>>,
    marks: Marks,
    end_ns: u64,
}

impl<O> core::fmt::Debug for InProcess<O> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("InProcess").field("marks", &self.marks).finish_non_exhaustive()
    }
}

impl<O: Observer> InProcess<O> {
    /// A flight of `scenario` before its first step.
    ///
    /// # Errors
    /// A component that refuses its part of the scenario, or loops that cannot be wired.
    pub fn new(
        scenario: &Scenario,
        state: StateSource,
        observer: O,
    ) -> Result<Self, InProcessError> {
        let graph = scenario.graph()?;
        let observer = Rc::new(RefCell::new(observer));
        let mut wires = Wires::new(Rc::clone(&observer));
        let mut loops = Vec::new();
        for &node in graph.nodes() {
            let connect = Connect { graph: &graph, node, wires: &mut wires };
            loops.push(match (state, node.role) {
                (StateSource::Truth, Role::Estimator) => connect.visit(PerfectState::component()),
                (_, role) => components::build(role, scenario, connect).map_err(|error| {
                    InProcessError::Component { role: role.label(), error: error.to_string() }
                })?,
            });
        }
        // A rig flight has no position loop: the pilot owns that slot.
        let position = graph.node(Role::Position).map_or(Role::Pilot, |node| node.role);
        wires.own(&graph, Role::Attitude, Role::Attitude);
        wires.own(&graph, Role::Position, position);
        Ok(Self { graph, loops, observer, marks: [0; ROLES], end_ns: scenario.duration_ns() })
    }

    /// Runs every release before `t_ns` and the end of the flight, the earliest first.
    ///
    /// # Errors
    /// No step may run although the flight is not over.
    pub fn fly_until(&mut self, t_ns: u64) -> Result<(), InProcessError> {
        while let Some(earliest) = self.runnable(t_ns).min_by_key(|&l| self.mark_ns(l)) {
            self.step(earliest);
        }
        let slowest = self.loops.iter().min_by_key(|l| l.stepper.mark_ns());
        let behind = slowest.filter(|l| l.stepper.mark_ns() < t_ns.min(self.end_ns));
        behind.map_or(Ok(()), |l| {
            let t_s = l.stepper.mark_ns() as f64 * 1e-9;
            Err(InProcessError::Stuck { t_s, role: l.node.role.label() })
        })
    }

    /// Loops whose next step may run and lies before `t_ns` and the end of the flight. In whatever
    /// order they are stepped, the flight is the same.
    pub fn runnable(&self, t_ns: u64) -> impl Iterator<Item = usize> + '_ {
        let slowest_ns = self.loops.iter().map(|l| l.stepper.mark_ns()).min().unwrap_or(0);
        let allowed_ns = slowest_ns.saturating_add(CREDIT_NS).min(self.end_ns).min(t_ns);
        (0..self.loops.len()).filter(move |&index| {
            let node = &self.loops[index].node;
            self.graph.runnable(node, self.mark_ns(index), &self.marks, allowed_ns)
        })
    }

    /// Runs the next release of a loop that [`runnable`](Self::runnable) named.
    pub fn step(&mut self, index: usize) {
        let one = &mut self.loops[index];
        one.stepper.step();
        one.steps += 1;
        self.marks[one.node.role.index()] = one.stepper.mark_ns();
    }

    /// Next release of a loop \[ns\].
    #[must_use]
    pub fn mark_ns(&self, index: usize) -> u64 {
        self.loops[index].stepper.mark_ns()
    }

    /// Role of a loop.
    #[must_use]
    pub fn role(&self, index: usize) -> Role {
        self.loops[index].node.role
    }

    /// Role, steps and published states of every loop so far.
    pub fn progress(&self) -> impl Iterator<Item = (Role, u64, u64)> + '_ {
        self.loops.iter().map(|l| (l.node.role, l.steps, l.states.get()))
    }

    /// What the observer has seen so far.
    pub fn seen<R>(&self, look: impl FnOnce(&mut O) -> R) -> R {
        look(&mut self.observer.borrow_mut())
    }
}

/// Flies a scenario to its end and gives what `observer` made of it.
///
/// # Errors
/// See [`InProcess::new`] and [`InProcess::fly_until`].
pub fn fly<O: Observer + Default>(
    scenario: &Scenario,
    state: StateSource,
    observer: O,
) -> Result<O, InProcessError> {
    let mut flight = InProcess::new(scenario, state, observer)?;
    flight.fly_until(u64::MAX)?;
    Ok(flight.seen(core::mem::take))
}
