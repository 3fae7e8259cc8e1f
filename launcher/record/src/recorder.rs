//! A recording that is written by a thread of its own.
//!
//! The thread that takes the samples of a flight copies them into a batch; encoding, compression and the disk are the
//! writer's. A few batches go back and forth, so that memory is bounded and nothing is allocated once they have grown:
//! where the writer cannot keep up, the next batch is waited for and nothing is lost.

use super::{Event, Facts, RecordError, Recording, Severity};
use shared_types::topics::Topic;
use shared_types::{Header, Role, Sample};
use std::any::Any;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};

/// Longest time that a killed recorder can lose, besides what is in its batches; a power cut takes what the disk has not
/// finished as well \[ns\].
const FLUSH_EVERY_NS: u64 = 50_000_000;
/// Batches that go back and forth.
const BATCHES: usize = 4;
/// Bytes of samples and states after which a batch is handed over.
const BATCH_BYTES: usize = 256 << 10;

/// Hands a flight to the thread that writes its recording. Dropped without [`finish`](Self::finish), it leaves the file
/// as a dropped [`Recording`] does.
#[must_use = "a recording is complete only after `finish`"]
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    batch: Batch,
    /// `None` once the writer is to leave.
    full: Option<Sender<Batch>>,
    empty: Receiver<Batch>,
    writer: Option<JoinHandle<Recording>>,
    /// First error of the writer, not returned yet.
    failure: Option<RecordError>,
    last_flush_ns: Option<u64>,
}

impl Recorder {
    /// As [`Recording::create`], with its writer.
    ///
    /// # Errors
    /// As [`Recording::create`]; or no thread can be had, and there is no file then.
    pub fn create(path: &Path, facts: &Facts) -> Result<Self, RecordError> {
        let recording = Recording::create(path, facts)?;
        Self::start(recording, path).inspect_err(|_| {
            let _ = std::fs::remove_file(path);
        })
    }

    /// Starts the writer of a recording at `path`.
    ///
    /// # Errors
    /// No thread can be had.
    pub fn start(recording: Recording, path: &Path) -> Result<Self, RecordError> {
        let path = path.to_owned();
        let (full, batches) = channel::<Batch>();
        let (done, empty) = channel();
        for _ in 1..BATCHES {
            // The other end is in this function.
            let _ = done.send(Batch::default());
        }
        let write = move || {
            let mut recording = recording;
            for mut batch in batches {
                batch.write(&mut recording);
                if done.send(batch).is_err() {
                    break;
                }
            }
            recording
        };
        let started = Builder::new().name("recording".to_owned()).spawn(write);
        let failed = |cause| RecordError::Create { path: path.clone(), cause };
        let writer = Some(started.map_err(failed)?);
        let batch = Batch::default();
        let full = Some(full);
        Ok(Self { path, batch, full, empty, writer, failure: None, last_flush_ns: None })
    }

    /// As [`Recording::set_start`].
    pub fn set_start(&mut self, start_mono_ns: u64) {
        self.batch.items.push(Item::Entry(Box::new(Entry::Start(start_mono_ns))));
    }

    /// As [`Recording::write`].
    ///
    /// # Errors
    /// What the writer has met since the last call, once.
    pub fn write<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        sample: &T,
        receipt_mono_ns: u64,
    ) -> Result<(), RecordError> {
        self.batch.add_sample(topic, sample, receipt_mono_ns);
        self.hand_over_if_full()
    }

    /// As [`Recording::write_state`].
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_state(
        &mut self,
        role: Role,
        header: &Header,
        layout_hash: u64,
        bytes: &[u8],
        receipt_mono_ns: u64,
    ) -> Result<(), RecordError> {
        self.batch.packed.extend_from_slice(bytes);
        let header = *header;
        let length = bytes.len();
        self.batch.states.push(State { role, header, layout_hash, length, receipt_mono_ns });
        self.batch.items.push(Item::State);
        self.batch.bytes += length;
        self.hand_over_if_full()
    }

    /// As [`Recording::write_event`].
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_event(&mut self, event: &Event<'_>) -> Result<(), RecordError> {
        let Event { logical_ns, severity, source, text } = *event;
        let (source, text) = (source.to_owned(), text.to_owned());
        self.batch.bytes += text.len();
        let entry = Entry::Event { logical_ns, severity, source, text };
        self.batch.items.push(Item::Entry(Box::new(entry)));
        self.hand_over_if_full()
    }

    /// As [`Recording::attach_scenario`].
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn attach_scenario(&mut self, name: &str, text: &str) -> Result<(), RecordError> {
        self.batch.bytes += text.len();
        let entry = Entry::Scenario { name: name.to_owned(), text: text.to_owned() };
        self.batch.items.push(Item::Entry(Box::new(entry)));
        self.hand_over_if_full()
    }

    /// As [`Recording::flush`] of what has been taken so far, if 50 ms have passed since it was last done, so that a killed
    /// recorder loses little more than that. Call it whenever the recorder has drained.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn flush_if_due(&mut self, now_mono_ns: u64) -> Result<(), RecordError> {
        let last_ns = *self.last_flush_ns.get_or_insert(now_mono_ns);
        if now_mono_ns.saturating_sub(last_ns) >= FLUSH_EVERY_NS {
            self.last_flush_ns = Some(now_mono_ns);
            self.batch.flushes = true;
            self.hand_over();
        }
        self.take_failure()
    }

    /// As [`Recording::finish`], once everything has been written.
    ///
    /// # Errors
    /// As [`Recording::finish`].
    pub fn finish(mut self, summary: &BTreeMap<String, String>) -> Result<(), RecordError> {
        self.hand_over();
        self.full = None;
        let written = self.writer.take().and_then(|writer| writer.join().ok());
        let recording = written.ok_or_else(|| self.stopped())?;
        recording.finish(summary).map(drop)
    }

    fn hand_over_if_full(&mut self) -> Result<(), RecordError> {
        if self.batch.bytes >= BATCH_BYTES {
            self.hand_over();
        }
        self.take_failure()
    }

    /// Gives the batch to the writer and takes an empty one, for which it waits if the writer is behind.
    fn hand_over(&mut self) {
        let batch = core::mem::take(&mut self.batch);
        let is_sent = self.full.as_ref().is_some_and(|full| full.send(batch).is_ok());
        match self.empty.recv() {
            Ok(mut batch) => {
                if let Some(failure) = batch.failure.take() {
                    self.failure.get_or_insert(failure);
                }
                self.batch = batch;
            }
            // It is reported once: afterwards there is no writer to send anything to.
            Err(_) if is_sent || self.full.is_some() => {
                self.full = None;
                let stopped = self.stopped();
                self.failure.get_or_insert(stopped);
            }
            Err(_) => {}
        }
    }

    fn take_failure(&mut self) -> Result<(), RecordError> {
        self.failure.take().map_or(Ok(()), Err)
    }

    /// The writer is gone, which only a panic of it can do.
    fn stopped(&self) -> RecordError {
        RecordError::write(&self.path, io::Error::other("its writer has stopped"))
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.full = None;
        if let Some(writer) = self.writer.take() {
            // The recording is dropped with it.
            let _ = writer.join();
        }
    }
}

/// What a flight has published, in order.
#[derive(Debug, Default)]
struct Batch {
    items: Vec<Item>,
    /// By the number of the topic.
    lanes: Vec<Option<Box<dyn Lane>>>,
    states: Vec<State>,
    /// The bytes of the states, one after the other.
    packed: Vec<u8>,
    /// Bytes of samples and states.
    bytes: usize,
    /// What is written is then handed to the system.
    flushes: bool,
    /// The first error of writing it.
    failure: Option<RecordError>,
}

/// What comes next.
#[derive(Debug)]
enum Item {
    /// A sample of the topic with this number.
    Sample(usize),
    State,
    Entry(Box<Entry>),
}

/// What is written now and then.
#[derive(Debug)]
enum Entry {
    Start(u64),
    Event { logical_ns: u64, severity: Severity, source: String, text: String },
    Scenario { name: String, text: String },
}

#[derive(Debug)]
struct State {
    role: Role,
    header: Header,
    layout_hash: u64,
    length: usize,
    receipt_mono_ns: u64,
}

impl Batch {
    fn add_sample<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        sample: &T,
        receipt_mono_ns: u64,
    ) {
        let number = usize::try_from(topic.info.id).unwrap_or_default();
        if number >= self.lanes.len() {
            self.lanes.resize_with(number + 1, || None);
        }
        let lane = self.lanes[number].get_or_insert_with(|| Box::new(Samples::of(topic)));
        if let Some(lane) = lane.as_any().downcast_mut::<Samples<T>>() {
            lane.samples.push((*sample, receipt_mono_ns));
            self.items.push(Item::Sample(number));
            self.bytes += size_of::<T>();
        }
    }

    /// Writes everything and is empty then.
    fn write(&mut self, recording: &mut Recording) {
        let (mut states, mut packed) = (self.states.drain(..), self.packed.as_slice());
        for item in self.items.drain(..) {
            let written = match item {
                Item::Sample(number) => match self.lanes.get_mut(number) {
                    Some(Some(lane)) => lane.write_next(recording),
                    _ => Ok(()),
                },
                Item::State => match states.next() {
                    Some(state) => {
                        let State { role, header, layout_hash, length, receipt_mono_ns } = state;
                        let (bytes, rest) = packed.split_at(length.min(packed.len()));
                        packed = rest;
                        recording.write_state(role, &header, layout_hash, bytes, receipt_mono_ns)
                    }
                    None => Ok(()),
                },
                Item::Entry(entry) => entry.write(recording),
            };
            if let Err(error) = written {
                self.failure.get_or_insert(error);
            }
        }
        drop(states);
        self.packed.clear();
        self.bytes = 0;
        if core::mem::take(&mut self.flushes)
            && let Err(error) = recording.flush()
        {
            self.failure.get_or_insert(error);
        }
    }
}

impl Entry {
    fn write(&self, recording: &mut Recording) -> Result<(), RecordError> {
        match self {
            Self::Start(start_mono_ns) => {
                recording.set_start(*start_mono_ns);
                Ok(())
            }
            Self::Event { logical_ns, severity, source, text } => recording.write_event(&Event {
                logical_ns: *logical_ns,
                severity: *severity,
                source,
                text,
            }),
            Self::Scenario { name, text } => recording.attach_scenario(name, text),
        }
    }
}

/// The samples of one topic with their type forgotten.
trait Lane: core::fmt::Debug + Send {
    fn as_any(&mut self) -> &mut dyn Any;
    /// Writes the next one; the last one leaves it empty.
    fn write_next(&mut self, recording: &mut Recording) -> Result<(), RecordError>;
}

struct Samples<T: Sample> {
    topic: &'static Topic<T>,
    /// With when the recorder took them \[ns\].
    samples: Vec<(T, u64)>,
    written: usize,
}

impl<T: Sample> core::fmt::Debug for Samples<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Samples").field(&self.topic.info.name).field(&self.samples.len()).finish()
    }
}

impl<T: Sample> Samples<T> {
    fn of(topic: &'static Topic<T>) -> Self {
        Self { topic, samples: Vec::new(), written: 0 }
    }
}

impl<T: Sample> Lane for Samples<T> {
    fn as_any(&mut self) -> &mut dyn Any {
        self
    }

    fn write_next(&mut self, recording: &mut Recording) -> Result<(), RecordError> {
        let Some((sample, receipt_mono_ns)) = self.samples.get(self.written) else { return Ok(()) };
        let written = recording.write(self.topic, sample, *receipt_mono_ns);
        self.written += 1;
        if self.written == self.samples.len() {
            self.samples.clear();
            self.written = 0;
        }
        written
    }
}
