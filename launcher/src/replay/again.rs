//! One component flies again: every life of its process, on the inputs that it had.

use super::ReplayError;
use super::course::Course;
use super::source::{Exceptions, TapeSource};
use super::tapes::{Recorded, Tapes};
use crate::components::{Component, ComponentVisitor, Crew};
use crate::record::read::{RecordedFlight, RecordedState};
use crate::scenario::Scenario;
use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use runtime::executor::StepStamps;
use runtime::graph::Edge;
use runtime::input::{Input, InputSet as _, InputVisitor};
use runtime::output::{Output, OutputSet as _, OutputVisitor};
use runtime::service::StateHeader;
use runtime::{Executor, Graph, Node, Place, Service, Sink, StateSink};
use shared_types::wire::Value as _;
use shared_types::{Deviation, DeviationKind, Header, Role, Sample, Topic, topics};
use std::rc::Rc;

/// What a component did the second time.
#[derive(Debug, Default)]
pub(super) struct Replayed {
    pub(super) tapes: Tapes,
    pub(super) states: Vec<RecordedState>,
    /// Steps run.
    pub(super) steps: u64,
}

/// One life of a process, from its start or restart to its death or the end of the recording.
struct Life {
    generation: u32,
    /// Release of the state it went on from.
    resumed_from: Option<u64>,
    /// Last step that left a trace \[ns\].
    last_ns: u64,
    deviations: Vec<Deviation>,
    /// Sequence of the last totals published.
    last_stats: u64,
}

/// Topics that a component reads and writes.
pub(super) struct Topics {
    pub(super) read: Vec<&'static str>,
    pub(super) written: Vec<&'static str>,
}

impl Topics {
    /// Of the component with which `crew` fills `role` in `scenario`.
    pub(super) fn of(crew: &Crew, role: Role, scenario: &Scenario) -> Result<Self, ReplayError> {
        struct Names;
        struct Collect(Vec<&'static str>);
        impl InputVisitor for Collect {
            type Error = Infallible;
            fn visit<T: Sample>(
                &mut self,
                topic: &'static Topic<T>,
                _input: &mut Input<T>,
            ) -> Result<(), Infallible> {
                self.0.push(topic.info.name);
                Ok(())
            }
        }
        impl OutputVisitor for Collect {
            type Error = Infallible;
            fn visit<T: Sample>(
                &mut self,
                topic: &'static Topic<T>,
                _output: &mut Output<T>,
            ) -> Result<(), Infallible> {
                self.0.push(topic.info.name);
                Ok(())
            }
        }
        impl ComponentVisitor for Names {
            type Output = Topics;
            fn visit<S: Service + 'static>(self, _component: Component<S>) -> Topics {
                let (mut read, mut written) = (Collect(Vec::new()), Collect(Vec::new()));
                let Ok(()) = S::Inputs::default().visit(&mut read);
                let Ok(()) = S::Outputs::default().visit(&mut written);
                Topics { read: read.0, written: written.0 }
            }
        }
        crew.build(role, scenario, Names).map_err(ReplayError::component(role))
    }
}

/// Flies the component with which `crew` fills `role` in `scenario` on what was recorded for the role;
/// the loop itself stays as it was in `flight`.
pub(super) fn fly_again(
    flight: &RecordedFlight,
    crew: &Crew,
    role: Role,
    scenario: &Scenario,
    recorded: &Recorded,
) -> Result<Replayed, ReplayError> {
    let graph =
        flight.scenario().graph().map_err(|error| ReplayError::Wiring(error.to_string()))?;
    let node = *graph.node(role).ok_or(ReplayError::NotFlown { role: role.label() })?;
    let out = Rc::new(RefCell::new(Replayed::default()));
    for life in lives(recorded) {
        let again = Again { graph: &graph, node, recorded, life, out: Rc::clone(&out) };
        crew.build(role, scenario, again).map_err(ReplayError::component(role))??;
    }
    Ok(out.take())
}

/// The lives of a process by what each has left in the recording.
fn lives(recorded: &Recorded) -> Vec<Life> {
    let deviations = recorded.tapes.of(&topics::DEVIATION);
    let stats = recorded.tapes.of(&topics::LOOP_STATS);
    let life = |(&generation, &last_ns): (&u32, &u64)| {
        let deviations: Vec<Deviation> =
            deviations.iter().filter(|d| d.header.generation == generation).copied().collect();
        let resumed = deviations.iter().find(|d| d.kind == DeviationKind::Resumed);
        let of_life = stats
            .iter()
            .filter(|s| s.header.generation == generation && s.header.release_ns <= last_ns);
        Life {
            generation,
            resumed_from: resumed.map(|d| d.first),
            last_ns,
            last_stats: of_life.map(|s| s.header.sequence).max().unwrap_or(0),
            deviations,
        }
    };
    recorded.traces.iter().map(life).collect()
}

/// Flies one life of whatever component it is given.
struct Again<'a> {
    graph: &'a Graph,
    node: Node,
    recorded: &'a Recorded,
    life: Life,
    out: Rc<RefCell<Replayed>>,
}

impl ComponentVisitor for Again<'_> {
    type Output = Result<(), ReplayError>;
    fn visit<S: Service + 'static>(self, component: Component<S>) -> Self::Output {
        let Self { graph, node, recorded, life, out } = self;
        let place = Place { seat: 0, generation: life.generation };
        let mut executor = Executor::new(component.service, node, place, component.state_every);
        let now_ns = Rc::new(Cell::new(0));
        let mut latched = LatchedSequences(Vec::new());
        if let Some(state) = last_state(recorded, &life) {
            let mut inputs = S::Inputs::default();
            if let Some(latches) = latches_of::<S>(&state.bytes) {
                inputs.unpack_latches(latches);
                let Ok(()) = inputs.visit(&mut latched);
            }
        }
        let mut connect = Connect {
            graph,
            role: node.role,
            recorded,
            life: &life,
            latched: latched.0.into_iter(),
            now_ns: Rc::clone(&now_ns),
            out: Rc::clone(&out),
        };
        let Ok(()) = executor.inputs.visit(&mut connect);
        let Ok(()) = executor.outputs.visit(&mut connect);
        let Ok(()) = OutputVisitor::visit(&mut connect, &topics::LOOP_STATS, &mut executor.stats);
        let Ok(()) =
            OutputVisitor::visit(&mut connect, &topics::DEVIATION, &mut executor.deviations);
        executor.connect_state(Box::new(States(Rc::clone(&out))));
        if let Some(release) = life.resumed_from {
            let state = handed_over(recorded, &life, release)
                .ok_or(ReplayError::NoState { role: node.role.label(), release })?;
            executor
                .restore(&state.bytes)
                .map_err(|error| ReplayError::Restore { role: node.role.label(), error })?;
        }
        fly(&mut executor, &Course::new(node.rate, &life.deviations), &life, &now_ns);
        out.borrow_mut().steps += executor.steps() - executor_start(&life, recorded);
        Ok(())
    }
}

/// Runs the steps of a life at the instants at which they ran.
fn fly<S: Service>(executor: &mut Executor<S>, course: &Course, life: &Life, now_ns: &Cell<u64>) {
    course.prepare(executor);
    while executor.mark_ns() <= life.last_ns {
        now_ns.set(executor.mark_ns());
        executor.inputs.receive();
        executor.run_step(StepStamps { release_mono_ns: 0, now_mono_ns: || 0 });
        course.prepare(executor);
    }
    // Whoever left in order has published its totals once more.
    if executor.stats.sequence() < life.last_stats {
        executor.finish();
    }
}

/// The state that the supervisor handed over: the last one of the predecessor.
fn handed_over<'a>(recorded: &'a Recorded, life: &Life, release: u64) -> Option<&'a RecordedState> {
    recorded.states.iter().rev().find(|state| {
        state.header.generation < life.generation && state_header(state).release_index == release
    })
}

/// Steps that a life counts from.
fn executor_start(life: &Life, recorded: &Recorded) -> u64 {
    let state = life.resumed_from.and_then(|release| handed_over(recorded, life, release));
    state.map_or(0, |state| state_header(state).steps)
}

fn state_header(state: &RecordedState) -> StateHeader {
    state
        .bytes
        .get(..StateHeader::PACKED_SIZE)
        .map_or_else(StateHeader::default, StateHeader::unpack)
}

/// Connects every port of a component with the recording.
struct Connect<'a> {
    graph: &'a Graph,
    role: Role,
    recorded: &'a Recorded,
    life: &'a Life,
    /// Of each input in turn: what the last state of the life had in effect.
    latched: std::vec::IntoIter<u64>,
    now_ns: Rc<Cell<u64>>,
    out: Rc<RefCell<Replayed>>,
}

impl InputVisitor for Connect<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let edge = self.graph.edge(&topic.info, self.role).copied();
        let edge = edge.unwrap_or_else(|| Edge::unwaited(&topic.info, self.role));
        let mut exceptions = Exceptions::of(topic.info.name, self.life.deviations.iter());
        if let Some(last) = self.latched.next() {
            exceptions = exceptions.killed_after(last);
        }
        let samples = self.recorded.tapes.of(topic);
        let now_ns = Rc::clone(&self.now_ns);
        let source = TapeSource::new(samples, edge, exceptions, now_ns);
        input.connect(Box::new(source), Some(edge));
        Ok(())
    }
}

impl OutputVisitor for Connect<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        let sink = TapeSink { topic, out: Rc::clone(&self.out) };
        output.connect(Box::new(sink), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}

/// Collects the sequence that each input has in effect.
struct LatchedSequences(Vec<u64>);

impl InputVisitor for LatchedSequences {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        _topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        self.0.push(input.latest().map_or(0, |sample| sample.header().sequence));
        Ok(())
    }
}

/// The state in which a life was last seen, if it is as far as it is replayed.
fn last_state<'a>(recorded: &'a Recorded, life: &Life) -> Option<&'a RecordedState> {
    recorded.states.iter().rev().find(|state| {
        state.header.generation == life.generation && state.header.release_ns == life.last_ns
    })
}

/// The part of a packed state that holds the latches; none if it is not a whole state.
fn latches_of<S: Service>(state: &[u8]) -> Option<&[u8]> {
    let start = StateHeader::PACKED_SIZE + 8 * S::Outputs::COUNT;
    state.get(start..start + S::Inputs::LATCH_SIZE)
}

struct TapeSink<T: Sample> {
    topic: &'static Topic<T>,
    out: Rc<RefCell<Replayed>>,
}

impl<T: Sample> Sink<T> for TapeSink<T> {
    fn send(&mut self, sample: T) {
        self.out.borrow_mut().tapes.push(self.topic, sample);
    }
    fn serve_late_joiners(&mut self) {}
}

struct States(Rc<RefCell<Replayed>>);

impl StateSink for States {
    fn send(&mut self, header: &Header, state: &[u8]) {
        let state = RecordedState { header: *header, bytes: state.to_vec() };
        self.0.borrow_mut().states.push(state);
    }
    fn serve_late_joiners(&mut self) {}
}
