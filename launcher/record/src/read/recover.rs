//! Whatever a killed recorder has left, as a complete file: with an index, which viewers want, and the
//! audit of what is there.

use super::ReadError;
use super::records::{Ending, Records};
use crate::decode::{Fields, decode};
use crate::open::options;
use crate::{SequenceAudit, SequenceCheck, Stream};
use core::ops::ControlFlow;
use mcap::records::{MessageHeader, Metadata, Record};
use mcap::{Attachment, McapError, Writer};
use shared_types::Header;
use std::collections::BTreeMap;
use std::fs::File;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Name of the metadata that marks a recovery; such a file counts as cut.
pub(super) const RECOVERED: &str = "recovered";
/// Name of the metadata that counts every sequence.
const AUDIT: &str = "audit";

/// Why nothing is recovered.
#[derive(Debug, Error)]
pub enum RecoverError {
    /// It cannot be read at all.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// There is nothing to do.
    #[error("{} is complete: there is nothing to recover", path.display())]
    Complete {
        /// The file.
        path: PathBuf,
    },
    /// Nothing is written over.
    #[error("{} is there already: name a new file with --out, or remove this one", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The new file cannot be written.
    #[error("cannot write {}: {}; name another file with --out", path.display(), what_of(cause))]
    Write {
        /// The new file.
        path: PathBuf,
        /// Why.
        cause: McapError,
    },
}

/// What was recovered.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Messages in the new file.
    pub messages: u64,
    /// Sequence numbers that are missing in it.
    pub gaps: u64,
    /// Release of the last sample \[ns\].
    pub end_ns: u64,
    /// What is wrong with the old file, if it was not cut cleanly.
    pub damage: Option<Damage>,
}

/// What is wrong with a file that is not as it was written.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Damage {
    /// The first that was found.
    pub first: String,
    /// Records and chunks left out, behind which more could be read.
    pub left_out: u64,
    /// The damage behind which nothing could, if there is one.
    pub end: Option<String>,
    /// Messages left out because nothing shows any more what they are.
    pub unknown: u64,
}

/// The system's error, where there is one.
fn what_of(cause: &McapError) -> &dyn core::fmt::Display {
    if let McapError::Io(cause) = cause { cause } else { cause }
}

/// Writes what can be read of `from`, which is cut or damaged, into `to`, which must not exist yet.
///
/// # Errors
/// [`RecoverError`]; a new file that could not be completed is removed.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, RecoverError> {
    let damage = look_through(from)?;
    let write = |cause| RecoverError::Write { path: to.to_owned(), cause };
    let file = File::create_new(to).map_err(|cause| match cause.kind() {
        io::ErrorKind::AlreadyExists => RecoverError::Exists { path: to.to_owned() },
        _ => write(McapError::Io(cause)),
    })?;
    let recovered = copy(from, damage, file, &write);
    if recovered.is_err() {
        // What made it fail is reported; that the remains stay would be the lesser evil.
        let _ = std::fs::remove_file(to);
    }
    recovered
}

/// Finds out whether there is something to recover, and from what: its first damage, if it is not just
/// cut.
fn look_through(from: &Path) -> Result<Option<ReadError>, RecoverError> {
    let (mut is_ours, mut messages) = (false, 0_u64);
    let records = Records::open(from)?;
    let length = records.length();
    let foreign = || ReadError::Foreign {
        path: from.to_owned(),
        what: "the metadata `run` is missing".to_owned(),
    };
    let read = records.for_each(|record| {
        is_ours |= is_fact(&record);
        if let Record::Message { .. } = record {
            messages += 1;
            if !is_ours {
                return Err(foreign());
            }
        }
        Ok(ControlFlow::Continue(()))
    });
    match read {
        Ok(Ending::Whole) if !is_ours => Err(foreign().into()),
        Ok(Ending::Whole) => Err(RecoverError::Complete { path: from.to_owned() }),
        Ok(Ending::Cut) if messages == 0 => {
            let (path, what) = (from.to_owned(), "everything but the head".to_owned());
            Err(ReadError::CutHead { path, length, what }.into())
        }
        Ok(Ending::Cut) => Ok(None),
        Err(damage @ ReadError::Damaged { .. }) => Ok(Some(damage)),
        Err(error) => Err(error.into()),
    }
}

/// Describes damage without a remedy, which has been found.
fn describe(error: &ReadError) -> String {
    match error {
        ReadError::Damaged { at, length, what, .. } => {
            format!("damaged near byte {at} of {length}: {what}")
        }
        error => error.to_string(),
    }
}

/// The facts of a flight, which come first in its file.
fn is_fact(record: &Record<'_>) -> bool {
    matches!(record, Record::Metadata(metadata) if metadata.name == "run")
}

fn copy(
    from: &Path,
    damage: Option<ReadError>,
    file: File,
    write: &dyn Fn(McapError) -> RecoverError,
) -> Result<Recovered, RecoverError> {
    let writer = options().create(BufWriter::new(file)).map_err(write)?;
    let mut copy = Copy::of(writer);
    let (mut failure, mut left_out) = (None, 0);
    if damage.is_some() {
        // The pass below reports where it ends.
        let _ = Records::open(from)?.around_damage(&mut 0, |record| {
            copy.learn(record);
            Ok(())
        });
    }
    let read = Records::open(from)?.around_damage(&mut left_out, |record| {
        if failure.is_none() {
            failure = copy.take(record).err();
        }
        Ok(())
    });
    if let Some(cause) = failure {
        return Err(write(cause));
    }
    let end = match read {
        Err(error @ ReadError::Damaged { .. }) => Some(describe(&error)),
        read => read.map(|_| None)?,
    };
    if let Some(error) = damage {
        if !copy.is_ours || copy.recovered.messages == 0 {
            return Err(error.into());
        }
        let (first, unknown) = (describe(&error), copy.unknown);
        // A copy of a copy lacks what that one has lacked.
        let left_out = copy.left_out_before.saturating_add(left_out);
        copy.recovered.damage = Some(Damage { first, left_out, end, unknown });
    }
    copy.finish(from).map_err(write)
}

/// A channel of both files.
struct Channel {
    id: u16,
    /// Of those with headers.
    stream: Option<Stream>,
}

struct Copy {
    /// The facts of a flight have been met, which come first.
    is_ours: bool,
    writer: Writer<BufWriter<File>>,
    /// New by old.
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, Channel>,
    /// What the old file has about them anywhere: a damaged chunk's channels stand once more at its end.
    elsewhere: BTreeMap<(u8, u16), Record<'static>>,
    audit: SequenceAudit,
    recovered: Recovered,
    /// Messages of channels of which nothing is known.
    unknown: u64,
    /// Parts that the old file lacks already, being a copy itself.
    left_out_before: u64,
}

impl Copy {
    fn of(writer: Writer<BufWriter<File>>) -> Self {
        Self {
            is_ours: false,
            writer,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            elsewhere: BTreeMap::new(),
            audit: SequenceAudit::default(),
            recovered: Recovered::default(),
            unknown: 0,
            left_out_before: 0,
        }
    }

    /// Remembers what the old file has about a channel or its type.
    fn learn(&mut self, record: Record<'_>) {
        let id = match &record {
            Record::Schema { header, .. } => header.id,
            Record::Channel(channel) => channel.id,
            _ => return,
        };
        self.elsewhere.insert((record.opcode(), id), record.into_owned());
    }

    /// Takes over what is known of channels from elsewhere alone: a reader wants all before any message.
    fn complete_channels(&mut self) -> Result<(), McapError> {
        if self.elsewhere.is_empty() {
            return Ok(());
        }
        let (channels, schemas): (Vec<_>, Vec<_>) = core::mem::take(&mut self.elsewhere)
            .into_values()
            .partition(|record| matches!(record, Record::Channel(_)));
        let is_new = |record: &Record<'_>, known: &Self| match record {
            Record::Schema { header, .. } => !known.schemas.contains_key(&header.id),
            Record::Channel(channel) => !known.channels.contains_key(&channel.id),
            _ => false,
        };
        for record in schemas.into_iter().chain(channels) {
            if is_new(&record, self) {
                self.take(record)?;
            }
        }
        Ok(())
    }

    fn take(&mut self, record: Record<'_>) -> Result<(), McapError> {
        match record {
            Record::Schema { header, data } => {
                let id = self.writer.add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(old) => {
                let schema = self.schemas.get(&old.schema_id).copied().unwrap_or(0);
                let (topic, about) = (&old.topic, &old.metadata);
                let id = self.writer.add_channel(schema, topic, &old.message_encoding, about)?;
                // A recording has some of the states alone.
                let has_header = about.contains_key("layout_hash");
                let known = self.channels.remove(&old.id).and_then(|channel| channel.stream);
                let stream =
                    known.or_else(|| has_header.then(|| self.audit.register(topic.as_str())));
                self.channels.insert(old.id, Channel { id, stream });
            }
            Record::Message { header, data } => self.message(header, &data)?,
            // Of what the old file held, which this one may not.
            Record::Metadata(metadata) if metadata.name == AUDIT => {}
            Record::Metadata(metadata) if metadata.name == RECOVERED => {
                let left_out = metadata.metadata.get("left_out").and_then(|text| text.parse().ok());
                self.left_out_before = left_out.unwrap_or(0);
            }
            Record::Metadata(metadata) => {
                self.is_ours |= metadata.name == "run";
                self.writer.write_metadata(&metadata)?;
            }
            Record::Attachment { header, data, .. } => self.writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            })?,
            _ => {}
        }
        Ok(())
    }

    fn message(&mut self, mut header: MessageHeader, data: &[u8]) -> Result<(), McapError> {
        self.complete_channels()?;
        let Some(channel) = self.channels.get(&header.channel_id) else {
            self.unknown += 1;
            return Ok(());
        };
        if let Some(stream) = channel.stream
            && let Some(sample) = sample_header(data)
        {
            // Whatever differs: what was no repetition when it was recorded is none here.
            let mut content = DefaultHasher::new();
            data.hash(&mut content);
            let check = self.audit.observe(stream, &sample, content.finish());
            if check == SequenceCheck::Repeated {
                return Ok(());
            }
            self.recovered.end_ns = self.recovered.end_ns.max(sample.release_ns);
        }
        header.channel_id = channel.id;
        self.recovered.messages += 1;
        self.writer.write_to_known_channel(&header, data)
    }

    fn finish(mut self, from: &Path) -> Result<Recovered, McapError> {
        let gaps = self.audit.tallies().map(|(.., tally)| tally.gaps);
        self.recovered.gaps = gaps.fold(0, u64::saturating_add);
        let name = from.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut about = BTreeMap::from([("from".to_owned(), name)]);
        if let Some(damage) = &self.recovered.damage {
            about.insert("damage".to_owned(), damage.first.clone());
            about.insert("left_out".to_owned(), damage.left_out.to_string());
        } else if self.left_out_before > 0 {
            about.insert("left_out".to_owned(), self.left_out_before.to_string());
        }
        for (name, metadata) in [(AUDIT, self.audit.to_metadata()), (RECOVERED, about)] {
            self.writer.write_metadata(&Metadata { name: name.to_owned(), metadata })?;
        }
        self.writer.finish()?;
        Ok(self.recovered)
    }
}

/// The header that every sample and state begins with.
fn sample_header(data: &[u8]) -> Option<Header> {
    decode(Fields::new("message", data).delimited(1, "header").ok()?).ok()
}
