//! The last lines that a process has written to its standard error, read by a thread.

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::{Errno, ioctl_fionread, read};
use std::collections::VecDeque;
use std::io;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// Lines that are kept.
const LINES: usize = 12;
/// Bytes of a line that are kept together.
const LINE_BYTES: usize = 4096;
/// How long the reader may take to empty the pipe of a process that has ended. A process that this one has started may
/// keep the pipe open, and write to it without end.
const LIMIT: Duration = Duration::from_secs(5);

/// What has been read so far.
#[derive(Debug, Default)]
struct Words {
    lines: VecDeque<String>,
    /// The beginning of a line.
    partial: Vec<u8>,
    /// The last that had the other end of the pipe has closed it.
    ended: bool,
}

impl Words {
    fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if byte != b'\n' {
                self.partial.push(byte);
            }
            if byte == b'\n' || self.partial.len() == LINE_BYTES {
                if self.lines.len() == LINES {
                    self.lines.pop_front();
                }
                let line = String::from_utf8_lossy(&self.partial).trim_end().to_owned();
                self.lines.push_back(line);
                self.partial.clear();
            }
        }
    }

    fn text(&self) -> String {
        let partial = String::from_utf8_lossy(&self.partial);
        let partial = Some(partial.trim_end()).filter(|text| !text.is_empty());
        let lines = self.lines.iter().map(String::as_str).chain(partial);
        lines.collect::<Vec<_>>().join("\n")
    }
}

#[derive(Debug, Default)]
struct Shared {
    words: Mutex<Words>,
    has_read: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Words> {
        self.words.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The last words of one process; none of a process whose standard error is another's.
#[derive(Debug, Default)]
pub(crate) struct LastWords {
    shared: Arc<Shared>,
    pipe: Option<OwnedFd>,
}

impl LastWords {
    /// Reads the pipe until its other end is closed everywhere.
    pub(crate) fn of(pipe: OwnedFd) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let (own, reads) = (pipe.try_clone()?, Arc::clone(&shared));
        thread::spawn(move || {
            follow(&pipe, &reads);
            reads.lock().ended = true;
            reads.has_read.notify_all();
        });
        Ok(Self { shared, pipe: Some(own) })
    }

    /// What has been read until now.
    pub(crate) fn so_far(&self) -> String {
        self.shared.lock().text()
    }

    /// Everything that a process has written that has ended.
    pub(crate) fn complete(&self) -> String {
        let Some(pipe) = &self.pipe else { return self.so_far() };
        // What is not in the pipe any more has been taken, for the reader does both under the lock.
        let is_missing = |words: &mut Words| !words.ended && ioctl_fionread(pipe) != Ok(0);
        let waited = self.shared.has_read.wait_timeout_while(self.shared.lock(), LIMIT, is_missing);
        waited.unwrap_or_else(PoisonError::into_inner).0.text()
    }
}

/// Takes everything that comes through a pipe.
fn follow(pipe: &OwnedFd, shared: &Shared) {
    let mut buffer = [0; LINE_BYTES];
    loop {
        // Waits without the lock, and reads with it what is there.
        match poll(&mut [PollFd::new(pipe, PollFlags::IN)], None) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(_) => return,
        }
        let mut words = shared.lock();
        match read(pipe, &mut buffer) {
            Ok(0) => return,
            Ok(count) => words.take(&buffer[..count]),
            Err(Errno::INTR | Errno::AGAIN) => {}
            Err(_) => return,
        }
        drop(words);
        shared.has_read.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::Write as _;

    fn pipe() -> (LastWords, File) {
        let (reader, writer) = io::pipe().expect("a pipe");
        (LastWords::of(reader.into()).expect("a reader"), File::from(OwnedFd::from(writer)))
    }

    #[test]
    fn all_that_is_in_the_pipe_is_told_although_its_other_end_stays_open() {
        let (words, mut writer) = pipe();
        writer.write_all(b"one\ntwo\nhalf a li").expect("room");
        assert_eq!(words.complete(), "one\ntwo\nhalf a li");
        writer.write_all(b"ne\n").expect("room");
        assert_eq!(words.complete(), "one\ntwo\nhalf a line");
    }

    #[test]
    fn the_last_lines_are_kept_and_a_line_without_end_is_cut() {
        let (words, mut writer) = pipe();
        for line in 0..100 {
            writeln!(writer, "line {line}").expect("room");
        }
        let text = words.complete();
        assert_eq!(text.lines().count(), LINES);
        assert!(text.starts_with("line 88\n") && text.ends_with("\nline 99"), "{text}");
        for _ in 0..20 {
            writer.write_all(&[b'x'; 10_000]).expect("room");
        }
        drop(writer);
        let text = words.complete();
        assert!(text.len() <= (LINES + 1) * (LINE_BYTES + 1), "{} bytes", text.len());
    }
}
