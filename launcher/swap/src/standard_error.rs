//! Standard error without waiting: a terminal that has been stopped, or a pipe that is not read, must not stop a flight.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FileType, OFlags, fstat};
use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::sync::OnceLock;

/// Writes to standard error; false if it would have to wait, as for a terminal that has been stopped.
#[must_use]
pub fn show(text: &str) -> bool {
    show_some(text.as_bytes()) == text.len()
}

/// Writes as much to standard error as is possible without waiting, and returns how many bytes that are. What has been closed
/// counts as taking all.
#[must_use]
pub fn show_some(text: &[u8]) -> usize {
    static WITHOUT_WAITING: OnceLock<Option<File>> = OnceLock::new();
    let Some(mut error) = WITHOUT_WAITING.get_or_init(error_without_waiting).as_ref() else {
        if !is_ready() {
            return 0;
        }
        let _ = io::stderr().write_all(text);
        return text.len();
    };
    let mut rest = text;
    while !rest.is_empty() {
        match error.write(rest) {
            Ok(taken) if taken > 0 => rest = &rest[taken..],
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
            Ok(_) | Err(_) => return text.len(),
        }
    }
    text.len() - rest.len()
}

/// Whether something can be written to standard error without waiting.
#[must_use]
pub fn is_ready() -> bool {
    let error = io::stderr();
    let mut polled = [PollFd::new(&error, PollFlags::OUT)];
    poll(&mut polled, Some(&Timespec::default())).is_ok_and(|ready| ready > 0)
}

/// Standard error, opened once more so that writing to it never waits; none of a file, for which nothing waits and which
/// would be written to at another place, and of what cannot be opened, such as a socket.
fn error_without_waiting() -> Option<File> {
    let kind = FileType::from_raw_mode(fstat(io::stderr()).ok()?.st_mode);
    if !matches!(kind, FileType::Fifo | FileType::CharacterDevice) {
        return None;
    }
    let flags = i32::try_from((OFlags::NONBLOCK | OFlags::NOCTTY).bits()).ok()?;
    File::options().write(true).custom_flags(flags).open("/proc/self/fd/2").ok()
}
