//! Topics as queues: every writer to every reader, in order, with room for a whole flight's worst.

use super::Observer;
use core::cell::RefCell;
use core::convert::Infallible;
use runtime::graph::{Edge, READER_CAPACITY};
use runtime::input::{Input, InputSet as _, InputVisitor};
use runtime::output::{Output, OutputSet as _, OutputVisitor};
use runtime::{Executor, Graph, Service, Sink, Source};
use shared_types::{Header, NO_SEAT, OwnerRecord, Role, Sample, Topic, topics};
use std::any::Any;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

type Queue<T> = Rc<RefCell<VecDeque<T>>>;
type Readers<T> = Rc<RefCell<Vec<Queue<T>>>>;

struct QueueSource<T>(Queue<T>);

impl<T: Sample> Source<T> for QueueSource<T> {
    fn receive(&mut self) -> Option<T> {
        self.0.borrow_mut().pop_front()
    }
}

struct QueueSink<T: Sample, O> {
    topic: &'static Topic<T>,
    readers: Readers<T>,
    observer: Rc<RefCell<O>>,
}

impl<T: Sample, O: Observer> Sink<T> for QueueSink<T, O> {
    fn send(&mut self, sample: T) {
        self.observer.borrow_mut().observe(self.topic, &sample);
        for reader in self.readers.borrow().iter() {
            reader.borrow_mut().push_back(sample);
        }
    }
    fn serve_late_joiners(&mut self) {}
}

/// All queues of a flight.
pub(super) struct Wires<O> {
    /// [`Readers`] by topic name.
    readers: BTreeMap<&'static str, Box<dyn Any>>,
    observer: Rc<RefCell<O>>,
}

impl<O: Observer> Wires<O> {
    pub(super) fn new(observer: Rc<RefCell<O>>) -> Self {
        Self { readers: BTreeMap::new(), observer }
    }

    pub(super) fn observer(&self) -> Rc<RefCell<O>> {
        Rc::clone(&self.observer)
    }

    fn readers<T: Sample>(&mut self, topic: &'static Topic<T>) -> Readers<T> {
        let any = self
            .readers
            .entry(topic.info.name)
            .or_insert_with(|| Box::new(Readers::<T>::default()));
        any.downcast_ref::<Readers<T>>()
            .map_or_else(|| unreachable!("a topic has one sample type"), Rc::clone)
    }

    /// Connects every port of a component.
    pub(super) fn connect<S: Service>(&mut self, graph: &Graph, executor: &mut Executor<S>) {
        let role = executor.node().role;
        let mut connect = Connect { wires: self, graph, role };
        let Ok(()) = executor.inputs.visit(&mut connect);
        let Ok(()) = executor.outputs.visit(&mut connect);
        let Ok(()) = OutputVisitor::visit(&mut connect, &topics::LOOP_STATS, &mut executor.stats);
        let deviations = &mut executor.deviations;
        let Ok(()) = OutputVisitor::visit(&mut connect, &topics::DEVIATION, deviations);
    }

    /// Tells the readers of a slot's owner record that its first seat commands from the start.
    pub(super) fn own(&mut self, graph: &Graph, slot: Role) {
        let topic =
            if slot == Role::Attitude { &topics::ATTITUDE_OWNER } else { &topics::POSITION_OWNER };
        let period_ns = graph.node(graph.slot_holder(slot)).map_or(0, |n| n.rate.period_ns());
        let sample = OwnerRecord {
            header: Header { sequence: 1, ..Header::default() },
            epoch: 1,
            period_ns: [period_ns, 0, 0, 0],
            fallback: NO_SEAT,
            slot,
            ..OwnerRecord::default()
        };
        self.observer.borrow_mut().observe(topic, &sample);
        for reader in self.readers(topic).borrow().iter() {
            reader.borrow_mut().push_back(sample);
        }
    }
}

struct Connect<'a, O> {
    wires: &'a mut Wires<O>,
    graph: &'a Graph,
    role: Role,
}

impl<O: Observer> InputVisitor for Connect<'_, O> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let queue = Rc::new(RefCell::new(VecDeque::with_capacity(READER_CAPACITY)));
        self.wires.readers(topic).borrow_mut().push(Rc::clone(&queue));
        let edge = self.graph.edge(&topic.info, self.role).copied();
        let edge = edge.unwrap_or_else(|| Edge::unwaited(&topic.info, self.role));
        input.connect(Box::new(QueueSource(queue)), Some(edge));
        Ok(())
    }
}

impl<O: Observer> OutputVisitor for Connect<'_, O> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        let sink = QueueSink {
            topic,
            readers: self.wires.readers(topic),
            observer: Rc::clone(&self.wires.observer),
        };
        output.connect(Box::new(sink), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}
