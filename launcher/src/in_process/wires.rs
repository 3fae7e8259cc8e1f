//! Topics as queues: every writer to every reader, in order, with room for a whole flight's worst.

use super::Observer;
use core::cell::RefCell;
use core::convert::Infallible;
use runtime::graph::{Edge, READER_CAPACITY};
use runtime::input::{Input, InputSet as _, InputVisitor};
use runtime::output::{Output, OutputSet as _, OutputVisitor};
use runtime::{Executor, Graph, Service, Sink, Source};
use shared_types::{Author, Header, OwnerRecord, Role, Sample, Stamped, Topic, TopicInfo, topics};
use std::any::Any;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

type Queue<T> = Rc<RefCell<VecDeque<Stamped<T>>>>;
type Readers<T> = Rc<RefCell<Vec<Queue<T>>>>;

struct QueueSource<T>(Queue<T>);

impl<T: Sample> Source<T> for QueueSource<T> {
    fn receive(&mut self) -> Option<Stamped<T>> {
        self.0.borrow_mut().pop_front()
    }
}

struct QueueSink<T: Sample, O> {
    topic: &'static Topic<T>,
    readers: Readers<T>,
    author: Author,
    observer: Rc<RefCell<O>>,
}

impl<T: Sample, O: Observer> Sink<T> for QueueSink<T, O> {
    fn send(&mut self, sample: T) {
        self.observer.borrow_mut().observe(self.topic, &sample);
        for reader in self.readers.borrow().iter() {
            reader.borrow_mut().push_back(Stamped { sample, author: self.author });
        }
    }
    fn serve_late_joiners(&mut self) {}
}

/// Identity of each topic's writer, by topic name, in a flight that others have begun.
pub(super) type Authors = BTreeMap<&'static str, Author>;

/// Identity under which the samples of a topic appear that `from` writes.
pub(super) fn author_of(known: &Authors, topic: &TopicInfo, from: Role) -> Author {
    known.get(topic.name).copied().unwrap_or(own_author(from))
}

/// Identity under which a role's samples appear in a flight of its own.
fn own_author(role: Role) -> Author {
    [u64::from(role.0) + 1, 0]
}

/// All queues of a flight.
pub(super) struct Wires<O> {
    /// [`Readers`] by topic name.
    readers: BTreeMap<&'static str, Box<dyn Any>>,
    observer: Rc<RefCell<O>>,
    authors: Authors,
}

impl<O: Observer> Wires<O> {
    pub(super) fn new(observer: Rc<RefCell<O>>, authors: Authors) -> Self {
        Self { readers: BTreeMap::new(), observer, authors }
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

    /// Tells the readers of a slot's owner record who commands from the start.
    pub(super) fn own(&mut self, graph: &Graph, slot: Role, owner: Role) {
        let topic =
            if slot == Role::Attitude { &topics::ATTITUDE_OWNER } else { &topics::POSITION_OWNER };
        let node = graph.node(owner).filter(|node| node.role == slot);
        let sample = OwnerRecord {
            header: Header { sequence: 1, ..Header::default() },
            epoch: 1,
            owner: own_author(owner),
            period_ns: node.map_or(0, |node| node.rate.period_ns()),
            slot,
            ..OwnerRecord::default()
        };
        self.observer.borrow_mut().observe(topic, &sample);
        let author = own_author(Role::Supervisor);
        for reader in self.readers(topic).borrow().iter() {
            reader.borrow_mut().push_back(Stamped { sample, author });
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
            author: author_of(&self.wires.authors, &topic.info, self.role),
            observer: Rc::clone(&self.wires.observer),
        };
        output.connect(Box::new(sink), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}
