//! Topics as queues: every writer to every reader, in order, with room for a whole flight's worst.

use super::observer::{ErasedObserver, SampleTap, SampleTaps};
use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use runtime::delays::Delays;
use runtime::graph::READER_CAPACITY;
use runtime::{Executor, Graph, Input, InputVisitor, Output, OutputVisitor, Sink, Source};
use shared_types::{Header, NO_SEAT, OwnerRecord, Sample, Seat, Slot, SlotSpec, Topic, topics};
use std::any::Any;
use std::collections::{BTreeMap, VecDeque};
use std::rc::{Rc, Weak};
use swap::SlotWatch;

/// What has been sent to one reader and not been read.
struct Queue<T> {
    samples: RefCell<VecDeque<T>>,
    /// It will not be read any more.
    closed: Cell<bool>,
}

/// The last samples of one writer, for those that join a flight.
type Kept<T> = RefCell<VecDeque<T>>;

/// One topic.
struct Line<T> {
    readers: RefCell<Vec<Rc<Queue<T>>>>,
    /// Of every writer that is still there.
    kept: RefCell<Vec<Weak<Kept<T>>>>,
}

impl<T: Sample> Line<T> {
    fn send(&self, sample: T) {
        for reader in self.readers.borrow().iter().filter(|reader| !reader.closed.get()) {
            reader.samples.borrow_mut().push_back(sample);
        }
    }

    fn keep(&self) -> Rc<Kept<T>> {
        let kept = Rc::default();
        self.kept.borrow_mut().push(Rc::downgrade(&kept));
        kept
    }
}

/// Keeps a sample in the place of the oldest.
fn remember<T: Sample>(kept: &Kept<T>, topic: &Topic<T>, sample: T) {
    let mut kept = kept.borrow_mut();
    if kept.len() >= topic.info.history {
        kept.pop_front();
    }
    kept.push_back(sample);
}

pub(super) struct QueueSource<T>(Rc<Queue<T>>);

impl<T: Sample> Source<T> for QueueSource<T> {
    fn receive(&mut self) -> Option<T> {
        self.0.samples.borrow_mut().pop_front()
    }
}

impl<T> Drop for QueueSource<T> {
    fn drop(&mut self) {
        self.0.closed.set(true);
        self.0.samples.borrow_mut().clear();
    }
}

pub(super) struct QueueSink<T: Sample> {
    topic: &'static Topic<T>,
    line: Rc<Line<T>>,
    kept: Option<Rc<Kept<T>>>,
    observer: Rc<dyn SampleTap<T>>,
    watch: Option<Rc<RefCell<SlotWatch>>>,
}

impl<T: Sample> Sink<T> for QueueSink<T> {
    fn send(&mut self, sample: &T) {
        let mut altered = *sample;
        self.observer.alter(self.topic, &mut altered);
        let sample = &altered;
        self.observer.observe(self.topic, sample);
        self.line.send(*sample);
        if let Some(kept) = &self.kept {
            remember(kept, self.topic, *sample);
        }
        if let Some(watch) = &self.watch {
            watch.borrow_mut().observe(sample);
        }
    }
    fn serve_late_joiners(&mut self) {}
}

/// All queues of a flight.
pub(super) struct Wires {
    /// [`Line`] by topic name.
    lines: BTreeMap<&'static str, Box<dyn Any>>,
    taps: SampleTaps,
    /// Observes the slots, if they change hands.
    watch: Option<Rc<RefCell<SlotWatch>>>,
    /// The owner records, by topic name.
    records: BTreeMap<&'static str, Rc<Kept<OwnerRecord>>>,
    /// When samples arrive, if not as they are published.
    delays: Option<Rc<Delays>>,
}

impl Wires {
    pub(super) fn new(
        taps: SampleTaps,
        watch: Option<Rc<RefCell<SlotWatch>>>,
        delays: Option<Rc<Delays>>,
    ) -> Self {
        Self { lines: BTreeMap::new(), taps, watch, records: BTreeMap::new(), delays }
    }

    /// The observer that is shown what is not published on a topic.
    pub(super) fn observer(&self) -> Rc<dyn ErasedObserver> {
        self.taps.others()
    }

    /// Shows the observer a sample.
    pub(super) fn show<T: Sample>(&self, topic: &'static Topic<T>, sample: &T) {
        self.taps.on(topic).observe(topic, sample);
    }

    fn line<T: Sample>(&mut self, topic: &'static Topic<T>) -> Rc<Line<T>> {
        let none = || Line::<T> { readers: RefCell::default(), kept: RefCell::default() };
        let any = self.lines.entry(topic.info.name).or_insert_with(|| Box::new(Rc::new(none())));
        any.downcast_ref::<Rc<Line<T>>>()
            .map_or_else(|| unreachable!("a topic has one sample type"), Rc::clone)
    }

    /// What is published on a topic from now on, after what every writer that is there has kept for those
    /// that join.
    pub(super) fn subscribe<T: Sample>(&mut self, topic: &'static Topic<T>) -> QueueSource<T> {
        let line = self.line(topic);
        let mut samples = VecDeque::with_capacity(READER_CAPACITY);
        line.kept.borrow_mut().retain(|kept| kept.strong_count() > 0);
        for kept in line.kept.borrow().iter().filter_map(Weak::upgrade) {
            samples.extend(kept.borrow().iter().copied());
        }
        let queue = Queue { samples: RefCell::new(samples), closed: Cell::new(false) };
        let queue = Rc::new(queue);
        line.readers.borrow_mut().retain(|reader| !reader.closed.get());
        line.readers.borrow_mut().push(Rc::clone(&queue));
        QueueSource(queue)
    }

    /// Where one writer's samples of a topic go.
    pub(super) fn publish<T: Sample>(&mut self, topic: &'static Topic<T>) -> QueueSink<T> {
        let line = self.line(topic);
        QueueSink {
            topic,
            kept: self.watch.is_some().then(|| line.keep()),
            line,
            observer: self.taps.on(topic),
            watch: self.watch.clone(),
        }
    }

    /// Connects every port of a component.
    pub(super) fn connect(&mut self, graph: &Graph, executor: &mut Executor) {
        let (role, index) = (executor.node().role, executor.place().seat);
        let mut connect = Connect { wires: self, graph, seat: Seat { role, index } };
        let Ok(()) = executor.component.visit_inputs(&mut connect);
        let Ok(()) = executor.component.visit_outputs(&mut connect);
        let Ok(()) = OutputVisitor::visit(&mut connect, &topics::LOOP_STATS, &mut executor.stats);
        let deviations = &mut executor.deviations;
        let Ok(()) = OutputVisitor::visit(&mut connect, &topics::DEVIATION, deviations);
    }

    /// Sends a sample to the readers of a topic that no component writes.
    pub(super) fn send<T: Sample>(&mut self, topic: &'static Topic<T>, sample: T) {
        self.show(topic, &sample);
        self.line(topic).send(sample);
    }

    /// Sends the readers of a slot's owner record which seat owns it from when.
    pub(super) fn announce(&mut self, topic: &'static Topic<OwnerRecord>, record: OwnerRecord) {
        self.send(topic, record);
        let line = self.line(topic);
        if self.watch.is_some() {
            let kept = self.records.entry(topic.info.name).or_insert_with(|| line.keep());
            remember(kept, topic, record);
        }
    }

    /// Sends the readers of a slot's owner record that its first seat commands from the start.
    pub(super) fn own(&mut self, graph: &Graph, slot: Slot) {
        let SlotSpec { role, owner, .. } = *slot.spec();
        let period_ns = graph.node(graph.slot_holder(role)).map_or(0, |n| n.rate.period_ns());
        let record = OwnerRecord {
            header: Header { sequence: 1, ..Header::default() },
            epoch: 1,
            period_ns: [period_ns, 0, 0, 0],
            fallback: NO_SEAT,
            slot: role,
            ..OwnerRecord::default()
        };
        self.announce(owner, record);
    }
}

struct Connect<'a> {
    wires: &'a mut Wires,
    graph: &'a Graph,
    seat: Seat,
}

impl InputVisitor for Connect<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let source = self.wires.subscribe(topic);
        let source: Box<dyn Source<T>> = match &self.wires.delays {
            Some(delays) => delays.delay((self.seat, topic.info.name), source),
            None => Box::new(source),
        };
        let edge = self.graph.edge_or_unwaited(&topic.info, self.seat.role);
        input.connect(source, Some(edge));
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
        let sink = self.wires.publish(topic);
        output.connect(Box::new(sink), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}
