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
    static WITHOUT_WAITING: OnceLock<Option<File>> = OnceLock::new();
    let written = match WITHOUT_WAITING.get_or_init(error_without_waiting) {
        Some(error) => {
            let mut error: &File = error;
            error.write_all(text.as_bytes())
        }
        None if is_ready() => io::stderr().write_all(text.as_bytes()),
        None => return false,
    };
    // What has been closed takes nothing later either.
    !written.is_err_and(|error| error.kind() == io::ErrorKind::WouldBlock)
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
