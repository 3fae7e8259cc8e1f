//! Where everything goes that a flight publishes: hash, sequence audit, metrics, recording.

use super::summary::Summary;
use observe::stopwatch::Stopwatch;
use observe::{FlightHash, LogHash, Metrics, News, Observer};
use protocol::topic::feed::{Ending, Feed};
use record::read::seat_config;
use record::{Event, Keyframes, Recorder, SequenceAudit, SequenceCheck, Severity, Stream, content};
use runtime::StateHeader;
use shared_types::{Header, Role, Sample, Seat, Seating, Slot, Topic, TopicInfo, topics};
use swap::SlotWatch;

/// A recording in lockstep stamps with logical time and asks for no receipt \[ns\].
const NO_RECEIPT_NS: u64 = 0;

/// Source of what the launcher itself has seen.
const LAUNCHER: &str = "launcher";

/// Takes every sample and every state of a flight, in whatever order topics are drained.
#[derive(Debug, Default)]
pub struct Sinks {
    /// Hash of what was flown.
    pub hash: FlightHash,
    /// Hash of every sample.
    pub log_hash: LogHash,
    /// Sequence numbers of all topics.
    pub audit: SequenceAudit,
    /// What is measured of it so far.
    pub metrics: Metrics,
    /// The recording, if there is one.
    pub recording: Option<Recorder>,
    /// First error of the recording; the flight goes on without it.
    pub recording_error: Option<String>,
    /// What the slots want to know; none if no controllers command them by turns.
    pub slot_watch: Option<SlotWatch>,
    /// Keeps stamps for a measurement; none if there is none.
    pub stopwatch: Option<Stopwatch>,
    /// Lets others look on; none in one process.
    pub feed: Option<Feed>,
    /// Topics of the flight, under audit.
    streams: Vec<(&'static TopicInfo, Stream)>,
    /// Which states have been recorded.
    keyframes: Keyframes,
}

impl Sinks {
    /// For a flight in which `roles` take part.
    #[must_use]
    pub fn new(roles: &[Role], metrics: Metrics, recording: Option<Recorder>) -> Self {
        let mut audit = SequenceAudit::default();
        let flown = topics::all().into_iter().filter(|topic| is_flown(topic, roles));
        let streams = flown.map(|topic| (topic, audit.register(topic.name))).collect();
        Self { audit, metrics, recording, streams, ..Self::default() }
    }

    /// Audit of a topic that belongs to the flight.
    #[must_use]
    pub fn stream(&self, topic: &'static TopicInfo) -> Option<Stream> {
        // The table is static: a topic has one address.
        let mut streams = self.streams.iter();
        streams.find(|(known, _)| core::ptr::eq(*known, topic)).map(|(_, stream)| *stream)
    }

    /// Takes a sample that the recorder received at `receipt_mono_ns` \[ns\].
    pub fn take<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        stream: Stream,
        sample: &T,
        receipt_mono_ns: u64,
    ) {
        let verdict = self.audit.observe(stream, sample.header(), content(&topic.info, sample));
        if verdict == SequenceCheck::Repeated {
            return;
        }
        self.hash.add(&topic.info, sample);
        self.log_hash.add(&topic.info, sample);
        self.metrics.observe(topic, sample);
        if let Some(stopwatch) = &mut self.stopwatch {
            stopwatch.observe(topic, sample);
        }
        if let Some(watch) = &mut self.slot_watch {
            watch.observe(sample);
        }
        if let Some(feed) = &self.feed {
            feed.offer(topic, sample);
        }
        for News { at_ns, severity, source, text } in self.metrics.take_news() {
            self.note(at_ns, severity, source, &text);
        }
        if let Some(recording) = &mut self.recording
            && let Err(error) = recording.write(topic, sample, receipt_mono_ns)
        {
            self.fail_recording(&error.to_string());
        }
    }

    /// Records which process takes a slot's seat, as the supervisor reports it.
    pub fn record_seating(&mut self, seating: &Seating, now_mono_ns: u64) {
        if let Some(stream) = self.stream(&topics::SEATING.info) {
            self.take(&topics::SEATING, stream, seating, now_mono_ns);
        }
    }

    /// Takes the scenario that configures the process that has taken a seat.
    pub fn attach_config(&mut self, seating: &Seating, text: &str) {
        let name =
            seat_config(Seat { role: seating.role, index: seating.seat }, seating.generation);
        if let Some(recording) = &mut self.recording
            && let Err(error) = recording.attach_scenario(&name, text)
        {
            self.fail_recording(&error.to_string());
        }
    }

    /// True if a packed state is to be recorded.
    #[must_use]
    pub fn wants_state(&self, role: Role, header: &Header) -> bool {
        self.recording.is_some() && self.keyframes.is_due(role, header)
    }

    /// Takes a packed state, if it is to be recorded.
    pub fn take_state(&mut self, role: Role, header: &Header, bytes: &[u8], receipt_mono_ns: u64) {
        let deviations = StateHeader::of(bytes).map_or(0, |head| head.deviation_sequence);
        if self.wants_state(role, header) || self.keyframes.is_behind(role, header, deviations) {
            self.keep_state(role, header, bytes, receipt_mono_ns);
        }
    }

    /// Takes a packed state that a replay cannot do without: one that a process goes on from, or the last of one.
    pub fn keep_state(&mut self, role: Role, header: &Header, bytes: &[u8], receipt_mono_ns: u64) {
        let Some(recording) = &mut self.recording else { return };
        let head = StateHeader::of(bytes).unwrap_or_default();
        if !self.keyframes.note(role, header, head.deviation_sequence) {
            return;
        }
        let written = recording.write_state(role, header, head.layout_hash, bytes, receipt_mono_ns);
        if let Err(error) = written {
            self.fail_recording(&error.to_string());
        }
    }

    /// Writes a sentence about the flight into the recording.
    pub fn inform(&mut self, logical_ns: u64, text: &str) {
        self.note(logical_ns, Severity::Info, LAUNCHER, text);
    }

    /// Writes an event of `source` into the recording, and sends it to the clients that listen.
    pub fn note(&mut self, logical_ns: u64, severity: Severity, source: &str, text: &str) {
        let event = Event { logical_ns, severity, source, text };
        if let Some(feed) = &self.feed {
            feed.publish(&event);
        }
        if let Some(recording) = &mut self.recording
            && let Err(error) = recording.write_event(&event)
        {
            self.fail_recording(&error.to_string());
        }
    }

    /// Lets the recording reach the disk now and then.
    pub fn flush_if_due(&mut self, now_mono_ns: u64) {
        if let Some(recording) = &mut self.recording
            && let Err(error) = recording.flush_if_due(now_mono_ns)
        {
            self.fail_recording(&error.to_string());
        }
    }

    /// Keeps the first error of the recording.
    pub fn fail_recording(&mut self, error: &str) {
        self.recording_error.get_or_insert_with(|| error.to_owned());
    }

    /// Writes the summary into the recording and closes it, and sends the clients that listen how it ended.
    pub fn finish(&mut self, summary: &mut Summary) {
        let severity = if summary.verdict().passed() { Severity::Info } else { Severity::Error };
        self.note(summary.flown_ns, severity, LAUNCHER, &summary.line());
        if let Some(recording) = self.recording.take()
            && let Err(error) = recording.finish(&summary.to_metadata())
        {
            // It reports again why the recording stopped, and what it lacks.
            summary.recording_error = Some(error.to_string());
        }
        if let Some(feed) = &self.feed {
            feed.end(&Ending { is_good: summary.verdict().passed(), text: summary.line() });
        }
    }
}

/// A flight in one process is drained as it is published.
impl Observer for Sinks {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        if let Some(stream) = self.stream(&topic.info) {
            self.take(topic, stream, sample, NO_RECEIPT_NS);
        }
    }

    fn wants_states(&self) -> bool {
        self.recording.is_some()
    }

    fn wants_state(&self, role: Role, header: &Header) -> bool {
        Self::wants_state(self, role, header)
    }

    fn observe_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        self.take_state(role, header, state, NO_RECEIPT_NS);
    }

    fn keep_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        Self::keep_state(self, role, header, state, NO_RECEIPT_NS);
    }

    fn note(&mut self, logical_ns: u64, warning: bool, text: &str) {
        let severity = if warning { Severity::Warning } else { Severity::Info };
        Self::note(self, logical_ns, severity, LAUNCHER, text);
    }
}

/// True if a topic's samples belong to a flight in which `roles` take part.
fn is_flown(topic: &TopicInfo, roles: &[Role]) -> bool {
    let stand_in = Slot::of(topic.from).and_then(|slot| slot.spec().stand_in);
    topic.from == Role::Supervisor
        || roles.contains(&topic.from)
        || stand_in.is_some_and(|role| roles.contains(&role))
}
