//! Whatever a killed recorder has left, as a complete file: with an index, which viewers want, and the
//! audit of what is there.

use super::ReadError;
use super::records::{Ending, Records};
use crate::record::decode::{Fields, decode};
use crate::record::open::options;
use crate::record::{SequenceAudit, Stream, Verdict};
use core::ops::ControlFlow;
use mcap::records::{MessageHeader, Metadata, Record};
use mcap::{Attachment, McapError, Writer};
use shared_types::Header;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Name of the metadata that tells of a recovery; such a file counts as cut.
pub(super) const RECOVERED: &str = "recovered";

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
    /// The new file cannot be written.
    #[error("cannot write {}: {cause}; name another file with --out", path.display())]
    Write {
        /// The new file.
        path: PathBuf,
        /// Why.
        cause: McapError,
    },
}

/// What was recovered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recovered {
    /// Messages in the new file.
    pub messages: u64,
    /// Sequence numbers that are missing in it.
    pub gaps: u64,
    /// Release of the last sample \[ns\].
    pub end_ns: u64,
    /// Why reading ended, if it was not for a clean cut.
    pub damage: Option<String>,
}

/// Writes what `from` holds before its cut or its first damage into `to`, which must not exist yet.
///
/// # Errors
/// [`RecoverError`]; a new file that could not be completed is removed.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, RecoverError> {
    let write = |cause| RecoverError::Write { path: to.to_owned(), cause };
    let records = Records::open(from)?;
    let file = File::create_new(to).map_err(|cause| write(McapError::Io(cause)))?;
    let recovered = copy(from, records, file, &write);
    if recovered.is_err() {
        // What made it fail is told; that the remains stay would be the lesser evil.
        let _ = std::fs::remove_file(to);
    }
    recovered
}

fn copy(
    from: &Path,
    records: Records,
    file: File,
    write: &dyn Fn(McapError) -> RecoverError,
) -> Result<Recovered, RecoverError> {
    let writer = options().create(BufWriter::new(file)).map_err(write)?;
    let mut copy = Copy::of(writer);
    let length = records.length();
    let mut failure = None;
    let read = records.for_each(|record| {
        Ok(match copy.take(record) {
            Ok(()) => ControlFlow::Continue(()),
            Err(cause) => {
                failure = Some(cause);
                ControlFlow::Break(())
            }
        })
    });
    if let Some(cause) = failure {
        return Err(write(cause));
    }
    copy.recovered.damage = match read {
        Ok(Ending::Whole) => return Err(RecoverError::Complete { path: from.to_owned() }),
        Ok(Ending::Cut) if copy.recovered.messages == 0 => {
            let (path, what) = (from.to_owned(), "everything but the head".to_owned());
            return Err(ReadError::CutHead { path, length, what }.into());
        }
        Ok(Ending::Cut) => None,
        Err(error) if copy.recovered.messages == 0 => return Err(error.into()),
        Err(error) => Some(error.to_string()),
    };
    copy.finish(from).map_err(write)
}

/// A channel of both files.
struct Channel {
    id: u16,
    /// Of those with headers.
    stream: Option<Stream>,
}

struct Copy {
    writer: Writer<BufWriter<File>>,
    /// New by old.
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, Channel>,
    audit: SequenceAudit,
    recovered: Recovered,
}

impl Copy {
    fn of(writer: Writer<BufWriter<File>>) -> Self {
        let recovered = Recovered { messages: 0, gaps: 0, end_ns: 0, damage: None };
        let (schemas, channels) = (BTreeMap::new(), BTreeMap::new());
        Self { writer, schemas, channels, audit: SequenceAudit::default(), recovered }
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
                let has_header = about.contains_key("layout_hash") || topic.starts_with("/state/");
                let known = self.channels.remove(&old.id).and_then(|channel| channel.stream);
                let stream =
                    known.or_else(|| has_header.then(|| self.audit.register(topic.as_str())));
                self.channels.insert(old.id, Channel { id, stream });
            }
            Record::Message { header, data } => self.message(header, &data)?,
            Record::Metadata(metadata) => self.writer.write_metadata(&metadata)?,
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
        let Some(channel) = self.channels.get(&header.channel_id) else { return Ok(()) };
        if let Some(stream) = channel.stream
            && let Some(sample) = sample_header(data)
        {
            if self.audit.observe(stream, &sample) == Verdict::Repeated {
                return Ok(());
            }
            self.recovered.end_ns = self.recovered.end_ns.max(sample.release_ns);
        }
        header.channel_id = channel.id;
        self.recovered.messages += 1;
        self.writer.write_to_known_channel(&header, data)
    }

    fn finish(mut self, from: &Path) -> Result<Recovered, McapError> {
        self.recovered.gaps = self.audit.tallies().map(|(_, _, tally)| tally.gaps).sum();
        let name = from.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut about = BTreeMap::from([("from".to_owned(), name)]);
        about.extend(self.recovered.damage.clone().map(|damage| ("damage".to_owned(), damage)));
        for (name, metadata) in [("audit", self.audit.to_metadata()), (RECOVERED, about)] {
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
