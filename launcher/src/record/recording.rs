//! The recording of one flight as an MCAP file.

use super::error::words;
use super::messages::{self, Event};
use super::sink::{Sink, Valve};
use super::{Clock, Facts, RecordError, SequenceAudit, Stream, Verdict, encode, schema};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, McapResult, WriteOptions, Writer};
use prost_types::FileDescriptorSet;
use shared_types::topics::{Topic, TopicVisitor, visit_all};
use shared_types::{Header, Role, Sample};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Longest time that a killed recorder can lose [ns].
const FLUSH_EVERY_NS: u64 = 250_000_000;

type FileWriter = Writer<NoSeek<BufWriter<Sink>>>;

/// An open recording. It never ends silently: [`Recording::finish`] completes the file and tells
/// every error; dropped without it, the file stays what a killed recorder leaves, a readable
/// prefix that no reader takes for complete.
#[must_use = "a recording is complete only after `finish`"]
pub struct Recording {
    path: PathBuf,
    /// `None` once a write has failed.
    writer: Option<FileWriter>,
    valve: Valve,
    /// Why the recording stopped.
    failure: String,
    unrecorded: u64,
    channels: BTreeMap<&'static str, Channel>,
    states: BTreeMap<&'static str, Channel>,
    events_id: u16,
    audit: SequenceAudit,
    clock: Clock,
    epoch_unix_ns: u64,
    start_mono_ns: u64,
    last_flush_ns: Option<u64>,
    buffer: Vec<u8>,
}

impl std::fmt::Debug for Recording {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recording").field("path", &self.path).finish_non_exhaustive()
    }
}

/// A channel that carries headers, hence sequence numbers.
#[derive(Debug, Clone, Copy)]
struct Channel {
    id: u16,
    stream: Stream,
}

/// Time stamps of one record, Unix time [ns].
struct Stamps {
    log_ns: u64,
    publish_ns: u64,
}

impl Recording {
    /// Creates the file at `path`, which must not exist yet, and writes the facts of the run, the
    /// scenario and a channel for every topic of the floor plan.
    ///
    /// # Errors
    /// [`RecordError::Create`] or [`RecordError::Write`].
    pub fn create(path: &Path, facts: &Facts) -> Result<Self, RecordError> {
        let file = File::create_new(path)
            .map_err(|cause| RecordError::Create { path: path.to_owned(), cause })?;
        Self::over(Box::new(file), path, facts)
    }

    /// As [`Recording::create`], over any stream; `path` only names it in errors.
    pub(super) fn over(
        stream: Box<dyn Write + Send>,
        path: &Path,
        facts: &Facts,
    ) -> Result<Self, RecordError> {
        let valve = Valve::default();
        let sink = BufWriter::new(Sink::new(stream, valve.clone()));
        let opened = open(sink, facts).map_err(|cause| {
            valve.close();
            RecordError::write(path, cause)
        })?;
        Ok(Self {
            path: path.to_owned(),
            writer: Some(opened.writer),
            valve,
            failure: String::new(),
            unrecorded: 0,
            channels: opened.channels,
            states: opened.states,
            events_id: opened.events_id,
            audit: opened.audit,
            clock: facts.clock,
            epoch_unix_ns: facts.epoch_unix_ns,
            start_mono_ns: 0,
            last_flush_ns: None,
            buffer: Vec::with_capacity(64 * 1024),
        })
    }

    /// Realtime: tells `CLOCK_MONOTONIC` at logical time 0 [ns], before the first sample.
    pub fn set_start(&mut self, start_mono_ns: u64) {
        self.start_mono_ns = start_mono_ns;
    }

    /// Records a sample unless its producer repeats itself. `receipt_mono_ns` is the recorder's
    /// `CLOCK_MONOTONIC` when it took the sample [ns]; lockstep ignores it.
    ///
    /// # Errors
    /// [`RecordError::Write`], once; later samples are counted as missing.
    pub fn write<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        sample: &T,
        receipt_mono_ns: u64,
    ) -> Result<(), RecordError> {
        let Some(channel) = self.channels.get(topic.info.name).copied() else { return Ok(()) };
        let header = *sample.header();
        if self.is_repeated(channel, &header) {
            return Ok(());
        }
        self.buffer.clear();
        encode(sample, &mut self.buffer);
        self.put(channel, &header, receipt_mono_ns)
    }

    /// Records the packed state of the service that fills `role`, on `/state/<role>`.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn write_state(
        &mut self,
        role: Role,
        header: &Header,
        layout_hash: u64,
        bytes: &[u8],
        receipt_mono_ns: u64,
    ) -> Result<(), RecordError> {
        let Some(channel) = self.states.get(role.label()).copied() else { return Ok(()) };
        if self.is_repeated(channel, header) {
            return Ok(());
        }
        self.buffer.clear();
        messages::encode_state(header, layout_hash, bytes, &mut self.buffer);
        self.put(channel, header, receipt_mono_ns)
    }

    /// Records an event on `/events`.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn write_event(&mut self, event: &Event<'_>) -> Result<(), RecordError> {
        let since_start_ns = match self.clock {
            Clock::Lockstep => event.logical_ns,
            Clock::Realtime { speed } => wall_ns(event.logical_ns, speed),
        };
        let stamp_ns = self.epoch_unix_ns.saturating_add(since_start_ns);
        self.buffer.clear();
        messages::encode_log(event, stamp_ns, &mut self.buffer);
        let stamps = Stamps { log_ns: stamp_ns, publish_ns: stamp_ns };
        self.put_stamped(self.events_id, 0, &stamps)
    }

    /// Hands everything to the system if 250 ms have passed since it was last done, so that a
    /// killed recorder loses no more than that. Call it whenever the recorder has drained.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn flush_if_due(&mut self, now_mono_ns: u64) -> Result<(), RecordError> {
        let last_ns = *self.last_flush_ns.get_or_insert(now_mono_ns);
        if now_mono_ns.saturating_sub(last_ns) < FLUSH_EVERY_NS {
            return Ok(());
        }
        self.last_flush_ns = Some(now_mono_ns);
        match self.writer.as_mut().map(Writer::flush) {
            Some(Err(cause)) => Err(self.fail(cause)),
            _ => Ok(()),
        }
    }

    /// The audit so far.
    #[must_use]
    pub fn audit(&self) -> &SequenceAudit {
        &self.audit
    }

    /// Adds the metadata `summary` and `audit`, completes the file and hands back the audit.
    ///
    /// # Errors
    /// [`RecordError::Incomplete`] if the recording had stopped, else [`RecordError::Write`].
    pub fn finish(
        mut self,
        summary: &BTreeMap<String, String>,
    ) -> Result<SequenceAudit, RecordError> {
        let Some(writer) = self.writer.take() else {
            return Err(RecordError::Incomplete {
                path: std::mem::take(&mut self.path),
                cause: std::mem::take(&mut self.failure),
                unrecorded: self.unrecorded,
            });
        };
        complete(writer, summary, &self.audit, &self.valve)
            .map_err(|cause| RecordError::write(&self.path, cause))?;
        Ok(std::mem::take(&mut self.audit))
    }

    fn is_repeated(&mut self, channel: Channel, header: &Header) -> bool {
        let Header { sequence, release_ns, seat, .. } = *header;
        self.audit.observe(channel.stream, seat, sequence, release_ns) == Verdict::Repeated
    }

    fn put(
        &mut self,
        channel: Channel,
        header: &Header,
        receipt_mono_ns: u64,
    ) -> Result<(), RecordError> {
        let stamps = match self.clock {
            Clock::Lockstep => {
                let logical_ns = self.epoch_unix_ns.saturating_add(header.release_ns);
                Stamps { log_ns: logical_ns, publish_ns: logical_ns }
            }
            Clock::Realtime { .. } => {
                let unix_ns = |mono_ns: u64| {
                    self.epoch_unix_ns.saturating_add(mono_ns).saturating_sub(self.start_mono_ns)
                };
                let publish_mono_ns = header.publish_mono_ns;
                let log_ns = unix_ns(receipt_mono_ns.max(publish_mono_ns));
                Stamps { log_ns, publish_ns: unix_ns(publish_mono_ns) }
            }
        };
        #[expect(clippy::cast_possible_truncation, reason = "the file's field has 32 bits")]
        self.put_stamped(channel.id, header.sequence as u32, &stamps)
    }

    /// Writes what is in the buffer.
    fn put_stamped(
        &mut self,
        channel_id: u16,
        sequence: u32,
        stamps: &Stamps,
    ) -> Result<(), RecordError> {
        let Some(writer) = &mut self.writer else {
            self.unrecorded += 1;
            return Ok(());
        };
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time: stamps.log_ns,
            publish_time: stamps.publish_ns,
        };
        writer.write_to_known_channel(&header, &self.buffer).map_err(|cause| {
            self.unrecorded += 1;
            self.fail(cause)
        })
    }

    fn fail(&mut self, cause: mcap::McapError) -> RecordError {
        self.valve.close();
        self.writer = None;
        self.failure = words(&cause);
        RecordError::write(&self.path, cause)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        // The writer would finish the file and swallow the error.
        self.valve.close();
    }
}

struct Opened {
    writer: FileWriter,
    channels: BTreeMap<&'static str, Channel>,
    states: BTreeMap<&'static str, Channel>,
    events_id: u16,
    audit: SequenceAudit,
}

fn open(sink: BufWriter<Sink>, facts: &Facts) -> McapResult<Opened> {
    let mut writer = WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .chunk_size(Some(1 << 20))
        .disable_seeking(true)
        .calculate_chunk_crcs(true)
        .library(concat!("morphquad ", env!("CARGO_PKG_VERSION")))
        .create(NoSeek::new(sink))?;
    // First in the file, so that a crash keeps them.
    writer.write_metadata(&Metadata { name: "run".to_owned(), metadata: facts.to_metadata() })?;
    writer.attach(&Attachment {
        log_time: facts.epoch_unix_ns,
        create_time: facts.epoch_unix_ns,
        name: "scenario.toml".to_owned(),
        media_type: "application/toml".to_owned(),
        data: Cow::Borrowed(facts.scenario_toml.as_bytes()),
    })?;

    let mut registry =
        Registry { writer, audit: SequenceAudit::default(), channels: BTreeMap::new() };
    visit_all(&mut registry)?;
    let state = messages::state_descriptor();
    let mut states = BTreeMap::new();
    for role in Role::STEPPING {
        let name = format!("/state/{}", role.label());
        let about = BTreeMap::from([("from".to_owned(), role.label().to_owned())]);
        let channel = registry.add(name, (messages::STATE_NAME, &state), &about)?;
        states.insert(role.label(), channel);
    }
    let log = (messages::LOG_NAME, &messages::log_descriptor());
    let events_id = registry.add_unaudited("/events", log, &BTreeMap::new())?;
    let Registry { mut writer, audit, channels } = registry;
    writer.flush()?;
    Ok(Opened { writer, channels, states, events_id, audit })
}

/// Adds a channel for every topic.
struct Registry {
    writer: FileWriter,
    audit: SequenceAudit,
    channels: BTreeMap<&'static str, Channel>,
}

impl Registry {
    fn add_unaudited(
        &mut self,
        name: &str,
        (schema_name, set): (&str, &FileDescriptorSet),
        about: &BTreeMap<String, String>,
    ) -> McapResult<u16> {
        let data = prost::Message::encode_to_vec(set);
        let schema_id = self.writer.add_schema(schema_name, "protobuf", &data)?;
        self.writer.add_channel(schema_id, name, "protobuf", about)
    }

    fn add(
        &mut self,
        name: String,
        schema: (&str, &FileDescriptorSet),
        about: &BTreeMap<String, String>,
    ) -> McapResult<Channel> {
        let id = self.add_unaudited(&name, schema, about)?;
        Ok(Channel { id, stream: self.audit.register(name) })
    }
}

impl TopicVisitor for Registry {
    type Error = mcap::McapError;

    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> McapResult<()> {
        let info = &topic.info;
        let layout = topic.schema();
        let about = BTreeMap::from([
            ("summary".to_owned(), info.summary.to_owned()),
            ("from".to_owned(), info.from.label().to_owned()),
            ("layout_hash".to_owned(), format!("{:016x}", layout.layout_hash)),
        ]);
        let (name, set) = (schema::full_name(&layout), schema::descriptor_set(&layout));
        let channel = self.add(format!("/{}", info.name), (&name, &set), &about)?;
        self.channels.insert(info.name, channel);
        Ok(())
    }
}

fn complete(
    mut writer: FileWriter,
    summary: &BTreeMap<String, String>,
    audit: &SequenceAudit,
    valve: &Valve,
) -> McapResult<()> {
    let mut end = || -> McapResult<()> {
        let summary = Metadata { name: "summary".to_owned(), metadata: summary.clone() };
        writer.write_metadata(&summary)?;
        let audit = Metadata { name: "audit".to_owned(), metadata: audit.to_metadata() };
        writer.write_metadata(&audit)?;
        writer.finish()?;
        Ok(())
    };
    // Closed before the writer is dropped, which would try to finish once more.
    end().inspect_err(|_| valve.close())?;
    Ok(writer.into_inner().into_inner().flush()?)
}

/// Wall time that `logical_ns` takes at `speed`.
fn wall_ns(logical_ns: u64, speed: f64) -> u64 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a stamp for display; the cast saturates"
    )]
    let wall_ns = (logical_ns as f64 / speed) as u64;
    wall_ns
}
