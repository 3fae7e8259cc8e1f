//! One flight in one process, kept as a tape: what each loop was given, to be given again.

use components::BuildError;
use core::cell::{Cell, RefCell};
use core::time::Duration;
use observe::Observer;
use record::Recording;
use runtime::clock::mono_now_ns;
use runtime::graph::Edge;
use runtime::{
    Executor, Graph, Input, InputVisitor, Node, Output, OutputVisitor, Place, Sink, Source,
    StateSink, StepStamps,
};
use scenario::services::Assignment;
use scenario::{Override, Scenario};
use shared_types::{
    Header, NO_SEAT, OwnerRecord, Role, Sample, Slot, SlotSpec, Topic, TopicVisitor, topics,
};
use simulate::in_process::{InProcess, StateSource};
use std::any::Any;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::rc::Rc;

type Log<T> = RefCell<Vec<T>>;

/// Every sample of a flight by topic, in the order published.
#[derive(Clone, Default)]
pub(crate) struct Tape {
    logs: Rc<RefCell<BTreeMap<&'static str, Rc<dyn Any>>>>,
    /// Samples in effect later than this are not shown to readers \[ns\].
    until_ns: Rc<Cell<u64>>,
}

impl Tape {
    fn log<T: Sample>(&self, topic: &Topic<T>) -> Rc<Log<T>> {
        let mut logs = self.logs.borrow_mut();
        let log = logs.entry(topic.info.name).or_insert_with(|| Rc::new(Log::<T>::default()));
        Rc::clone(log).downcast().expect("a topic has one sample type")
    }

    /// Gives each slot to the loop that fills it.
    fn own_slots(&self, graph: &Graph) {
        for SlotSpec { owner: topic, role, .. } in Slot::ALL.map(Slot::spec) {
            let slot = *role;
            let header = Header { sequence: 1, ..Header::default() };
            let period_ns = graph.node(slot).map_or(0, |node| node.rate.period_ns());
            let sample = OwnerRecord {
                header,
                epoch: 1,
                period_ns: [period_ns, 0, 0, 0],
                fallback: NO_SEAT,
                slot,
                ..OwnerRecord::default()
            };
            self.log(topic).borrow_mut().push(sample);
        }
    }
}

struct Reader<T> {
    log: Rc<Log<T>>,
    next: usize,
    until_ns: Rc<Cell<u64>>,
}

impl<T: Sample> Source<T> for Reader<T> {
    fn receive(&mut self) -> Option<T> {
        let log = self.log.borrow();
        let shown = |s: &&T| s.header().valid_ns <= self.until_ns.get();
        let sample = log.get(self.next).filter(shown).copied()?;
        self.next += 1;
        Some(sample)
    }
}

/// Keeps what is published on the way.
impl Observer for Tape {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        // The replayed loops have owner records of their own.
        if topic.info.from == Role::Supervisor {
            return;
        }
        self.log(topic).borrow_mut().push(*sample);
    }
}

/// Takes what a replayed loop publishes.
struct Forgotten;

impl<T: Sample> Sink<T> for Forgotten {
    fn send(&mut self, sample: &T) {
        core::hint::black_box(sample);
    }
    fn serve_late_joiners(&mut self) {}
}

/// Packs states as in flight and forgets them.
struct NoReader;

impl StateSink for NoReader {
    fn send(&mut self, _header: &Header, _state: &[u8]) {}
    fn serve_late_joiners(&mut self) {}
}

/// Puts a component between the tape's ports.
struct Wiring<'a> {
    tape: &'a Tape,
    graph: &'a Graph,
    node: Node,
}

impl InputVisitor for Wiring<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let role = self.node.role;
        let edge = self.graph.edge(&topic.info, role).copied();
        let edge = edge.unwrap_or_else(|| Edge::unwaited(&topic.info, role));
        let until_ns = Rc::clone(&self.tape.until_ns);
        let reader = Reader { log: self.tape.log(topic), next: 0, until_ns };
        input.connect(Box::new(reader), Some(edge));
        Ok(())
    }
}

impl OutputVisitor for Wiring<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        output.connect(Box::new(Forgotten), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}

/// Takes in what is shown and runs the next release.
fn step(executor: &mut Executor) {
    executor.component.receive();
    executor.run_step(StepStamps::UNTIMED);
}

/// A flight that has been flown once.
pub(crate) struct Flight {
    scenario: Scenario,
    pub(crate) graph: Graph,
    tape: Tape,
    end_ns: u64,
}

impl Flight {
    /// Flies a shipped scenario in this process.
    pub(crate) fn fly(name: &str) -> Result<Self, Box<dyn std::error::Error>> {
        Self::fly_with(name, &[])
    }

    /// Flies a shipped scenario with changes in this process.
    pub(crate) fn fly_with(
        name: &str,
        changes: &[Override],
    ) -> Result<Self, Box<dyn std::error::Error>> {
        Self::of(Scenario::load(name, changes)?)
    }

    /// Name of the service that fills a role.
    pub(crate) fn name(&self, role: Role) -> &'static str {
        Assignment::of(self.scenario.settings()).name(role)
    }

    /// Flies the beginning of a shipped scenario in this process.
    pub(crate) fn fly_for(name: &str, duration_s: f64) -> Result<Self, Box<dyn std::error::Error>> {
        let duration = Override::duration(Duration::from_secs_f64(duration_s));
        Self::fly_with(name, &[duration])
    }

    fn of(scenario: Scenario) -> Result<Self, Box<dyn std::error::Error>> {
        let graph = scenario.graph()?;
        let end_ns = scenario.duration_ns();
        let flight = Self { scenario, graph, tape: Tape::default(), end_ns };
        flight.tape.own_slots(&flight.graph);
        let observer = flight.tape.clone();
        InProcess::new(&flight.scenario, StateSource::Estimator, observer)?.fly_until(u64::MAX)?;
        Ok(flight)
    }

    fn build(&self, node: Node) -> Result<Executor, BuildError> {
        let assignment = Assignment::of(self.scenario.settings());
        let component = components::build(&assignment, node.role, &self.scenario)?;
        let mut executor = Executor::new(component, node, Place::default());
        let mut wiring = Wiring { tape: &self.tape, graph: &self.graph, node };
        let Ok(()) = executor.component.visit_inputs(&mut wiring);
        let Ok(()) = executor.component.visit_outputs(&mut wiring);
        executor.connect_state(Box::new(NoReader));
        Ok(executor)
    }

    pub(crate) fn duration_s(&self) -> f64 {
        self.end_ns as f64 * 1e-9
    }

    /// Records every sample, and returns how many there are.
    pub(crate) fn write_to(&self, recording: &mut Recording) -> u64 {
        struct Write<'a>(&'a Tape, &'a mut Recording, u64);
        impl TopicVisitor for Write<'_> {
            type Error = Infallible;
            fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
                for sample in self.0.log(topic).borrow().iter() {
                    self.1.write(topic, sample, 0).expect("room for a recording");
                    self.2 += 1;
                }
                Ok(())
            }
        }
        let mut write = Write(&self.tape, recording, 0);
        let Ok(()) = topics::visit_all(&mut write);
        write.2
    }

    /// One loop of the flight, to be run again from its start.
    pub(crate) fn replay(&self, node: Node) -> Result<Replay<'_>, BuildError> {
        Ok(Replay { flight: self, node, current: self.build(node)? })
    }
}

/// One loop on the tape, over and over.
pub(crate) struct Replay<'a> {
    flight: &'a Flight,
    node: Node,
    current: Executor,
}

impl Replay<'_> {
    /// Time of each step of one flight \[ns\]: taking in samples, stepping, handing over what is
    /// published, packing states.
    pub(crate) fn each_step_ns(&mut self) -> Vec<u64> {
        let Flight { tape, end_ns, .. } = self.flight;
        self.current = self.flight.build(self.node).expect("it was built before");
        let mut times = Vec::new();
        while self.current.mark_ns() < *end_ns {
            tape.until_ns.set(self.current.mark_ns());
            let start_ns = mono_now_ns();
            step(&mut self.current);
            times.push(mono_now_ns() - start_ns);
        }
        times
    }

    /// Runs steps without a look at the clock, of one flight and then of the next.
    pub(crate) fn step(&mut self, steps: u64) {
        let Flight { tape, end_ns, .. } = self.flight;
        for _ in 0..steps {
            if self.current.mark_ns() >= *end_ns {
                self.current = self.flight.build(self.node).expect("it was built before");
            }
            tape.until_ns.set(self.current.mark_ns());
            step(&mut self.current);
        }
    }

    /// Time that this many steps take, as above.
    pub(crate) fn run(&mut self, steps: u64) -> Duration {
        let Flight { tape, end_ns, .. } = self.flight;
        let (mut left, mut spent_ns) = (steps, 0);
        while left > 0 {
            if self.current.mark_ns() >= *end_ns {
                self.current = self.flight.build(self.node).expect("it was built before");
            }
            let start_ns = mono_now_ns();
            while left > 0 && self.current.mark_ns() < *end_ns {
                tape.until_ns.set(self.current.mark_ns());
                step(&mut self.current);
                left -= 1;
            }
            spent_ns += mono_now_ns() - start_ns;
        }
        Duration::from_nanos(spent_ns)
    }
}
