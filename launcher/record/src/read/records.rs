//! The records of one file in order, a chunk at a time, each checked before it is shown.

use super::ReadError;
use crate::error::cause_text;
use core::ops::ControlFlow;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use std::fs::{File, FileType};
use std::io::{self, BufReader, Read as _, Seek as _, SeekFrom};
use std::os::unix::fs::FileTypeExt as _;
use std::path::{Path, PathBuf};

/// Longest record or chunk that is read \[bytes\]: ours have a megabyte, and a damaged length must
/// not fill the memory.
pub(super) const MAX_RECORD_BYTES: usize = 64 << 20;

/// How the file ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ending {
    /// As its writer meant it, or as the reader wanted.
    Whole,
    /// In the middle: the writer was killed or still writes, or the copy is a part.
    Cut,
}

/// A file open for reading from its start.
pub(super) struct Records {
    path: PathBuf,
    file: BufReader<File>,
    length: u64,
    /// The file ends as a complete one does.
    finished: bool,
}

impl Records {
    pub(super) fn open(path: &Path) -> Result<Self, ReadError> {
        let system = || ReadError::system(path);
        // Before it is opened: to open a pipe is to wait for its writer.
        let facts = std::fs::metadata(path).map_err(system())?;
        if !facts.is_file() {
            let what = format!("it is not a file but a {}", kind(facts.file_type()));
            return Err(ReadError::Foreign { path: path.to_owned(), what });
        }
        let mut file = File::open(path).map_err(system())?;
        let length = facts.len();
        if length == 0 {
            return Err(ReadError::Empty { path: path.to_owned() });
        }
        let mut magic = Vec::with_capacity(MAGIC.len());
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut magic).map_err(system())?;
        if !MAGIC.starts_with(&magic) {
            let what = "it does not begin like an MCAP file".to_owned();
            return Err(ReadError::Foreign { path: path.to_owned(), what });
        }
        let mut tail = Vec::with_capacity(MAGIC.len());
        if length >= 2 * MAGIC.len() as u64 {
            file.seek(SeekFrom::Start(length - MAGIC.len() as u64)).map_err(system())?;
            file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut tail).map_err(system())?;
        }
        file.rewind().map_err(system())?;
        let file = BufReader::with_capacity(1 << 20, file);
        Ok(Self { path: path.to_owned(), file, length, finished: tail == MAGIC })
    }

    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Shows every record until `show` has seen enough.
    pub(super) fn for_each(
        self,
        mut show: impl FnMut(Record<'_>) -> Result<ControlFlow<()>, ReadError>,
    ) -> Result<Ending, ReadError> {
        let options = options()
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_check_finishes_after_end_magic(true);
        self.read(options, |_, opcode, data| Ok(show(parse(opcode, data)?)?))
    }

    /// Shows what can be read of every record, also behind damaged ones; how many of those were left
    /// out with something behind them.
    ///
    /// # Errors
    /// The error of `show`, or the damage behind which nothing could be read.
    pub(super) fn around_damage(
        self,
        left_out: &mut u64,
        mut show: impl FnMut(Record<'_>) -> Result<(), ReadError>,
    ) -> Result<Ending, ReadError> {
        let (path, length) = (self.path.clone(), self.length);
        let mut behind: Option<(u64, McapError)> = None;
        let mut pending = 0;
        let ending = self.read(options().with_emit_chunks(true), |at, opcode, data| {
            let shown = match opcode {
                op::CHUNK => open_chunk(data, &mut show),
                _ => parse(opcode, data).map_err(Trouble::from).and_then(|r| Ok(show(r)?)),
            };
            match shown {
                Err(Trouble::Damage(cause)) => {
                    pending += 1;
                    behind.get_or_insert((at, cause));
                }
                shown => {
                    shown?;
                    if opcode == op::CHUNK {
                        *left_out += core::mem::take(&mut pending);
                        behind = None;
                    }
                }
            }
            Ok(ControlFlow::Continue(()))
        })?;
        match behind {
            Some((at, cause)) => Err(damaged(path, (at, length), &cause)),
            None => Ok(ending),
        }
    }

    fn read(
        mut self,
        options: LinearReaderOptions,
        show: impl FnMut(u64, u8, &[u8]) -> Result<ControlFlow<()>, Trouble>,
    ) -> Result<Ending, ReadError> {
        let mut at = 0;
        match drive(options, &mut self.file, &mut at, show) {
            Ok(()) => Ok(Ending::Whole),
            Err(Trouble::Damage(McapError::UnexpectedEof)) if !self.finished => Ok(Ending::Cut),
            Err(Trouble::Damage(cause)) => Err(damaged(self.path, (at, self.length), &cause)),
            Err(Trouble::System(cause)) => Err(ReadError::system(&self.path)(cause)),
            Err(Trouble::Visitor(error)) => Err(error),
        }
    }
}

fn damaged(path: PathBuf, (at, length): (u64, u64), cause: &McapError) -> ReadError {
    ReadError::Damaged { path, at, length, what: cause_text(cause) }
}

/// How chunks and records are read wherever they come from.
fn options() -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD_BYTES)
}

/// What ends a reading before its end.
enum Trouble {
    /// Bytes that are not as they were written.
    Damage(McapError),
    System(io::Error),
    /// The error of the visitor that is shown the records.
    Visitor(ReadError),
}

impl From<McapError> for Trouble {
    fn from(cause: McapError) -> Self {
        Self::Damage(cause)
    }
}

impl From<ReadError> for Trouble {
    fn from(error: ReadError) -> Self {
        Self::Visitor(error)
    }
}

/// Shows the records of a source; `at` counts the bytes read of it.
fn drive(
    options: LinearReaderOptions,
    source: &mut impl io::Read,
    at: &mut u64,
    mut show: impl FnMut(u64, u8, &[u8]) -> Result<ControlFlow<()>, Trouble>,
) -> Result<(), Trouble> {
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                // One byte more than the file has shows its end.
                let wanted = wanted.min(MAX_RECORD_BYTES);
                let read = source.read(reader.insert(wanted)).map_err(Trouble::System)?;
                reader.notify_read(read);
                *at += read as u64;
            }
            LinearReadEvent::Record { data, opcode } => {
                if show(*at, opcode, data)?.is_break() {
                    return Ok(());
                }
            }
        }
    }
    Ok(())
}

/// Shows the records of a chunk, all or none: its checksum is looked at first.
fn open_chunk(
    data: &[u8],
    show: &mut impl FnMut(Record<'_>) -> Result<(), ReadError>,
) -> Result<(), Trouble> {
    let length = (data.len() as u64).to_le_bytes();
    let mut framed = (&[op::CHUNK][..]).chain(&length[..]).chain(data);
    let options = options().with_skip_start_magic(true).with_skip_end_magic(true);
    drive(options, &mut framed, &mut 0, |_, opcode, data| {
        show(parse(opcode, data)?)?;
        Ok(ControlFlow::Continue(()))
    })
}

/// What there is instead of a file.
fn kind(found: FileType) -> &'static str {
    if found.is_dir() {
        "folder"
    } else if found.is_fifo() {
        "pipe"
    } else {
        "device or socket"
    }
}

/// Parses a record; the format's parser takes lengths on trust and would make room for them first.
pub(super) fn parse(opcode: u8, data: &[u8]) -> Result<Record<'_>, McapError> {
    if holds_its_texts(opcode, data).is_none() {
        return Err(McapError::UnexpectedEof);
    }
    mcap::parse_record(opcode, data)
}

/// What is behind the texts of a record, if it has room for them.
fn holds_its_texts(opcode: u8, data: &[u8]) -> Option<&[u8]> {
    match opcode {
        op::HEADER => text(text(data)?),
        op::SCHEMA => text(text(text(data.get(2..)?)?)?),
        op::CHANNEL => texts(text(text(data.get(4..)?)?)?),
        op::METADATA => texts(text(data)?),
        // Two stamps before, and behind it the length of the data and a checksum.
        op::ATTACHMENT => text(text(data.get(16..)?)?)?.get(8 + 4..),
        op::ATTACHMENT_INDEX => text(text(data.get(40..)?)?),
        op::METADATA_INDEX => text(data.get(16..)?),
        op::CHUNK_INDEX => text(text(data.get(32..)?)?.get(8..)?),
        _ => Some(data),
    }
}

/// Skips a text, or other bytes, behind their length.
fn text(data: &[u8]) -> Option<&[u8]> {
    let (length, rest) = data.split_first_chunk()?;
    rest.get(usize::try_from(u32::from_le_bytes(*length)).ok()?..)
}

/// Skips pairs of texts behind their length.
fn texts(data: &[u8]) -> Option<&[u8]> {
    let behind = text(data)?;
    let mut pairs = data.get(4..data.len() - behind.len())?;
    while !pairs.is_empty() {
        pairs = text(text(pairs)?)?;
    }
    Some(behind)
}
