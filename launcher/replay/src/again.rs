//! One component flies again: every life of its process, on the inputs that it had.

use super::ReplayError;
use super::course::Course;
use super::life_key::LifeKey;
use super::lives::{Life, state_header};
use super::source::{Arrival, Exceptions, TapeSource};
use super::tapes::{Recorded, Tapes};
use components::build_service;
use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use record::read::{RecordedFlight, RecordedState};
use runtime::executor::StepStamps;
use runtime::graph::Edge;
use runtime::{
    Component, Executor, Graph, Input, InputVisitor, Layout, Node, Output, OutputVisitor, Place,
    Sink, StateSink,
};
use scenario::Scenario;
use shared_types::wire::Value as _;
use shared_types::{Header, Role, Sample, Topic, topics};
use std::rc::Rc;

/// What a component did the second time.
#[derive(Debug, Default)]
pub(super) struct Replayed {
    pub(super) tapes: Tapes,
    pub(super) states: Vec<RecordedState>,
    /// Steps run.
    pub(super) steps: u64,
}

/// Flies `service` of `scenario` through `lives` of `role`, on what was recorded for them; the loop
/// itself stays as it was in `flight`.
pub(super) fn fly_again(
    flight: &RecordedFlight,
    (role, service): (Role, &str),
    scenario: &Scenario,
    recorded: &Recorded,
    lives: &[Life],
) -> Result<Replayed, ReplayError> {
    let graph =
        flight.scenario().graph().map_err(|error| ReplayError::Wiring(error.to_string()))?;
    let node = *graph.node(role).ok_or(ReplayError::NotFlown { role: role.label() })?;
    let out = Rc::new(RefCell::new(Replayed::default()));
    for life in lives {
        let config = life.config(role);
        let own = recorded.configs.get(&config);
        let own = own.map(|text| Scenario::from_text(&config, text, &[])).transpose()?;
        let scenario = own.as_ref().unwrap_or(scenario);
        let again = Again { graph: &graph, node, recorded, life, out: Rc::clone(&out) };
        let component = build_service(service, scenario).map_err(ReplayError::component(role))?;
        again.fly(component)?;
    }
    Ok(out.take())
}

/// Flies one life of a component.
struct Again<'a> {
    graph: &'a Graph,
    node: Node,
    recorded: &'a Recorded,
    life: &'a Life,
    out: Rc<RefCell<Replayed>>,
}

impl Again<'_> {
    fn fly(self, component: Component) -> Result<(), ReplayError> {
        let Self { graph, node, recorded, life, out } = self;
        let role = node.role.label();
        let LifeKey { seat, generation } = life.key;
        let place = Place { seat, generation };
        let layout = *component.layout();
        let mut executor = Executor::new(component, node, place);
        let now_ns = Rc::new(Cell::new(0));
        let latched = last_state(recorded, life).filter(|_| !life.in_order);
        let latched = latched.map(|state| latched_in(&layout, state)).unwrap_or_default();
        let handed = life.handed_over(recorded);
        if let Some(release) = life.lacks_state(handed) {
            return Err(ReplayError::NoState { role, release });
        }
        // Another controller cannot go on from the state of the one that flew.
        let fits = |state: &&RecordedState| state_header(state).layout_hash == layout.hash();
        let restored = handed.filter(fits);
        let joined = match (handed, restored) {
            (Some(state), None) => {
                let at_ns = state_header(state).release_ns.saturating_add(1);
                let at_ns = life.joined.map_or(at_ns, |(join_ns, _)| join_ns);
                Some((
                    at_ns,
                    node.rate.release_ns(node.rate.first_at_or_after(at_ns)).saturating_add(1),
                ))
            }
            _ => life.joined,
        };
        let mut connect = Connect {
            graph,
            role: node.role,
            recorded,
            life,
            seated_ns: joined.map(|(join_ns, _)| join_ns).or(life.seated_ns),
            is_restored: restored.is_some(),
            in_flight: handed.is_some() || joined.is_some(),
            latched: latched.into_iter(),
            now_ns: Rc::clone(&now_ns),
            out: Rc::clone(&out),
        };
        let Ok(()) = executor.component.visit_inputs(&mut connect);
        let Ok(()) = executor.component.visit_outputs(&mut connect);
        let Ok(()) = OutputVisitor::visit(&mut connect, &topics::LOOP_STATS, &mut executor.stats);
        let Ok(()) =
            OutputVisitor::visit(&mut connect, &topics::DEVIATION, &mut executor.deviations);
        executor.connect_state(Box::new(States(Rc::clone(&out))));
        if let Some(state) = restored {
            executor.restore(&state.bytes).map_err(|error| ReplayError::Restore { role, error })?;
        }
        executor.take_from(&life.first_generations(graph));
        if let Some((join_ns, track_until_ns)) = joined {
            executor.join_at(join_ns, track_until_ns);
        }
        let before = executor.steps();
        fly(&mut executor, &Course::new(node.rate, &life.deviations), life, &now_ns);
        out.borrow_mut().steps += executor.steps() - before;
        Ok(())
    }
}

/// Runs the steps of a life at the instants at which they ran.
fn fly(executor: &mut Executor, course: &Course, life: &Life, now_ns: &Cell<u64>) {
    course.prepare(executor);
    while executor.mark_ns() <= life.last_ns {
        now_ns.set(executor.mark_ns());
        executor.component.receive();
        executor.run_step(StepStamps::UNTIMED);
        course.prepare(executor);
    }
    // A process that left in order has published its totals once more.
    if executor.stats.sequence() < life.last_stats {
        executor.finish();
    }
}

/// Connects every port of a component with the recording.
struct Connect<'a> {
    graph: &'a Graph,
    role: Role,
    recorded: &'a Recorded,
    life: &'a Life,
    /// When it took a seat of a flight under way \[ns\].
    seated_ns: Option<u64>,
    /// It goes on from a state.
    is_restored: bool,
    /// It did so in flight, or joined there.
    in_flight: bool,
    /// Of each input in turn: what the last state of a life that was killed had in effect.
    latched: std::vec::IntoIter<Option<Header>>,
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
        let mut exceptions = Exceptions::of(&topic.info, self.life.deviations.iter());
        if let Some(last) = self.latched.next() {
            exceptions = exceptions.killed_after(last.as_ref());
        }
        for (writer, from_ns) in self.recorded.free_seats_taken(edge.from) {
            exceptions.seated(&topic.info, writer, from_ns);
        }
        let samples = self.recorded.tapes.of(topic);
        let (blank, in_flight) = (!self.is_restored, self.in_flight);
        let in_order = self.life.in_order;
        let arrival = Arrival { at_ns: self.seated_ns, blank, in_flight, in_order };
        let now_ns = Rc::clone(&self.now_ns);
        let source = TapeSource::new(&samples, &topic.info, edge, exceptions, arrival, now_ns);
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

/// The state in which a life was last seen, if it is as far as it is replayed.
fn last_state<'a>(recorded: &'a Recorded, life: &Life) -> Option<&'a RecordedState> {
    recorded.states.iter().rev().find(|state| {
        LifeKey::of(&state.header) == life.key && state.header.release_ns == life.last_ns
    })
}

/// What each input had in effect in a state; nothing is known of one of another layout.
fn latched_in(layout: &Layout, state: &RecordedState) -> Vec<Option<Header>> {
    let Some(parts) = layout.parts(&state.bytes) else { return Vec::new() };
    // A sample begins with its header.
    let header = |sample: &[u8]| Header::unpack(&sample[..Header::PACKED_SIZE]);
    layout.latches(&parts).map(|(_, latch)| latch.map(header)).collect()
}

struct TapeSink<T: Sample> {
    topic: &'static Topic<T>,
    out: Rc<RefCell<Replayed>>,
}

impl<T: Sample> Sink<T> for TapeSink<T> {
    fn send(&mut self, sample: &T) {
        self.out.borrow_mut().tapes.push(self.topic, *sample);
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
