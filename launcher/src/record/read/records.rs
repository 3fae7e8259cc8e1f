//! The records of one file in order, a chunk at a time, each checked before it is shown.

use super::ReadError;
use crate::record::error::words;
use core::ops::ControlFlow;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use std::fs::{File, FileType};
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::os::unix::fs::FileTypeExt as _;
use std::path::{Path, PathBuf};

/// Longest record or chunk that is read \[bytes\]: ours have a megabyte, and a damaged length must
/// not fill the memory.
const LONGEST: usize = 64 << 20;

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
            let what = format!("it is no file but a {}", kind(facts.file_type()));
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
        mut self,
        mut show: impl FnMut(Record<'_>) -> Result<ControlFlow<()>, ReadError>,
    ) -> Result<Ending, ReadError> {
        let mut reader = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_prevalidate_chunk_crcs(true)
                .with_validate_data_section_crc(true)
                .with_validate_summary_section_crc(true)
                .with_check_finishes_after_end_magic(true)
                .with_record_length_limit(LONGEST),
        );
        let mut at = 0;
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    // One byte more than the file has shows its end.
                    let wanted = wanted.min(LONGEST);
                    let read = self
                        .file
                        .read(reader.insert(wanted))
                        .map_err(ReadError::system(&self.path))?;
                    reader.notify_read(read);
                    at += read as u64;
                }
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    let record = parse(opcode, data).map_err(|cause| self.damaged(at, &cause))?;
                    if show(record)?.is_break() {
                        return Ok(Ending::Whole);
                    }
                }
                Err(McapError::UnexpectedEof) if !self.finished => return Ok(Ending::Cut),
                Err(cause) => return Err(self.damaged(at, &cause)),
            }
        }
        Ok(Ending::Whole)
    }

    fn damaged(&self, at: u64, cause: &McapError) -> ReadError {
        let what = words(cause);
        ReadError::Damaged { path: self.path.clone(), at, length: self.length, what }
    }
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

/// Parses a record; one too short to be an attachment would make the format's parser panic.
fn parse(opcode: u8, data: &[u8]) -> Result<Record<'_>, McapError> {
    if opcode == op::ATTACHMENT && !holds_attachment(data) {
        return Err(McapError::UnexpectedEof);
    }
    mcap::parse_record(opcode, data)
}

/// True if `data` has room for two stamps, two strings, a length and a checksum.
fn holds_attachment(data: &[u8]) -> bool {
    let skip_string = |rest: &[u8]| -> Option<usize> {
        let length = u32::from_le_bytes(*rest.first_chunk()?);
        usize::try_from(length).ok()?.checked_add(4)
    };
    let mut rest = data.get(16..);
    for _ in 0..2 {
        rest = rest.and_then(|r| r.get(skip_string(r)?..));
    }
    rest.is_some_and(|r| r.len() >= 8 + 4)
}
