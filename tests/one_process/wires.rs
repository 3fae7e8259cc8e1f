//! Topics as queues: every writer to every reader, in order, with room for a whole flight's worst.

use launcher::run::FlightHash;
use runtime::graph::{Edge, READER_CAPACITY};
use runtime::input::{Input, InputSet as _, InputVisitor};
use runtime::output::{Output, OutputSet as _, OutputVisitor};
use runtime::{Executor, Graph, Service, Sink, Source};
use shared_types::{
    Author, Header, OwnerRecord, Role, Sample, Stamped, StateEstimate, Topic, Truth, topics,
};
use std::any::Any;
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::convert::Infallible;
use std::rc::Rc;

type Queue<T> = Rc<RefCell<VecDeque<Stamped<T>>>>;
type Readers<T> = Rc<RefCell<Vec<Queue<T>>>>;
type Hash = Rc<RefCell<FlightHash>>;
type Positions = Rc<RefCell<Vec<[f64; 3]>>>;

/// Room for the positions of a flight, so that keeping them is no allocation.
const POSITIONS: usize = 1 << 15;

struct QueueSource<T>(Queue<T>);

impl<T: Sample> Source<T> for QueueSource<T> {
    fn receive(&mut self) -> Option<Stamped<T>> {
        self.0.borrow_mut().pop_front()
    }
}

struct QueueSink<T: Sample> {
    topic: &'static Topic<T>,
    readers: Readers<T>,
    author: Author,
    hash: Hash,
    positions: Option<Positions>,
}

impl<T: Sample> Sink<T> for QueueSink<T> {
    fn send(&mut self, sample: T) {
        self.hash.borrow_mut().add(&self.topic.info, &sample);
        if let (Some(kept), Some(position)) = (&self.positions, position_of(&sample)) {
            kept.borrow_mut().push(position);
        }
        for reader in self.readers.borrow().iter() {
            reader.borrow_mut().push_back(Stamped { sample, author: self.author });
        }
    }
    fn serve_late_joiners(&mut self) {}
}

fn position_of<T: Sample>(sample: &T) -> Option<[f64; 3]> {
    let any: &dyn Any = sample;
    let truth = any.downcast_ref::<Truth>().map(|truth| truth.position_w_m);
    truth.or_else(|| any.downcast_ref::<StateEstimate>().map(|estimate| estimate.position_w_m))
}

/// Identity under which a role's samples appear.
fn author_of(role: Role) -> Author {
    [u64::from(role.0) + 1, 77]
}

/// All queues of a flight.
pub(super) struct Wires {
    /// [`Readers`] by topic name.
    readers: BTreeMap<&'static str, Box<dyn Any>>,
    positions: BTreeMap<&'static str, Positions>,
    hash: Hash,
}

impl Wires {
    pub(super) fn new(hash: Hash) -> Self {
        let kept = [topics::TRUTH.info.name, topics::STATE_ESTIMATE.info.name];
        let empty = || Rc::new(RefCell::new(Vec::with_capacity(POSITIONS)));
        let positions = kept.into_iter().map(|name| (name, empty())).collect();
        Self { readers: BTreeMap::new(), positions, hash }
    }

    pub(super) fn hash(&self) -> String {
        self.hash.borrow().hex()
    }

    pub(super) fn positions(&self, topic: &str) -> Vec<[f64; 3]> {
        self.positions[topic].borrow().clone()
    }

    fn readers<T: Sample>(&mut self, topic: &'static Topic<T>) -> Readers<T> {
        let readers = self
            .readers
            .entry(topic.info.name)
            .or_insert_with(|| Box::new(Readers::<T>::default()));
        Rc::clone(readers.downcast_ref().expect("one type per topic"))
    }

    /// Connects every port of a component.
    pub(super) fn connect<S: Service>(&mut self, graph: &Graph, executor: &mut Executor<S>) {
        let role = executor.node().role;
        let mut connect = Connect { wires: self, graph, role };
        let Ok(()) = executor.inputs.visit(&mut connect);
        let Ok(()) = executor.outputs.visit(&mut connect);
        let Ok(()) = OutputVisitor::visit(&mut connect, &topics::LOOP_STATS, &mut executor.stats);
    }

    /// Tells the readers of a slot's owner record who commands from the start.
    pub(super) fn own(&mut self, graph: &Graph, slot: Role, owner: Role) {
        let topic =
            if slot == Role::Attitude { &topics::ATTITUDE_OWNER } else { &topics::POSITION_OWNER };
        let header = Header { sequence: 1, ..Header::default() };
        let node = graph.node(owner).filter(|node| node.role == slot);
        let sample = OwnerRecord {
            header,
            epoch: 1,
            owner: author_of(owner),
            period_ns: node.map_or(0, |node| node.rate.period_ns()),
            slot,
            ..OwnerRecord::default()
        };
        let author = author_of(Role::Supervisor);
        for reader in self.readers(topic).borrow().iter() {
            reader.borrow_mut().push_back(Stamped { sample, author });
        }
    }
}

struct Connect<'a> {
    wires: &'a mut Wires,
    graph: &'a Graph,
    role: Role,
}

impl InputVisitor for Connect<'_> {
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

impl OutputVisitor for Connect<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        let sink = QueueSink {
            topic,
            readers: self.wires.readers(topic),
            author: author_of(self.role),
            hash: Rc::clone(&self.wires.hash),
            positions: self.wires.positions.get(topic.info.name).cloned(),
        };
        output.connect(Box::new(sink), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}
