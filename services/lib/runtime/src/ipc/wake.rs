//! Waking a process that waits for its inputs.
//!
//! A wake-up carries no information: the woken process re-reads marks and inputs. Waits always
//! have a limit, after which shared memory is read again; a lost wake-up therefore costs time and
//! never a sample.
//!
//! A wake-up is a byte in a named pipe of the run's folder. The transport's own events are unix
//! sockets behind a set of counters: eight system calls where a pipe needs three, and a window in
//! which a wake-up is lost. `cargo bench --bench lockstep` measures both.

use super::{Bus, PortError, ServiceKind};
use core::time::Duration;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{CWD, FileType, Mode, OFlags, link, mknodat, open};
use rustix::io::{Errno, read, write};
use shared_types::Seat;
use std::os::fd::OwnedFd;
use std::path::PathBuf;

impl Bus {
    /// Creates what wakes a seat's process (launcher only); it lives as long as the run's folder.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_wake(&self, seat: Seat) -> Result<(), PortError> {
        let mode = Mode::RUSR | Mode::WUSR;
        mknodat(CWD, self.wake_path(seat), FileType::Fifo, mode, 0)
            .map_err(PortError::transport(&ServiceKind::Wake(seat).name(), "create the pipe"))
    }

    /// Lets each process that wakes `seat` wake the one of seat `of`, whose pipe exists (launcher only): the two
    /// have one pipe.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn share_wake(&self, seat: Seat, of: Seat) -> Result<(), PortError> {
        link(self.wake_path(of), self.wake_path(seat))
            .map_err(PortError::transport(&ServiceKind::Wake(seat).name(), "share the pipe"))
    }

    fn open_wake(&self, seat: Seat) -> Result<OwnedFd, PortError> {
        // Both directions at each end: neither has to wait for, or survive, the other end.
        let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
        open(self.wake_path(seat), flags, Mode::empty())
            .map_err(PortError::transport(&ServiceKind::Wake(seat).name(), "open the pipe"))
    }

    fn wake_path(&self, seat: Seat) -> PathBuf {
        self.folder.join(format!("wake-{}", seat.label()))
    }
}

/// The waiting end.
#[derive(Debug)]
pub struct WakeListener {
    pipe: OwnedFd,
}

impl WakeListener {
    /// Opens the wake-ups of one's own seat.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, seat: Seat) -> Result<Self, PortError> {
        Ok(Self { pipe: bus.open_wake(seat)? })
    }

    /// Waits for a wake-up; true if one came before the limit. Those that came since the last
    /// wait are one.
    #[must_use]
    pub fn wait(&self, limit: Duration) -> bool {
        let limit = Timespec::try_from(limit).ok();
        let mut waited_for = [PollFd::new(&self.pipe, PollFlags::IN)];
        // A signal interrupts the wait; the caller looks at its flags either way.
        let woken = poll(&mut waited_for, limit.as_ref()).is_ok_and(|ready| ready > 0);
        woken && self.drain()
    }

    fn drain(&self) -> bool {
        let mut bytes = [0; 128];
        let mut any = false;
        loop {
            match read(&self.pipe, &mut bytes) {
                Ok(count) => {
                    any |= count > 0;
                    if count < bytes.len() {
                        return any;
                    }
                }
                Err(Errno::INTR) => {}
                Err(_) => return any,
            }
        }
    }
}

/// The waking end.
#[derive(Debug)]
pub struct WakeNotifier {
    pipe: OwnedFd,
}

impl WakeNotifier {
    /// Opens the wake-ups of another seat.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, seat: Seat) -> Result<Self, PortError> {
        Ok(Self { pipe: bus.open_wake(seat)? })
    }

    /// Wakes the process that waits; if none does, that is fine.
    pub fn wake(&self) {
        // A full pipe wakes just as well.
        let _ = write(&self.pipe, &[1]);
    }
}
