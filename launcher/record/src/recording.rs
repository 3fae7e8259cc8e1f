//! The recording of one flight as an MCAP file.

use super::disk_sync::DiskSync;
use super::error::cause_text;
use super::messages::{self, Event};
use super::open::{Channel, FileWriter, open};
use super::sink::{Sink, Valve};
use super::{Clock, Facts, RecordError, SequenceAudit, SequenceCheck, content, encode};
use crate::scene::{self, Scene};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapResult};
use shared_types::topics::Topic;
use shared_types::{Header, Role, Sample};
use signal_hook::consts::SIGXFSZ;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};

/// An open recording. It never ends silently: [`Recording::finish`] completes the file and returns
/// every error; dropped without it, the file stays what a killed recorder leaves, a readable
/// prefix that no reader takes for complete.
#[must_use = "a recording is complete only after `finish`"]
pub struct Recording {
    path: PathBuf,
    /// `None` once a write has failed.
    writer: Option<FileWriter>,
    valve: Valve,
    /// Of a file that cannot be made again.
    disk_sync: Option<DiskSync>,
    /// Why the recording stopped.
    failure: String,
    /// Records asked for so far, and the newest release among them \[ns\].
    asked: (u64, u64),
    /// The same when everything was last handed to the system.
    flushed: (u64, u64),
    channels: BTreeMap<&'static str, Channel>,
    /// By the label of the role.
    state_ids: BTreeMap<&'static str, u16>,
    events_id: u16,
    scene: Scene,
    scene_ids: [u16; scene::CHANNELS.len()],
    audit: SequenceAudit,
    clock: Clock,
    epoch_unix_ns: u64,
    start_mono_ns: u64,
    buffer: Vec<u8>,
}

impl std::fmt::Debug for Recording {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recording").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Recording {
    /// Creates the file at `path`, which must not exist yet, and writes the facts of the run, the
    /// scenario and a channel for every topic of the floor plan.
    ///
    /// # Errors
    /// [`RecordError::Create`] or [`RecordError::Write`].
    pub fn create(path: &Path, facts: &Facts) -> Result<Self, RecordError> {
        let failed = |cause| RecordError::Create { path: path.to_owned(), cause };
        outlive_size_limits();
        let file = File::create_new(path).map_err(failed)?;
        let begun = || {
            let on_disk = file.try_clone().map_err(failed)?;
            let mut recording = Self::over(Box::new(file), path, facts)?;
            // What a power cut takes of a flight in lockstep can be flown again, and the disk would slow it.
            if let Clock::Realtime { .. } = facts.clock {
                let disk_sync = DiskSync::of(move || on_disk.sync_data()).map_err(failed)?;
                recording.disk_sync = Some(disk_sync);
            }
            Ok(recording)
        };
        begun().inspect_err(|_| {
            // A file without a beginning is none.
            let _ = std::fs::remove_file(path);
        })
    }

    /// As [`Recording::create`], over any stream; `path` only names it in errors.
    ///
    /// # Errors
    /// The stream does not take the beginning of a recording.
    pub fn over(
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
            disk_sync: None,
            failure: String::new(),
            asked: (0, 0),
            flushed: (0, 0),
            channels: opened.channels,
            state_ids: opened.state_ids,
            events_id: opened.events_id,
            scene: Scene::of(&facts.vehicle),
            scene_ids: opened.scene_ids,
            audit: opened.audit,
            clock: facts.clock,
            epoch_unix_ns: facts.epoch_unix_ns,
            start_mono_ns: 0,
            buffer: Vec::with_capacity(64 * 1024),
        })
    }

    /// Realtime: sets `CLOCK_MONOTONIC` at logical time 0 \[ns\], before the first sample.
    pub fn set_start(&mut self, start_mono_ns: u64) {
        self.start_mono_ns = start_mono_ns;
    }

    /// Records a sample unless its producer repeats itself, and what viewers are to draw of it.
    /// `receipt_mono_ns` is the recorder's `CLOCK_MONOTONIC` when it took the sample \[ns\]: in realtime it stamps what
    /// carries no stamp of its own, and lockstep ignores it.
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
        if self.is_repeated(channel, &header, content(&topic.info, sample)) {
            return Ok(());
        }
        self.buffer.clear();
        encode(sample, &mut self.buffer);
        self.put(channel.id, &header, receipt_mono_ns)?;
        if self.writer.is_some() {
            self.show(sample, receipt_mono_ns)?;
        }
        Ok(())
    }

    /// Records what is derived from a sample.
    fn show<T: Sample>(&mut self, sample: &T, receipt_mono_ns: u64) -> Result<(), RecordError> {
        let header = sample.header();
        let stamp_ns = self.stamp_ns(header, receipt_mono_ns);
        for (channel, message) in self.scene.observe(sample, self.instant_ns(header.release_ns)) {
            self.buffer.clear();
            self.buffer.extend_from_slice(&message);
            self.put_stamped(self.scene_ids[channel], short(header.sequence), stamp_ns)?;
        }
        Ok(())
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
        let Some(channel_id) = self.state_ids.get(role.label()).copied() else { return Ok(()) };
        self.buffer.clear();
        messages::encode_state(header, layout_hash, bytes, &mut self.buffer);
        self.put(channel_id, header, receipt_mono_ns)
    }

    /// Records an event on `/events`.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn write_event(&mut self, event: &Event<'_>) -> Result<(), RecordError> {
        let stamp_ns = self.instant_ns(event.logical_ns);
        self.buffer.clear();
        messages::encode_log(event, stamp_ns, &mut self.buffer);
        self.put_stamped(self.events_id, 0, stamp_ns)
    }

    /// Records a scenario that configures one controller alone.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn attach_scenario(&mut self, name: &str, text: &str) -> Result<(), RecordError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let attachment = Attachment {
            log_time: self.epoch_unix_ns,
            create_time: self.epoch_unix_ns,
            name: name.to_owned(),
            media_type: "application/toml".to_owned(),
            data: Cow::Borrowed(text.as_bytes()),
        };
        writer.attach(&attachment).map_err(|cause| self.fail(cause))
    }

    /// Hands everything to the system, unless nothing has been written yet; in realtime it is then put on the disk as well.
    ///
    /// # Errors
    /// As [`Recording::write`].
    pub fn flush(&mut self) -> Result<(), RecordError> {
        // A chunk without messages would be stamped 0.
        if self.asked.0 == 0 {
            return Ok(());
        }
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let request_sync = || self.disk_sync.as_ref().map_or(Ok(()), DiskSync::request);
        match writer.flush().and_then(|()| Ok(request_sync()?)) {
            Ok(()) => self.flushed = self.asked,
            Err(cause) => return Err(self.fail(cause)),
        }
        Ok(())
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
                until_ns: self.flushed.1,
                unrecorded: self.asked.0 - self.flushed.0,
            });
        };
        let disk_sync = self.disk_sync.take();
        complete(writer, summary, &self.audit, &self.valve)
            .and_then(|()| Ok(disk_sync.map_or(Ok(()), DiskSync::finish)?))
            .map_err(|cause| RecordError::write(&self.path, cause))?;
        Ok(std::mem::take(&mut self.audit))
    }

    fn is_repeated(&mut self, channel: Channel, header: &Header, content: u64) -> bool {
        self.audit.observe(channel.stream, header, content) == SequenceCheck::Repeated
    }

    fn put(
        &mut self,
        channel_id: u16,
        header: &Header,
        receipt_mono_ns: u64,
    ) -> Result<(), RecordError> {
        self.asked.1 = self.asked.1.max(header.release_ns);
        let stamp_ns = self.stamp_ns(header, receipt_mono_ns);
        self.put_stamped(channel_id, short(header.sequence), stamp_ns)
    }

    /// Unix time of a logical instant \[ns\].
    fn instant_ns(&self, logical_ns: u64) -> u64 {
        self.clock.unix_ns(self.epoch_unix_ns, logical_ns)
    }

    /// Unix time of a sample's publication \[ns\], in lockstep of its release: when the recorder looked is nothing that a
    /// viewer should draw a signal by.
    fn stamp_ns(&self, header: &Header, receipt_mono_ns: u64) -> u64 {
        match self.clock {
            Clock::Lockstep => self.epoch_unix_ns.saturating_add(header.release_ns),
            Clock::Realtime { .. } => {
                // Samples of the launcher and deviations carry no stamp of their own.
                let publish_mono_ns = match header.publish_mono_ns {
                    0 => receipt_mono_ns,
                    stamped => stamped,
                };
                self.epoch_unix_ns
                    .saturating_add(publish_mono_ns)
                    .saturating_sub(self.start_mono_ns)
            }
        }
    }

    /// Writes what is in the buffer.
    fn put_stamped(
        &mut self,
        channel_id: u16,
        sequence: u32,
        stamp_ns: u64,
    ) -> Result<(), RecordError> {
        self.asked.0 += 1;
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let header =
            MessageHeader { channel_id, sequence, log_time: stamp_ns, publish_time: stamp_ns };
        writer.write_to_known_channel(&header, &self.buffer).map_err(|cause| self.fail(cause))
    }

    fn fail(&mut self, cause: mcap::McapError) -> RecordError {
        self.valve.close();
        self.writer = None;
        self.failure = cause_text(&cause);
        RecordError::write(&self.path, cause)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        // The writer would finish the file and swallow the error.
        self.valve.close();
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

/// A limit on the size of files is an error of the write, not the end of the flight.
fn outlive_size_limits() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
    });
}

/// A sequence number as the file has it.
#[expect(clippy::cast_possible_truncation, reason = "the file's field has 32 bits")]
fn short(sequence: u64) -> u32 {
    sequence as u32
}
