//! Recordings written by a thread of their own: the same file, whatever the disk does.

use crate::file::{facts, imu};
use mcap::MessageStream;
use mcap::read::Options;
use record::{Clock, Event, RecordError, Recorder, Recording, Severity};
use shared_types::{Header, Role, Truth, topics};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

const FILE: &str = "dir/flight.mcap";

/// A disk that holds `room` bytes and takes none as long as its gate is held.
#[derive(Default)]
struct Disk {
    content: Arc<Mutex<Vec<u8>>>,
    room: Option<usize>,
    gate: Arc<Mutex<()>>,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _free = self.gate.lock().unwrap_or_else(PoisonError::into_inner);
        let mut content = self.content.lock().unwrap_or_else(PoisonError::into_inner);
        if self.room.is_some_and(|room| content.len() + bytes.len() > room) {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        content.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A recording over a disk, and what is on that.
fn over(disk: Disk) -> (Recording, Arc<Mutex<Vec<u8>>>) {
    let content = Arc::clone(&disk.content);
    let recording =
        Recording::over(Box::new(disk), Path::new(FILE), &facts(Clock::Realtime { speed: 1.0 }));
    (recording.expect("a beginning"), content)
}

fn recorder_over(disk: Disk) -> (Recorder, Arc<Mutex<Vec<u8>>>) {
    let (recording, content) = over(disk);
    (Recorder::start(recording, Path::new(FILE)).expect("a thread"), content)
}

fn read(content: &Mutex<Vec<u8>>) -> Vec<u8> {
    content.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Both have the same methods.
macro_rules! record_everything {
    ($recording:expr, $flush:expr) => {{
        let mut recording = $recording;
        recording.set_start(1_000_000);
        for sequence in 1..=20_000_u64 {
            let receipt_mono_ns = sequence * 1_000_000;
            recording.write(&topics::IMU, &imu(sequence), receipt_mono_ns)?;
            if sequence % 10 == 0 {
                let header = Header { sequence, release_ns: receipt_mono_ns, ..Header::default() };
                let truth = Truth { header, ..Truth::default() };
                recording.write(&topics::TRUTH, &truth, receipt_mono_ns)?;
                let byte = sequence.to_le_bytes()[0];
                let state = vec![byte; 1000 + usize::from(byte % 7)];
                recording.write_state(Role::Plant, &header, 7, &state, receipt_mono_ns)?;
            }
            if sequence % 1000 == 0 {
                let (severity, source) = (Severity::Warning, "pilot");
                let logical_ns = receipt_mono_ns;
                recording.write_event(&Event { logical_ns, severity, source, text: "gust" })?;
                recording.attach_scenario(&format!("{sequence}.toml"), "seed = 7\n")?;
            }
            $flush(&mut recording, sequence)?;
        }
        recording.finish(&BTreeMap::from([("verdict".to_owned(), "ok".to_owned())]))?;
    }};
}

#[test]
fn a_thread_of_its_own_writes_the_same_file() -> Result<(), RecordError> {
    let (recording, here) = over(Disk::default());
    // Every 50 ms, as the recorder does by itself.
    record_everything!(recording, |recording: &mut Recording, sequence: u64| {
        if sequence > 1 && sequence % 50 == 1 { recording.flush() } else { Ok(()) }
    });
    let (recorder, there) = recorder_over(Disk::default());
    record_everything!(recorder, |recorder: &mut Recorder, sequence: u64| {
        recorder.flush_if_due(sequence * 1_000_000)
    });
    let (here, there) = (read(&here), read(&there));
    assert!(here.len() > 1_000_000, "{}", here.len());
    assert!(here == there, "{} and {} bytes", here.len(), there.len());
    Ok(())
}

#[test]
fn a_disk_that_cannot_keep_up_is_waited_for_and_nothing_is_lost() -> Result<(), RecordError> {
    let gate = Arc::new(Mutex::new(()));
    let (mut recorder, content) =
        recorder_over(Disk { gate: Arc::clone(&gate), ..Disk::default() });
    let held = gate.lock().unwrap_or_else(PoisonError::into_inner);
    let (done, progress) = channel();
    std::thread::scope(|scope| {
        let fly = scope.spawn(move || {
            for sequence in 1..=40_000 {
                recorder.write(&topics::IMU, &imu(sequence), sequence)?;
                let _ = done.send(());
            }
            recorder.finish(&BTreeMap::new())
        });
        // As long as the disk takes nothing more, no more is taken than the batches hold.
        let mut taken = progress.iter().take(1).count();
        // However long it is waited for here: less than all have been taken.
        while progress.recv_timeout(Duration::from_millis(200)).is_ok() {
            taken += 1;
        }
        assert!(taken < 40_000, "{taken}");
        drop(held);
        fly.join().expect("no panic")
    })?;
    let bytes = read(&content);
    let of_imu = MessageStream::new(&bytes)
        .expect("a file")
        .filter(|message| message.as_ref().is_ok_and(|message| message.channel.topic == "/imu"));
    assert_eq!(of_imu.count(), 40_000);
    Ok(())
}

#[test]
fn a_full_disk_is_reported_once_in_flight_and_again_at_the_end() {
    let (mut recorder, content) = recorder_over(Disk { room: Some(300_000), ..Disk::default() });
    let mut errors = Vec::new();
    for sequence in 1..=100_000 {
        errors.extend(recorder.write(&topics::IMU, &imu(sequence), 0).err());
        errors.extend(recorder.flush_if_due(sequence * 1_000_000).err());
    }
    assert_eq!(errors.len(), 1, "{errors:?}");
    let text = errors[0].to_string();
    for part in [FILE, "no storage space", "free space or use --record DIR"] {
        assert!(text.contains(part), "{text}");
    }
    let end = recorder.finish(&BTreeMap::new()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(end.contains("incomplete") && end.contains("no storage space"), "{end}");
    let sequences = readable(&content);
    assert!(sequences.len() > 1000, "{}", sequences.len());
    assert!((1..).zip(&sequences).all(|(expected, sequence)| expected == *sequence), "a hole");
}

#[test]
fn an_abandoned_recorder_keeps_what_was_flushed_and_never_looks_complete() -> Result<(), RecordError>
{
    let (mut recorder, content) = recorder_over(Disk::default());
    for sequence in 1..=10 {
        recorder.write(&topics::IMU, &imu(sequence), 0)?;
    }
    recorder.flush_if_due(0)?;
    recorder.flush_if_due(250_000_000)?;
    recorder.write(&topics::IMU, &imu(11), 0)?;
    drop(recorder);
    assert_eq!(readable(&content), (1..=10).collect::<Vec<_>>());
    assert!(!read(&content).ends_with(mcap::MAGIC));
    Ok(())
}

/// Sequences in a file without an end, up to the first thing that cannot be read.
fn readable(content: &Mutex<Vec<u8>>) -> Vec<u32> {
    let bytes = read(content);
    let messages = MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into());
    let readable = messages.expect("a beginning").map_while(Result::ok);
    readable.map(|message| message.sequence).collect()
}

/// Longest part of a flight that may be missing, in samples of 1 kHz.
const FLUSHED_WITHIN: u64 = 50;

#[test]
fn whenever_it_is_killed_a_recorder_has_left_all_but_the_last_fifty_milliseconds() {
    for last in (60..700).step_by(37) {
        let (mut recorder, content) = recorder_over(Disk::default());
        for sequence in 1..=last {
            recorder.write(&topics::IMU, &imu(sequence), 0).expect("room");
            recorder.flush_if_due(sequence * 1_000_000).expect("room");
        }
        // What has not been handed to the writer is lost, as when the process is killed.
        drop(recorder);
        let left = readable(&content).len() as u64;
        assert!(left < last && left + FLUSHED_WITHIN >= last, "{left} of {last}");
    }
}

#[test]
fn what_a_full_disk_is_reported_to_hold_is_short_by_fifty_ms_at_most() {
    for room in (60_000..300_000).step_by(17_000) {
        let (mut recorder, content) = recorder_over(Disk { room: Some(room), ..Disk::default() });
        for sequence in 1..=20_000 {
            let _ = recorder.write(&topics::IMU, &imu(sequence), 0);
            let _ = recorder.flush_if_due(sequence * 1_000_000);
        }
        let Err(RecordError::Incomplete { until_ns, .. }) = recorder.finish(&BTreeMap::new())
        else {
            panic!("{room} bytes are not enough");
        };
        let (until_ms, left) = (until_ns / 1_000_000, readable(&content).len() as u64);
        assert!(
            until_ms > 0 && until_ms <= left && until_ms + FLUSHED_WITHIN >= left,
            "{until_ms} of {left}"
        );
    }
}

/// A disk behind which something is wrong with the program.
struct Broken(Disk);

impl Write for Broken {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        assert!(self.0.content.lock().is_ok_and(|content| content.len() < 100_000), "on purpose");
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_writer_that_stops_is_reported_once_in_flight_and_again_at_the_end() {
    let facts = facts(Clock::Lockstep);
    let broken = Broken(Disk::default());
    let recording = Recording::over(Box::new(broken), Path::new(FILE), &facts).expect("a start");
    let mut recorder = Recorder::start(recording, Path::new(FILE)).expect("a thread");
    let mut errors = Vec::new();
    for sequence in 1..=100_000 {
        errors.extend(recorder.write(&topics::IMU, &imu(sequence), 0).err());
    }
    assert_eq!(errors.len(), 1, "{errors:?}");
    let end = recorder.finish(&BTreeMap::new()).err();
    for error in errors.into_iter().chain(end) {
        assert!(error.to_string().contains("its writer has stopped"), "{error}");
    }
}
