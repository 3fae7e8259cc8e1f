//! Full disks and abandoned recordings.

use crate::file::{facts, imu};
use mcap::MessageStream;
use mcap::read::Options;
use record::{Clock, RecordError, Recording};
use shared_types::topics;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// A disk that holds `room` bytes, cuts the write that does not fit, and may be freed later.
#[derive(Clone, Default)]
struct Disk(Arc<Mutex<(Vec<u8>, usize)>>);

impl Disk {
    fn with_room(room: usize) -> Self {
        Self(Arc::new(Mutex::new((Vec::new(), room))))
    }

    fn content(&self) -> Vec<u8> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).0.clone()
    }

    fn free(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1 = usize::MAX;
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut disk = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (content, room) = &mut *disk;
        let fits = bytes.len().min(*room - content.len());
        if fits == 0 && !bytes.is_empty() {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        content.extend_from_slice(&bytes[..fits]);
        Ok(fits)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn over(disk: &Disk) -> Result<Recording, RecordError> {
    Recording::over(Box::new(disk.clone()), Path::new("dir/flight.mcap"), &facts(Clock::Lockstep))
}

/// Sequences in an unfinished file, up to the first error.
fn readable(bytes: &[u8]) -> Vec<u32> {
    MessageStream::new_with_options(bytes, Options::IgnoreEndMagic.into())
        .map(|stream| stream.map_while(Result::ok).map(|message| message.sequence).collect())
        .unwrap_or_default()
}

#[test]
fn a_full_disk_is_reported_twice_and_leaves_a_readable_prefix() -> Result<(), RecordError> {
    let disk = Disk::with_room(120_000);
    let mut recording = over(&disk)?;
    let mut errors = Vec::new();
    let mut flushed = Vec::new();
    for sequence in 1..=20_000 {
        errors.extend(recording.write(&topics::IMU, &imu(sequence), 0).err());
        if sequence % 50 == 1 {
            errors.extend(recording.flush().err());
        }
        if errors.is_empty() && sequence % 250 == 1 {
            flushed.push(sequence);
        }
        if errors.len() == 1 {
            disk.free();
        }
    }
    assert_eq!(errors.len(), 1);
    let text = errors[0].to_string();
    for part in ["dir/flight.mcap", "no storage space", "free space or use --record DIR"] {
        assert!(text.contains(part), "{text}");
    }
    let at_failure = disk.content();
    let end = recording.finish(&BTreeMap::new()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(end.contains("incomplete") && end.contains("no storage space"), "{end}");
    assert_eq!(disk.content(), at_failure, "nothing may follow a torn record");

    let last_flushed = flushed.last().copied().unwrap_or_default();
    let read = readable(&at_failure);
    assert!(last_flushed > 1000 && read.len() as u64 >= last_flushed, "{last_flushed}");
    assert!((1..).zip(&read).all(|(expected, sequence)| expected == *sequence), "a hole");
    Ok(())
}

#[test]
fn a_disk_that_fills_at_the_very_end_is_reported_by_finish() -> Result<(), RecordError> {
    let whole = Disk::with_room(usize::MAX);
    let mut recording = over(&whole)?;
    recording.write(&topics::IMU, &imu(1), 0)?;
    recording.finish(&BTreeMap::new())?;
    let length = whole.content().len();

    // The last byte, somewhere in the summary, and within the last chunk.
    for room in [length - 1, length - 2000, length * 3 / 4] {
        let disk = Disk::with_room(room);
        let mut recording = over(&disk)?;
        recording.write(&topics::IMU, &imu(1), 0)?;
        let error = recording.finish(&BTreeMap::new()).err();
        assert!(matches!(error, Some(RecordError::Write { .. })), "{room}: {error:?}");
    }
    Ok(())
}

#[test]
fn a_device_without_room_is_reported_at_once() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let facts = facts(Clock::Lockstep);
    let error = Recording::over(Box::new(full), Path::new("/dev/full"), &facts).err();
    assert!(matches!(error, Some(RecordError::Write { .. })), "{error:?}");
}

#[test]
fn an_abandoned_recording_keeps_what_was_flushed_and_never_looks_complete()
-> Result<(), RecordError> {
    let disk = Disk::with_room(usize::MAX);
    let mut recording = over(&disk)?;
    for sequence in 1..=10 {
        recording.write(&topics::IMU, &imu(sequence), 0)?;
    }
    recording.flush()?;
    recording.write(&topics::IMU, &imu(11), 0)?;
    drop(recording);
    let bytes = disk.content();
    assert_eq!(readable(&bytes), (1..=10).collect::<Vec<_>>());
    assert!(!bytes.ends_with(mcap::MAGIC));
    Ok(())
}
