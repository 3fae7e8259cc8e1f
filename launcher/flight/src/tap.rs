//! The recorder: drains every topic and state of the run, off the loops, into the sinks, of which the recording is one.

use record::Stream;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::{Bus, IpcSource, LatestPort, PortError, StateSubscriber, recorder_capacity};
use runtime::{Graph, SeatMarks, Source as _, StateHeader};
use shared_types::{
    Header, OwnerRecord, Progress, Sample, Seat, Slot, Topic, TopicVisitor, topics,
};
use simulate::Sinks;

/// How long the ports of dead launchers may take to be freed \[ns\]: tenths of a second for each launcher, and more on a
/// busy machine. A launcher that gives up leaves the flight without one.
pub(crate) const FREED_LIMIT_NS: u64 = 20_000_000_000;

/// One topic's reader with its type forgotten.
trait TapPort {
    /// Takes everything that has arrived; the number of samples.
    fn drain(&mut self, sinks: &mut Sinks, receipt_mono_ns: u64) -> usize;
}

struct TypedTap<T: Sample> {
    topic: &'static Topic<T>,
    stream: Stream,
    source: IpcSource<T>,
}

impl<T: Sample> TapPort for TypedTap<T> {
    fn drain(&mut self, sinks: &mut Sinks, receipt_mono_ns: u64) -> usize {
        let mut count = 0;
        while let Some(sample) = self.source.receive() {
            sinks.take(self.topic, self.stream, &sample, receipt_mono_ns);
            count += 1;
        }
        count
    }
}

struct Opener<'a> {
    bus: &'a Bus,
    graph: &'a Graph,
    sinks: &'a Sinks,
    ports: Vec<Box<dyn TapPort>>,
}

impl TopicVisitor for Opener<'_> {
    type Error = PortError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), PortError> {
        if let Some(stream) = self.sinks.stream(&topic.info) {
            let from = self.graph.producer(&topic.info);
            let source = self.bus.reader_of(topic, from, recorder_capacity(&topic.info))?;
            self.ports.push(Box::new(TypedTap { topic, stream, source }));
        }
        Ok(())
    }
}

/// Last complete state from one seat.
#[derive(Debug, Clone, Default)]
struct LastState {
    bytes: Vec<u8>,
    header: Header,
}

/// What is known of a seat.
struct SeatTap {
    seat: Seat,
    progress: LatestPort<Progress>,
    states: StateSubscriber,
    last_state: LastState,
}

/// Readers of everything.
pub struct Tap {
    ports: Vec<Box<dyn TapPort>>,
    seats: Vec<SeatTap>,
    /// What has been promised and not yet drained.
    promised: Vec<(Seat, Progress)>,
    /// Marks as far as everything they promise has been drained.
    pub(super) marks: SeatMarks,
    /// `CLOCK_MONOTONIC` when all readers were open \[ns\].
    pub(super) opened_mono_ns: u64,
    /// What is done with it.
    pub sinks: Sinks,
}

impl core::fmt::Debug for Tap {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Tap").field("promised", &self.promised).finish_non_exhaustive()
    }
}

impl Tap {
    /// Opens a reader of each topic that is consumed, and of each seat.
    ///
    /// # Errors
    /// The first port that cannot be had, or for which there is no room for a second.
    pub fn open(bus: &Bus, graph: &Graph, sinks: Sinks) -> Result<Self, PortError> {
        let open_seat = |seat| {
            Ok(SeatTap {
                seat,
                progress: LatestPort::progress(bus, seat)?,
                states: StateSubscriber::of_seat(bus, seat)?,
                last_state: LastState::default(),
            })
        };
        let open = || {
            let mut opener = Opener { bus, graph, sinks: &sinks, ports: Vec::new() };
            topics::visit_all(&mut opener)?;
            let seats = graph.nodes().iter().flat_map(|node| Seat::all(node.role));
            Ok((opener.ports, seats.map(open_seat).collect::<Result<_, PortError>>()?))
        };
        let give_up_ns = mono_now_ns() + FREED_LIMIT_NS;
        // A service admits only so many readers, and those of a launcher that has died count until they are freed, here
        // or by the thread that frees what is left of several.
        let (ports, seats) = loop {
            match open() {
                Err(PortError::Full { .. }) if mono_now_ns() < give_up_ns => {
                    bus.sweep_dead_processes(&mut || ());
                    sleep_until(mono_now_ns() + 5_000_000);
                }
                opened => break opened?,
            }
        };
        let (promised, marks) = (Vec::new(), SeatMarks::default());
        Ok(Self { ports, seats, promised, marks, opened_mono_ns: mono_now_ns(), sinks })
    }

    /// Records which seat owned a slot before this launcher came: that is published no more, and what flew by it is in
    /// the recording.
    pub(crate) fn record_owner(&mut self, record: &OwnerRecord) {
        let Some(slot) = Slot::of(record.slot).filter(|_| record.epoch > 0) else { return };
        let topic = slot.spec().owner;
        if let Some(stream) = self.sinks.stream(&topic.info) {
            self.sinks.take(topic, stream, record, mono_now_ns());
        }
    }

    /// Last complete state published from a seat; none before the first.
    pub(super) fn last_state(&self, seat: Seat) -> Option<&[u8]> {
        let tap = self.seats.iter().find(|tap| tap.seat == seat)?;
        Some(tap.last_state.bytes.as_slice()).filter(|bytes| !bytes.is_empty())
    }

    /// Generation of the process that published it.
    pub(super) fn last_state_of(&self, seat: Seat) -> Option<(u32, &[u8])> {
        let last = &self.seats.iter().find(|tap| tap.seat == seat)?.last_state;
        let generation = last.header.generation;
        self.last_state(seat).map(|state| (generation, state))
    }

    /// Has the last state from a seat recorded: another process goes on from it, or the one that published it has died,
    /// and it shows how far that one has got.
    pub(super) fn keep_state_of(&mut self, seat: Seat, now_mono_ns: u64) {
        let tap = self.seats.iter().find(|tap| tap.seat == seat);
        if let Some(last) = tap.map(|tap| &tap.last_state).filter(|last| !last.bytes.is_empty()) {
            self.sinks.keep_state(seat.role, &last.header, &last.bytes, now_mono_ns);
        }
    }

    /// Takes everything that has arrived; the number of samples.
    pub fn drain(&mut self, now_mono_ns: u64) -> usize {
        // Marks first: when they are raised below, what they promise has been drained.
        for tap in &mut self.seats {
            let promised = &mut self.promised;
            tap.progress.for_each_new(|progress| promised.push((tap.seat, *progress)));
        }
        let mut count = 0;
        for port in &mut self.ports {
            count += port.drain(&mut self.sinks, now_mono_ns);
        }
        for tap in &mut self.seats {
            let SeatTap { seat, states, last_state: last, .. } = tap;
            let sinks = &mut self.sinks;
            while states.receive(|header, bytes| {
                // A successor goes on from any instant, wherever its predecessor said it was.
                let place = |h: &Header| (h.generation, h.release_ns, h.sequence);
                let is_new = place(header) > place(&last.header);
                if !is_new || !StateHeader::agrees_with(bytes, header) {
                    return;
                }
                last.header = *header;
                last.bytes.clear();
                last.bytes.extend_from_slice(bytes);
                sinks.take_state(seat.role, header, bytes, now_mono_ns);
            }) {}
        }
        for (seat, progress) in self.promised.drain(..) {
            self.marks.update(seat, &progress, self.opened_mono_ns);
        }
        self.sinks.flush_if_due(now_mono_ns);
        count
    }
}
