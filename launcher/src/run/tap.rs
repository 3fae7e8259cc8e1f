//! Drains every topic and state of the run, off the loops.

use super::consumers::Consumers;
use crate::record::Stream;
use runtime::Source as _;
use runtime::graph::{Marks, ROLES};
use runtime::ipc::{
    Bus, IpcSource, LatestPort, PortError, RECORDER_CAPACITY, ServiceKind, StateSubscriber,
};
use runtime::service::StateHeader;
use shared_types::wire::Value as _;
use shared_types::{Progress, Role, Sample, Topic, TopicVisitor, topics};

/// One topic's reader with its type forgotten.
trait TapPort {
    /// Takes everything that has arrived; the number of samples.
    fn drain(&mut self, consumers: &mut Consumers, receipt_mono_ns: u64) -> usize;
}

struct TypedTap<T: Sample> {
    topic: &'static Topic<T>,
    stream: Stream,
    source: IpcSource<T>,
}

impl<T: Sample> TapPort for TypedTap<T> {
    fn drain(&mut self, consumers: &mut Consumers, receipt_mono_ns: u64) -> usize {
        let mut count = 0;
        while let Some(stamped) = self.source.receive() {
            consumers.take(self.topic, self.stream, &stamped.sample, receipt_mono_ns);
            count += 1;
        }
        count
    }
}

struct Opener<'a> {
    bus: &'a Bus,
    consumers: &'a Consumers,
    ports: Vec<Box<dyn TapPort>>,
}

impl TopicVisitor for Opener<'_> {
    type Error = PortError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), PortError> {
        if let Some(stream) = self.consumers.stream(&topic.info) {
            let factory = self.bus.open_topic(topic)?;
            let source = IpcSource::with_capacity(&factory, RECORDER_CAPACITY)?;
            self.ports.push(Box::new(TypedTap { topic, stream, source }));
        }
        Ok(())
    }
}

/// Last complete state of one role.
#[derive(Debug, Clone, Default)]
pub(super) struct LastState {
    pub(super) bytes: Vec<u8>,
    sequence: u64,
}

impl LastState {
    /// Where in the flight the state was taken; `None` before the first.
    pub(super) fn header(&self) -> Option<StateHeader> {
        self.bytes.get(..StateHeader::PACKED_SIZE).map(StateHeader::unpack)
    }
}

/// Readers of everything.
pub(super) struct Tap {
    ports: Vec<Box<dyn TapPort>>,
    progress: Vec<(Role, LatestPort<Progress>)>,
    states: Vec<(Role, StateSubscriber)>,
    /// Last complete state per role, by [`Role::index`].
    pub(super) last_states: Vec<LastState>,
    /// Marks as far as everything they promise has been drained.
    pub(super) marks: Marks,
    pub(super) consumers: Consumers,
}

impl Tap {
    pub(super) fn open(bus: &Bus, roles: &[Role], consumers: Consumers) -> Result<Self, PortError> {
        let mut opener = Opener { bus, consumers: &consumers, ports: Vec::new() };
        topics::visit_all(&mut opener)?;
        let ports = opener.ports;
        let progress = roles
            .iter()
            .map(|&r| Ok((r, LatestPort::open(bus, ServiceKind::Progress(r))?)))
            .collect::<Result<_, PortError>>()?;
        let states = roles
            .iter()
            .map(|&r| Ok((r, StateSubscriber::open(bus, ServiceKind::State(r))?)))
            .collect::<Result<_, PortError>>()?;
        Ok(Self {
            ports,
            progress,
            states,
            last_states: vec![LastState::default(); ROLES],
            marks: [0; ROLES],
            consumers,
        })
    }

    /// Takes everything that has arrived; the number of samples.
    pub(super) fn drain(&mut self, now_mono_ns: u64) -> usize {
        // Marks first: when they are raised below, what they promise has been drained.
        let mut marks = self.marks;
        for (role, port) in &mut self.progress {
            if let Some(progress) = port.latest() {
                let mark = &mut marks[role.index()];
                *mark = progress.mark_ns.max(*mark);
            }
        }
        let mut count = 0;
        for port in &mut self.ports {
            count += port.drain(&mut self.consumers, now_mono_ns);
        }
        for (role, subscriber) in &mut self.states {
            let last = &mut self.last_states[role.index()];
            let consumers = &mut self.consumers;
            while subscriber.receive(|header, bytes, _| {
                if header.sequence <= last.sequence {
                    return;
                }
                last.sequence = header.sequence;
                last.bytes.clear();
                last.bytes.extend_from_slice(bytes);
                consumers.take_state(*role, header, bytes, now_mono_ns);
            }) {}
        }
        self.consumers.flush_if_due(now_mono_ns);
        self.marks = marks;
        count
    }
}
