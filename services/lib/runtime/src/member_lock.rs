//! The lock by which a run's members are known, which can be asked about without being taken.
//!
//! It belongs to the open file, so the kernel gives it back when its holder dies, however it dies. A
//! `flock` would too, but who holds one can only be found out by trying to take it; two processes that
//! look at the same dead run at once would each take the other for a member.

use nix::fcntl::{FcntlArg, fcntl};
use nix::libc;
use std::fs::File;
use std::io;

/// How a lock is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Hold {
    /// By a member, beside others.
    Shared,
    /// By the process that removes the run.
    Exclusive,
}

/// Takes the lock, or returns false if another process holds it in a way that excludes this.
pub(crate) fn try_lock(file: &File, hold: Hold) -> io::Result<bool> {
    match fcntl(file, FcntlArg::F_OFD_SETLK(&whole_file(kind(hold)))) {
        Ok(_) => Ok(true),
        Err(nix::Error::EAGAIN | nix::Error::EACCES) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Gives the lock back.
pub(crate) fn unlock(file: &File) -> io::Result<()> {
    fcntl(file, FcntlArg::F_OFD_SETLK(&whole_file(libc::F_UNLCK)))?;
    Ok(())
}

/// How another open file holds the lock; none if no one does. Nothing is taken.
pub(crate) fn held(file: &File) -> io::Result<Option<Hold>> {
    let mut asked = whole_file(libc::F_WRLCK);
    fcntl(file, FcntlArg::F_OFD_GETLK(&mut asked))?;
    Ok(match i32::from(asked.l_type) {
        libc::F_RDLCK => Some(Hold::Shared),
        libc::F_WRLCK => Some(Hold::Exclusive),
        _ => None,
    })
}

const fn kind(hold: Hold) -> i32 {
    match hold {
        Hold::Shared => libc::F_RDLCK,
        Hold::Exclusive => libc::F_WRLCK,
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the constants are small, their C type is not")]
const fn whole_file(kind: i32) -> libc::flock {
    libc::flock {
        l_type: kind as i16,
        l_whence: libc::SEEK_SET as i16,
        l_start: 0,
        l_len: 0,
        l_pid: 0,
    }
}
