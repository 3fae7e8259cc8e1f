//! Everything that a process writes, read by a thread as it comes.

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::{Errno, ioctl_fionread, read};
use std::io;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// What is read at once \[bytes\].
const CHUNK_BYTES: usize = 65_536;
/// How long the reader may take for what is in the pipe.
const READ_LIMIT: Duration = Duration::from_secs(1);

/// Takes what a process writes.
pub(crate) trait Sink: Send + 'static {
    /// The next bytes, which may end anywhere.
    fn take(&mut self, bytes: &[u8]);

    /// Nothing more is expected; called at least once.
    fn end(&mut self) {}
}

/// Cuts bytes into lines, and a line that is too long into several.
#[derive(Debug)]
pub(crate) struct Lines {
    longest: usize,
    partial: Vec<u8>,
}

impl Lines {
    pub(crate) fn new(longest: usize) -> Self {
        Self { longest, partial: Vec::new() }
    }

    /// Gives every line that `bytes` complete to `each`, without its end.
    pub(crate) fn cut(&mut self, bytes: &[u8], mut each: impl FnMut(&[u8])) {
        for &byte in bytes {
            if byte != b'\n' {
                self.partial.push(byte);
            }
            if byte == b'\n' || self.partial.len() == self.longest {
                each(&self.partial);
                self.partial.clear();
            }
        }
    }

    /// The beginning of a line that has not ended.
    pub(crate) fn rest(&self) -> &[u8] {
        &self.partial
    }
}

/// A line as text, whatever a process has written.
pub(crate) fn text(line: &[u8]) -> String {
    String::from_utf8_lossy(line).trim_end().to_owned()
}

#[derive(Debug)]
struct State<S> {
    sink: S,
    /// Bytes that have been read.
    taken: u64,
    /// The last process that had the writing end has closed it.
    ended: bool,
}

#[derive(Debug)]
struct Shared<S> {
    state: Mutex<State<S>>,
    has_read: Condvar,
}

impl<S> Shared<S> {
    fn lock(&self) -> MutexGuard<'_, State<S>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A thread that reads a pipe until its writing end is closed everywhere.
#[derive(Debug)]
pub(crate) struct Drain<S> {
    shared: Arc<Shared<S>>,
    pipe: OwnedFd,
}

impl<S: Sink> Drain<S> {
    pub(crate) fn start(pipe: OwnedFd, sink: S) -> io::Result<Self> {
        let state = Mutex::new(State { sink, taken: 0, ended: false });
        let shared = Arc::new(Shared { state, has_read: Condvar::new() });
        let (own, reads) = (pipe.try_clone()?, Arc::clone(&shared));
        thread::Builder::new().name("output".to_owned()).spawn(move || {
            follow(&own, &reads);
            let mut state = reads.lock();
            state.sink.end();
            state.ended = true;
            drop(state);
            reads.has_read.notify_all();
        })?;
        Ok(Self { shared, pipe })
    }

    /// Looks at the sink as it is now.
    pub(crate) fn look<R>(&self, at: impl FnOnce(&S) -> R) -> R {
        at(&self.shared.lock().sink)
    }

    /// Waits until everything that has been written until now has been taken. What a process that outlives the writer
    /// goes on writing to the same pipe is not waited for.
    pub(crate) fn catch_up(&self) {
        let state = self.shared.lock();
        // The reader takes bytes from the pipe under the lock, so that each is in one place or the other.
        let until = state.taken + ioctl_fionread(&self.pipe).unwrap_or(0);
        let is_behind = |state: &mut State<S>| !state.ended && state.taken < until;
        drop(self.shared.has_read.wait_timeout_while(state, READ_LIMIT, is_behind));
    }

    /// Takes the rest of what a process has written that has ended. The end of the pipe is not waited for: what the process
    /// has started in the background may keep it open.
    pub(crate) fn finish(&self) {
        self.catch_up();
        self.shared.lock().sink.end();
    }
}

fn follow<S: Sink>(pipe: &OwnedFd, shared: &Shared<S>) {
    let mut buffer = vec![0; CHUNK_BYTES];
    loop {
        // Waits without the lock, and reads with it what is there.
        match poll(&mut [PollFd::new(pipe, PollFlags::IN)], None) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(_) => return,
        }
        let mut state = shared.lock();
        match read(pipe, &mut buffer) {
            Ok(0) => return,
            Ok(count) => {
                state.taken += count as u64;
                state.sink.take(&buffer[..count]);
            }
            Err(Errno::INTR | Errno::AGAIN) => {}
            Err(_) => return,
        }
        drop(state);
        shared.has_read.notify_all();
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::fs::File;
    use std::io::Write as _;
    use std::process::Command;

    /// A pipe that is drained into `sink`, and its writing end.
    pub(crate) fn drained<S: Sink>(sink: S) -> (Drain<S>, File) {
        let (reader, writer) = io::pipe().expect("a pipe");
        let drain = Drain::start(reader.into(), sink).expect("a reader");
        (drain, File::from(OwnedFd::from(writer)))
    }

    #[derive(Debug, Default)]
    struct Counts {
        bytes: usize,
        ended: bool,
    }

    impl Sink for Counts {
        fn take(&mut self, bytes: &[u8]) {
            self.bytes += bytes.len();
        }

        fn end(&mut self) {
            self.ended = true;
        }
    }

    #[test]
    fn what_has_been_written_is_waited_for_and_not_what_another_process_goes_on_writing() {
        let (drain, mut writer) = drained(Counts::default());
        writer.write_all(&[b'x'; 1000]).expect("room");
        let mut flood = Command::new("yes").stdout(writer).spawn().expect("`yes` starts");
        drain.catch_up();
        let (bytes, ended) = drain.look(|counts| (counts.bytes, counts.ended));
        assert!(bytes >= 1000 && !ended, "{bytes}");
        flood.kill().expect("it runs");
        flood.wait().expect("an end");
        drain.catch_up();
    }
}
