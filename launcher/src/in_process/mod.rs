//! A whole flight in one thread: the components of the processes, behind queues instead of shared
//! memory, with the same executor, the same graph and the same bytes.
//!
//! [`InProcess`] is behind `run --in-process`, campaigns, branches and studies; nothing in it touches
//! the machine, so flights may fly side by side on threads. Open `wires.rs` for the queues, `resume.rs`
//! for a flight taken up in the middle and `perfect_state.rs` for the only component that a real run
//! does not have.

mod compare;
mod observer;
mod perfect_state;
mod resume;
mod tape;
mod wires;

pub use compare::{Compare, Difference, Likeness};
pub use observer::Observer;
pub use perfect_state::PerfectState;
pub use resume::Checkpoint;
pub use tape::Tape;

use crate::components::{Component, ComponentVisitor, Crew};
use crate::replay::{Course, Repeats};
use crate::scenario::{Scenario, WiringError};
use core::cell::RefCell;
use resume::Feed;
use runtime::executor::{StateSink, StepStamps};
use runtime::graph::{CREDIT_NS, Marks, ROLES};
use runtime::input::InputSet as _;
use runtime::service::RestoreError;
use runtime::{Executor, Graph, Node, Place, Service};
use shared_types::{Header, Role};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
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

/// Why a flight cannot be flown to its end.
#[derive(Debug, Error)]
pub enum InProcessError {
    /// There are no processes to swap, kill or stop.
    #[error("swaps and faults of a script need processes: leave [[swap]] and [[fault]] away here")]
    Scripted,
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
    /// A component cannot go on from a state.
    #[error("{role} refuses to go on from the recorded state: {error}")]
    Restore {
        /// Label of the role.
        role: &'static str,
        /// Its complaint.
        error: RestoreError,
    },
    /// No step may run although the flight is not over: the graph is wrong.
    #[error("the flight hangs at {t_s} s: no loop may step, {role} is the furthest behind")]
    Stuck {
        /// Mark of the slowest loop \[s\].
        t_s: f64,
        /// Its label.
        role: &'static str,
    },
    /// A step panicked, which is a defect of its component.
    #[error("{role} panicked at {t_s} s: {words}")]
    Panicked {
        /// Label of the role.
        role: &'static str,
        /// Release of the step \[s\].
        t_s: f64,
        /// What it said.
        words: String,
    },
}

/// A clock for the stamps of samples that nobody will read.
fn no_clock() -> u64 {
    0
}

/// An executor with its type forgotten.
trait Stepper: Repeats {
    fn step(&mut self, now_mono_ns: fn() -> u64);
    fn finish(&mut self);
    fn state(&mut self) -> Option<Vec<u8>>;
    fn reseed(&mut self, seed: u64);
    fn feed(&mut self, feed: &mut Feed<'_>);
}

impl<S: Service> Stepper for Executor<S> {
    fn step(&mut self, now_mono_ns: fn() -> u64) {
        self.inputs.receive();
        self.run_step(StepStamps { release_mono_ns: now_mono_ns(), now_mono_ns });
    }
    fn finish(&mut self) {
        Self::finish(self);
    }
    fn state(&mut self) -> Option<Vec<u8>> {
        Self::state(self).map(<[u8]>::to_vec)
    }
    fn reseed(&mut self, seed: u64) {
        Self::reseed(self, seed);
    }
    fn feed(&mut self, feed: &mut Feed<'_>) {
        let Ok(()) = self.inputs.visit(feed);
    }
}

/// Shows states to the observer.
struct StateTap<O> {
    role: Role,
    observer: Rc<RefCell<O>>,
}

impl<O: Observer> StateSink for StateTap<O> {
    fn send(&mut self, header: &Header, state: &[u8]) {
        self.observer.borrow_mut().observe_state(self.role, header, state);
    }
    fn serve_late_joiners(&mut self) {}
}

/// Connects whatever component it is given.
struct Connect<'a, O> {
    graph: &'a Graph,
    node: Node,
    wires: &'a mut Wires<O>,
    from: Option<&'a Checkpoint>,
}

impl<O: Observer> ComponentVisitor for Connect<'_, O> {
    type Output = Result<Loop, InProcessError>;
    fn visit<S: Service + 'static>(self, component: Component<S>) -> Self::Output {
        let generation = self.from.map_or(0, |checkpoint| checkpoint.generation(self.node.role));
        let place = Place { seat: 0, generation };
        let mut executor =
            Executor::new(component.service, self.node, place, component.state_every);
        self.wires.connect(self.graph, &mut executor);
        let observer = self.wires.observer();
        if observer.borrow().wants_states() {
            executor.connect_state(Box::new(StateTap { role: self.node.role, observer }));
        }
        if let Some(checkpoint) = self.from {
            let role = self.node.role;
            let restored = checkpoint.state(role).map_or(Ok(()), |state| executor.take_up(state));
            restored.map_err(|error| InProcessError::Restore { role: role.label(), error })?;
            if let Some(at_ns) = checkpoint.exact_ns() {
                executor.continue_at(at_ns);
            }
        }
        Ok(Loop { node: self.node, stepper: Box::new(executor), course: Course::default() })
    }
}

/// One loop of the flight.
struct Loop {
    node: Node,
    stepper: Box<dyn Stepper>,
    /// What it goes through again; nothing in a flight of its own.
    course: Course,
}

/// A flight in progress.
pub struct InProcess<O> {
    graph: Graph,
    loops: Vec<Loop>,
    observer: Rc<RefCell<O>>,
    marks: Marks,
    end_ns: u64,
    now_mono_ns: fn() -> u64,
    /// The loop that is being stepped.
    stepping: usize,
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
        if scenario.settings().is_scripted() {
            return Err(InProcessError::Scripted);
        }
        Self::build(scenario, Crew::default(), state, observer, None)
    }

    fn build(
        scenario: &Scenario,
        crew: Crew,
        state: StateSource,
        observer: O,
        from: Option<&Checkpoint>,
    ) -> Result<Self, InProcessError> {
        let graph = scenario.graph()?;
        let observer = Rc::new(RefCell::new(observer));
        let mut wires = Wires::new(Rc::clone(&observer));
        let mut loops = Vec::new();
        for &node in graph.nodes() {
            let connect = Connect { graph: &graph, node, wires: &mut wires, from };
            loops.push(match (state, node.role) {
                (StateSource::Truth, Role::Estimator) => connect.visit(PerfectState::component()),
                (_, role) => crew.build(role, scenario, connect).map_err(|error| {
                    InProcessError::Component { role: role.label(), error: error.to_string() }
                })?,
            }?);
        }
        if from.is_none() {
            wires.own(&graph, Role::Attitude);
            wires.own(&graph, Role::Position);
        }
        Ok(Self {
            graph,
            loops,
            observer,
            marks: [0; ROLES],
            end_ns: scenario.duration_ns(),
            now_mono_ns: no_clock,
            stepping: 0,
        })
    }

    /// Stamps samples by this clock from now on \[ns\]; without it all host stamps are 0.
    pub fn stamp_by(&mut self, now_mono_ns: fn() -> u64) {
        self.now_mono_ns = now_mono_ns;
    }

    /// Runs every release before `t_ns` and the end of the flight: each loop in turn as far as the
    /// others permit, as processes do.
    ///
    /// # Errors
    /// No step may run although the flight is not over, or a step panicked.
    pub fn fly_until(&mut self, t_ns: u64) -> Result<(), InProcessError> {
        // What a panic leaves behind is looked at, and never stepped again.
        let flown = catch_unwind(AssertUnwindSafe(|| while self.fly_interval(t_ns) {}));
        if let Err(panic) = flown {
            let l = &self.loops[self.stepping];
            let t_s = l.stepper.next_ns() as f64 / 1e9;
            let words = words(panic.as_ref());
            return Err(InProcessError::Panicked { role: l.node.role.label(), t_s, words });
        }
        let slowest = self.loops.iter().min_by_key(|l| l.stepper.next_ns());
        let behind = slowest.filter(|l| l.stepper.next_ns() < t_ns.min(self.end_ns));
        behind.map_or(Ok(()), |l| {
            let t_s = l.stepper.next_ns() as f64 / 1e9;
            Err(InProcessError::Stuck { t_s, role: l.node.role.label() })
        })
    }

    /// Runs each loop as far as it may go now; false if nobody may.
    fn fly_interval(&mut self, t_ns: u64) -> bool {
        let allowed_ns = self.allowed_ns(t_ns);
        let mut moved = false;
        for index in 0..self.loops.len() {
            let node = &self.loops[index].node;
            let open_until_ns = self.graph.open_until_ns(node, &self.marks, allowed_ns);
            while self.mark_ns(index) < open_until_ns {
                self.step(index);
                moved = true;
            }
        }
        moved
    }

    fn allowed_ns(&self, t_ns: u64) -> u64 {
        let slowest_ns = self.loops.iter().map(|l| l.stepper.next_ns()).min().unwrap_or(0);
        slowest_ns.saturating_add(CREDIT_NS).min(self.end_ns).min(t_ns)
    }

    /// Publishes the totals of every loop: the last samples of a flight.
    pub fn finish(&mut self) {
        for one in &mut self.loops {
            one.stepper.finish();
        }
    }

    /// Loops whose next step may run and lies before `t_ns` and the end of the flight. In whatever
    /// order they are stepped, the flight is the same.
    pub fn runnable(&self, t_ns: u64) -> impl Iterator<Item = usize> + '_ {
        let allowed_ns = self.allowed_ns(t_ns);
        (0..self.loops.len()).filter(move |&index| {
            let node = &self.loops[index].node;
            self.graph.runnable(node, self.mark_ns(index), &self.marks, allowed_ns)
        })
    }

    /// Runs the next release of a loop that [`runnable`](Self::runnable) named.
    pub fn step(&mut self, index: usize) {
        self.stepping = index;
        let one = &mut self.loops[index];
        one.stepper.step(self.now_mono_ns);
        one.course.prepare(&mut *one.stepper);
        self.marks[one.node.role.index()] = one.stepper.next_ns();
    }

    /// Next release of a loop \[ns\].
    #[must_use]
    pub fn mark_ns(&self, index: usize) -> u64 {
        self.loops[index].stepper.next_ns()
    }

    /// Next release of each loop \[ns\].
    #[must_use]
    pub fn marks_ns(&self) -> Vec<(Role, u64)> {
        self.loops.iter().map(|l| (l.node.role, l.stepper.next_ns())).collect()
    }

    /// Role of a loop.
    #[must_use]
    pub fn role(&self, index: usize) -> Role {
        self.loops[index].node.role
    }

    /// Instant through which every loop is complete \[ns\].
    #[must_use]
    pub fn flown_ns(&self) -> u64 {
        self.loops.iter().map(|l| l.stepper.next_ns()).min().unwrap_or(0).min(self.end_ns)
    }

    /// What the observer has seen so far.
    pub fn seen<R>(&self, look: impl FnOnce(&mut O) -> R) -> R {
        look(&mut self.observer.borrow_mut())
    }
}

/// What a panic said.
fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
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
