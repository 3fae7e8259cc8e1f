//! The summary that a launcher writes at the end of a recording, found by the index there: nothing else of the file is
//! read.

use super::records::{MAX_RECORD_BYTES, parse};
use mcap::records::{Metadata, Record, op};
use mcap::sans_io::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use mcap::{McapResult, Summary};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

/// Bytes before the content of a record: its kind and its length.
const RECORD_HEAD_BYTES: usize = 1 + 8;

/// The summary, or none of a file that is cut or whose end is damaged.
pub(super) fn closing_summary(path: &Path) -> Option<BTreeMap<String, String>> {
    let mut file = File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    let end = end(&mut file, length).ok()??;
    end.metadata_indexes
        .iter()
        .filter(|index| index.name == "summary")
        .find_map(|index| metadata_at(&mut file, index.offset, length))
        .map(|found| found.metadata)
}

/// The section behind the data, which lists where in the file what is.
fn end(file: &mut File, length: u64) -> McapResult<Option<Summary>> {
    let options = SummaryReaderOptions::default()
        .with_file_size(length)
        .with_record_length_limit(MAX_RECORD_BYTES);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event? {
            SummaryReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted.min(MAX_RECORD_BYTES)))?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(file.seek(to)?),
        }
    }
    Ok(reader.finish())
}

/// The metadata that begin at `offset`, if any do.
fn metadata_at(file: &mut File, offset: u64, length: u64) -> Option<Metadata> {
    let content = offset.checked_add(RECORD_HEAD_BYTES as u64)?;
    file.seek(SeekFrom::Start(offset)).ok()?;
    let mut head = [0; RECORD_HEAD_BYTES];
    file.read_exact(&mut head).ok()?;
    let (kind, size) = head.split_first()?;
    let size = u64::from_le_bytes(size.try_into().ok()?);
    let is_whole = content.checked_add(size).is_some_and(|end| end <= length);
    if *kind != op::METADATA || !is_whole || size > MAX_RECORD_BYTES as u64 {
        return None;
    }
    let mut data = Vec::new();
    file.take(size).read_to_end(&mut data).ok()?;
    match parse(*kind, &data).ok()? {
        Record::Metadata(found) => Some(found),
        _ => None,
    }
}
