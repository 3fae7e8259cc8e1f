//! Everything that a process writes, read by a thread as it comes: the process never waits for a reader.

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::fstat;
use rustix::io::{Errno, ioctl_fionread, read};
use rustix::pipe::fcntl_setpipe_size;
use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// What is read at once \[bytes\].
const CHUNK_BYTES: usize = 65_536;
/// What a pipe of a controller holds while no launcher reads it \[bytes\], as far as the system allows: a controller that
/// has filled it waits.
const PIPE_BYTES: usize = 1 << 18;
/// How long the reader may take for what is in the pipe.
const READ_LIMIT: Duration = Duration::from_secs(1);

/// Takes what a process writes.
pub(crate) trait Sink: Send + 'static {
    /// The next bytes, which may end anywhere.
    fn take(&mut self, bytes: &[u8]);

    /// Nothing more is expected; told at least once.
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

/// A pipe for what a process writes. The process inherits the reading end too, under a number of its own: when its
/// launcher dies, writing does not fail, and the next launcher finds the end and reads on.
#[derive(Debug)]
pub(crate) struct OutputPipe {
    pub(crate) reader: OwnedFd,
    /// For the process.
    pub(crate) writer: Stdio,
    /// The reading end that the process inherits; keep it until the process has been started.
    pub(crate) inherited: OwnedFd,
}

impl OutputPipe {
    pub(crate) fn open() -> io::Result<Self> {
        let (reader, writer) = io::pipe()?;
        // Unlike the others it stays open in a program that is started.
        let inherited = rustix::io::dup(&reader)?;
        Ok(Self { reader: reader.into(), writer: writer.into(), inherited })
    }

    /// Lets it hold more, for a controller that prints while there is no launcher.
    pub(crate) fn enlarge(&self) {
        // Beyond what the system allows a user it stays as it is.
        let _ = fcntl_setpipe_size(&self.reader, PIPE_BYTES);
    }

    /// Number by which the system knows the pipe.
    pub(crate) fn inode(&self) -> io::Result<u64> {
        Ok(fstat(&self.reader)?.st_ino)
    }

    /// The reading end of the pipe with this number that process `pid` has inherited; none if it has closed it.
    pub(crate) fn of_process(pid: u32, inode: u64) -> Option<OwnedFd> {
        let pipe = PathBuf::from(format!("pipe:[{inode}]"));
        let mut entries = fs::read_dir(format!("/proc/{pid}/fd")).ok()?.flatten();
        let found = entries.find(|entry| fs::read_link(entry.path()).is_ok_and(|to| to == pipe));
        // Whichever end it is, what is opened anew is one to read from.
        fs::File::open(found?.path()).ok().map(OwnedFd::from)
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

    #[test]
    fn a_pipe_that_a_process_has_inherited_is_found_and_no_other() {
        let pipe = OutputPipe::open().expect("a pipe");
        let inode = pipe.inode().expect("its number");
        let OutputPipe { writer, inherited, reader } = pipe;
        let echo = "echo one; echo two >&2; read _";
        let mut child = Command::new("sh")
            .args(["-c", echo])
            .stdin(Stdio::piped())
            .stdout(writer)
            .stderr(Stdio::piped())
            .spawn()
            .expect("a shell");
        // The launcher has died.
        drop((inherited, reader));
        let reader = OutputPipe::of_process(child.id(), inode).expect("inherited");
        let mut found = String::new();
        let mut lines = Lines::new(100);
        let mut buffer = [0; 100];
        while found.is_empty() {
            let count = read(&reader, &mut buffer).expect("what it says");
            lines.cut(&buffer[..count], |line| found = text(line));
        }
        assert_eq!(found, "one");
        assert!(OutputPipe::of_process(std::process::id(), inode).is_some(), "just opened");
        drop(reader);
        assert!(OutputPipe::of_process(std::process::id(), inode).is_none());
        drop(child.stdin.take());
        child.wait().expect("an end");
    }
}
