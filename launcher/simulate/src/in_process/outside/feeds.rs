//! What a process reads: the queues of its topics, emptied onto its bus under the names of the writers.

use super::super::wires::{QueueSource, Wires};
use super::namespace::Namespace;
use core::convert::Infallible;
use runtime::ipc::{IpcSink, PortError};
use runtime::{Graph, Sink as _, Source as _};
use shared_types::{OwnerRecord, Role, Sample, Seat, Slot, Topic, TopicVisitor, topics};
use std::any::Any;
use swap::services::concerns;

/// One topic with its type forgotten.
pub(super) trait Feed {
    /// Publishes what has been written since the last time.
    fn pump(&mut self, namespace: &mut Namespace) -> Result<(), PortError>;
    /// Lets a process that has just joined see it.
    fn serve_late_joiners(&mut self);
}

struct TopicFeed<T: Sample> {
    topic: &'static Topic<T>,
    from: Role,
    source: QueueSource<T>,
    writers: Vec<Writer<T>>,
    /// The process's own place, if the topic has the owner records of its slot.
    own_slot: Option<Seat>,
}

/// One instance that publishes on a topic.
struct Writer<T: Sample> {
    seat: u32,
    generation: u32,
    sink: IpcSink<T>,
}

impl<T: Sample> TopicFeed<T> {
    fn writer(
        &mut self,
        seat: u32,
        generation: u32,
        namespace: &mut Namespace,
    ) -> Result<&mut IpcSink<T>, PortError> {
        let is_it = |w: &Writer<T>| (w.seat, w.generation) == (seat, generation);
        let at = if let Some(at) = self.writers.iter().position(is_it) {
            at
        } else {
            self.writers.retain(|writer| writer.seat != seat);
            let bus = if self.from.is_stepping() {
                namespace.bus_of(Seat { role: self.from, index: seat }, generation)?
            } else {
                namespace.bus()
            };
            let sink = bus.writer(self.topic)?;
            self.writers.push(Writer { seat, generation, sink });
            self.writers.len() - 1
        };
        Ok(&mut self.writers[at].sink)
    }
}

impl<T: Sample> Feed for TopicFeed<T> {
    fn pump(&mut self, namespace: &mut Namespace) -> Result<(), PortError> {
        while let Some(mut sample) = self.source.receive() {
            if let Some(own) = self.own_slot {
                become_fallback(&mut sample, own.index);
            }
            let (seat, generation) = (sample.header().seat, sample.header().generation);
            self.writer(seat, generation, namespace)?.send(&sample);
        }
        Ok(())
    }

    fn serve_late_joiners(&mut self) {
        self.writers.iter_mut().for_each(|writer| writer.sink.serve_late_joiners());
    }
}

/// In a flight of processes none waits for a shadow, so it wakes none. Here the flight's thread does
/// wait, and a process wakes others if it may have to stand in for the owner.
fn become_fallback<T: Sample>(sample: &mut T, seat: u32) {
    let Some(record) = (sample as &mut dyn Any).downcast_mut::<OwnerRecord>() else { return };
    let member = usize::try_from(seat).ok().and_then(|seat| record.period_ns.get(seat));
    let is_member = member.is_some_and(|period_ns| *period_ns > 0);
    if is_member && record.owner != seat {
        record.fallback = seat;
    }
}

struct Opener<'a> {
    wires: &'a mut Wires,
    graph: &'a Graph,
    place: Seat,
    feeds: Vec<Box<dyn Feed>>,
}

impl TopicVisitor for Opener<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let role = self.place.role;
        let from = self.graph.producer(&topic.info);
        let is_own_slot =
            Slot::of_owner_records(&topic.info).is_some_and(|slot| slot.role() == role);
        let is_read = topic.info.to.contains(&role) || is_own_slot;
        if from != role && is_read && concerns(self.graph, role, &topic.info) {
            self.feeds.push(Box::new(TopicFeed {
                topic,
                from,
                source: self.wires.subscribe(topic),
                writers: Vec::new(),
                own_slot: is_own_slot.then_some(self.place),
            }));
        }
        Ok(())
    }
}

/// Every topic that the process on a place may read.
pub(super) fn open(wires: &mut Wires, graph: &Graph, place: Seat) -> Vec<Box<dyn Feed>> {
    let mut opener = Opener { wires, graph, place, feeds: Vec::new() };
    let Ok(()) = topics::visit_all(&mut opener);
    opener.feeds
}
