//! What a process publishes: its topics and its state, put on the queues of the flight.

use super::super::observer::ErasedObserver;
use super::super::wires::{QueueSink, Wires};
use runtime::graph::READER_CAPACITY;
use runtime::ipc::{Bus, IpcSource, PortError, StateSubscriber};
use runtime::{Graph, Sink as _, Source as _};
use shared_types::{Edge, Role, Sample, Seat, Topic, TopicVisitor, topics};
use std::rc::Rc;

/// One topic with its type forgotten.
trait Gather {
    /// Passes on what has been published since the last time.
    fn gather(&mut self);
}

struct TopicOutput<T: Sample> {
    reader: IpcSource<T>,
    sink: QueueSink<T>,
}

impl<T: Sample> Gather for TopicOutput<T> {
    fn gather(&mut self) {
        while let Some(sample) = self.reader.receive() {
            self.sink.send(&sample);
        }
    }
}

struct Opener<'a> {
    wires: &'a mut Wires,
    bus: &'a Bus,
    graph: &'a Graph,
    role: Role,
    topics: Vec<Box<dyn Gather>>,
}

impl TopicVisitor for Opener<'_> {
    type Error = PortError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), PortError> {
        let from = self.graph.producer(&topic.info);
        let of_all_loops = [topics::LOOP_STATS.info.name, topics::DEVIATION.info.name];
        if from == self.role || of_all_loops.contains(&topic.info.name) {
            debug_assert!(from == self.role || topic.info.edge == Edge::RecordOnly);
            let reader = self.bus.reader_of(topic, from, READER_CAPACITY)?;
            let sink = self.wires.publish(topic);
            self.topics.push(Box::new(TopicOutput { reader, sink }));
        }
        Ok(())
    }
}

/// Everything that the process on a place publishes.
pub(super) struct Outputs {
    place: Seat,
    topics: Vec<Box<dyn Gather>>,
    states: StateSubscriber,
    /// The last published state; empty before the first.
    state: Vec<u8>,
    observer: Rc<dyn ErasedObserver>,
    observes_states: bool,
}

impl Outputs {
    pub(super) fn open(
        wires: &mut Wires,
        bus: &Bus,
        graph: &Graph,
        place: Seat,
    ) -> Result<Self, PortError> {
        let mut opener = Opener { wires, bus, graph, role: place.role, topics: Vec::new() };
        topics::visit_all(&mut opener)?;
        let topics = opener.topics;
        let observer = wires.observer();
        let observes_states = observer.wants_states();
        let states = StateSubscriber::of_seat(bus, place)?;
        Ok(Self { place, topics, states, state: Vec::new(), observer, observes_states })
    }

    /// Passes on what has been published since the last time.
    pub(super) fn gather(&mut self) {
        self.topics.iter_mut().for_each(|topic| topic.gather());
        let Self { place, states, state, observer, observes_states, .. } = self;
        while states.receive(|header, bytes| {
            state.clear();
            state.extend_from_slice(bytes);
            if *observes_states {
                observer.observe_state(place.role, header, bytes);
            }
        }) {}
    }

    /// The last published state; none before the first.
    pub(super) fn state(&self) -> Option<Vec<u8>> {
        (!self.state.is_empty()).then(|| self.state.clone())
    }
}
