//! Drains every topic of the run, off the loops: hash, sequence audit, metrics, recording.

use super::hash::FlightHash;
use super::metrics::Metrics;
use super::services::is_flown;
use crate::record::{Recording, SequenceAudit, Stream, Verdict};
use runtime::Source as _;
use runtime::graph::{Marks, ROLES};
use runtime::ipc::{
    Bus, IpcSource, LatestPort, PortError, RECORDER_CAPACITY, ServiceKind, StateSubscriber,
};
use runtime::service::StateHeader;
use shared_types::wire::Value as _;
use shared_types::{Progress, Role, Sample, Topic, TopicVisitor, topics};

/// What is fed with every sample.
pub(super) struct Consumers {
    pub(super) hash: FlightHash,
    pub(super) audit: SequenceAudit,
    pub(super) metrics: Metrics,
    pub(super) recording: Option<Recording>,
    /// First error of the recording; the flight goes on without it.
    pub(super) recording_error: Option<String>,
}

impl Consumers {
    fn take<T: Sample>(&mut self, tap: (&'static Topic<T>, Stream), sample: &T, receipt_ns: u64) {
        let (topic, stream) = tap;
        let header = sample.header();
        let verdict = self.audit.observe(stream, header.seat, header.sequence, header.release_ns);
        if verdict == Verdict::Repeated {
            return;
        }
        self.hash.add(&topic.info, sample);
        self.metrics.observe(topic, sample);
        if let Some(recording) = &mut self.recording
            && let Err(error) = recording.write(topic, sample, receipt_ns)
        {
            self.fail_recording(&error.to_string());
        }
    }

    pub(super) fn fail_recording(&mut self, error: &str) {
        self.recording_error.get_or_insert_with(|| error.to_owned());
    }
}

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
            consumers.take((self.topic, self.stream), &stamped.sample, receipt_mono_ns);
            count += 1;
        }
        count
    }
}

struct Opener<'a> {
    bus: &'a Bus,
    roles: &'a [Role],
    audit: SequenceAudit,
    ports: Vec<Box<dyn TapPort>>,
}

impl TopicVisitor for Opener<'_> {
    type Error = PortError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), PortError> {
        if is_flown(&topic.info, self.roles) {
            let factory = self.bus.open_topic(topic)?;
            let source = IpcSource::with_capacity(&factory, RECORDER_CAPACITY)?;
            let stream = self.audit.register(topic.info.name);
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
    pub(super) fn open(
        bus: &Bus,
        roles: &[Role],
        recording: Option<Recording>,
        metrics: Metrics,
    ) -> Result<Self, PortError> {
        let audit = SequenceAudit::default();
        let mut opener = Opener { bus, roles, audit, ports: Vec::new() };
        topics::visit_all(&mut opener)?;
        let progress = roles
            .iter()
            .map(|&r| Ok((r, LatestPort::open(bus, ServiceKind::Progress(r))?)))
            .collect::<Result<_, PortError>>()?;
        let states = roles
            .iter()
            .map(|&r| Ok((r, StateSubscriber::open(bus, ServiceKind::State(r))?)))
            .collect::<Result<_, PortError>>()?;
        Ok(Self {
            ports: opener.ports,
            progress,
            states,
            last_states: vec![LastState::default(); ROLES],
            marks: [0; ROLES],
            consumers: Consumers {
                hash: FlightHash::default(),
                audit: opener.audit,
                metrics,
                recording,
                recording_error: None,
            },
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
                record_state(consumers, *role, header, bytes, now_mono_ns);
            }) {}
        }
        if let Some(recording) = &mut self.consumers.recording
            && let Err(error) = recording.flush_if_due(now_mono_ns)
        {
            self.consumers.fail_recording(&error.to_string());
        }
        self.marks = marks;
        count
    }
}

fn record_state(
    consumers: &mut Consumers,
    role: Role,
    header: &shared_types::Header,
    bytes: &[u8],
    now_mono_ns: u64,
) {
    let layout_hash = bytes
        .get(..StateHeader::PACKED_SIZE)
        .map_or(0, |head| StateHeader::unpack(head).layout_hash);
    if let Some(recording) = &mut consumers.recording
        && let Err(error) = recording.write_state(role, header, layout_hash, bytes, now_mono_ns)
    {
        consumers.fail_recording(&error.to_string());
    }
}
