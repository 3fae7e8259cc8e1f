//! The pipe that a process writes to: it outlives the launcher that has opened it.

use rustix::fs::fstat;
use rustix::pipe::fcntl_setpipe_size;
use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::process::Stdio;

/// What a pipe of a controller holds while no launcher reads it \[bytes\], as far as the system allows: a controller that
/// has filled it waits.
const PIPE_BYTES: usize = 1 << 18;

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
mod tests {
    use super::*;
    use crate::drain::{Lines, text};
    use rustix::io::read;
    use std::process::Command;

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
