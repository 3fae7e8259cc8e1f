//! Which process leads a run: the one that holds the folder's `launcher.lock`.
//!
//! The system gives the lock back when its holder dies, however it dies, so the process that gets it knows that
//! no other leads. Its text names the one that took over last, for the run's processes to watch.

use crate::clock::{mono_now_ns, sleep_until};
use crate::namespace_error::{NamespaceError, failed};
use rustix::fs::{FlockOperation, flock, major, minor};
use signal_hook::consts::SIGKILL;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Name of the lock in a run's folder.
const LOCK: &str = "launcher.lock";
/// How long a holder of the lock that lives is given to let go of it, and how long one that dies \[ns\]: on a busy
/// machine the last thread of a process that has been killed may wait for a processor, and until it has had one the
/// process keeps its files.
const LIVING_NS: u64 = 200_000_000;
const DYING_NS: u64 = 20_000_000_000;
/// From one attempt to the next \[ns\].
const ASK_AGAIN_NS: u64 = 2_000_000;

/// Why a run cannot be led by this process.
#[derive(Debug, Error)]
pub enum LeadError {
    /// Another process leads it.
    #[error("{}", match pid {
        Some(pid) => format!("process {pid} leads it"),
        None => "another process leads it".to_owned(),
    })]
    Led {
        /// The other process, as far as the system shows it.
        pid: Option<u32>,
    },
    /// The run's folder.
    #[error(transparent)]
    Namespace(#[from] NamespaceError),
}

/// A process that leads, or has led. Process ids are used again; together with the instant of its start
/// one names a process for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Leader {
    /// Its number.
    pub pid: u32,
    /// When it was started, in ticks since the system was.
    pub started: u64,
}

impl Leader {
    /// A living process; none if there is no such.
    #[must_use]
    pub fn of_process(pid: u32) -> Option<Self> {
        Some(Self { pid, started: process_start(pid)? })
    }

    /// The process that last claimed to lead the run of `folder`, dead or alive.
    #[must_use]
    pub fn of_run(folder: &Path) -> Option<Self> {
        let text = fs::read_to_string(folder.join(LOCK)).ok()?;
        let (pid, started) = text.trim().split_once(' ')?;
        Some(Self { pid: pid.parse().ok()?, started: started.trim().parse().ok()? })
    }

    /// True while it lives.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        Self::of_process(self.pid) == Some(*self)
    }
}

/// When a living process was started, in ticks since the system was; none for one that has ended, be
/// it still waited for.
#[must_use]
pub fn process_start(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name, in parentheses, may hold anything; state is field 3, the start field 22.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    let state = fields.next()?;
    let started = fields.nth(18)?.parse().ok()?;
    (!matches!(state, "Z" | "X")).then_some(started)
}

/// The right to lead a run, for as long as it is held.
#[derive(Debug)]
pub(crate) struct LeaderLock(File);

impl LeaderLock {
    /// Takes the lead of the run in `folder`, which need not have had a leader yet.
    pub(crate) fn take(folder: &Path) -> Result<Self, LeadError> {
        let path = lock_path(folder);
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).mode(0o600);
        let file = file.open(&path).map_err(failed("open", &path))?;
        let begun_ns = mono_now_ns();
        loop {
            match flock(&file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => return Ok(Self(file)),
                Err(error) if error.kind() != ErrorKind::WouldBlock => {
                    return Err(failed("lock", &path)(error.into()).into());
                }
                Err(_) => {
                    let pid = holder(&file);
                    let limit_ns = if pid.is_some_and(is_dying) { DYING_NS } else { LIVING_NS };
                    if mono_now_ns() > begun_ns + limit_ns {
                        return Err(LeadError::Led { pid });
                    }
                    sleep_until(mono_now_ns() + ASK_AGAIN_NS);
                }
            }
        }
    }

    /// Lets the run's processes know.
    pub(crate) fn announce(&mut self, folder: &Path) -> Result<(), NamespaceError> {
        let pid = std::process::id();
        let started = process_start(pid).unwrap_or(0);
        let path = lock_path(folder);
        // In one go, at least as long as what was there: no process reads half a line.
        let line = format!("{pid:<10} {started:<20}\n");
        let written = std::os::unix::fs::FileExt::write_all_at(&self.0, line.as_bytes(), 0);
        written.and_then(|()| self.0.flush()).map_err(failed("write", &path))
    }
}

/// Process that leads the run in `folder`; none if its launcher has died.
#[must_use]
pub fn leading(folder: &Path) -> Option<u32> {
    let held = File::open(lock_path(folder)).ok().and_then(|file| holder(&file));
    held.or_else(|| Leader::of_run(folder).filter(Leader::is_alive).map(|leader| leader.pid))
}

fn lock_path(folder: &Path) -> PathBuf {
    folder.join(LOCK)
}

/// True of a process that has ended but for some of its threads, or that a SIGKILL awaits.
fn is_dying(pid: u32) -> bool {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    process_start(pid).is_none() || is_killed(&status)
}

/// Whether a SIGKILL is among the pending signals of a process with this `/proc/PID/status`.
fn is_killed(status: &str) -> bool {
    let pending = ["SigPnd:", "ShdPnd:"];
    let mut masks = status.lines().filter_map(|line| {
        let hex = pending.iter().find_map(|key| line.strip_prefix(key))?;
        u64::from_str_radix(hex.trim(), 16).ok()
    });
    masks.any(|mask| mask & 1 << (SIGKILL - 1) != 0)
}

/// The process that holds a lock on a file, by the system's own list.
fn holder(file: &File) -> Option<u32> {
    let found = file.metadata().ok()?;
    let locks = fs::read_to_string("/proc/locks").ok()?;
    holder_in(&locks, found.dev(), found.ino())
}

/// As [`holder`], in the text of `/proc/locks`. Inodes are numbered anew on each device.
fn holder_in(locks: &str, device: u64, inode: u64) -> Option<u32> {
    let wanted = format!("{:02x}:{:02x}:{inode}", major(device), minor(device));
    // `1: FLOCK  ADVISORY  WRITE 4711 00:1a:815 0 EOF`
    locks.lines().find_map(|line| {
        let mut fields = line.split_whitespace();
        let pid = fields.nth(4)?;
        (fields.next()? == wanted).then(|| pid.parse().ok())?
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::makedev;

    fn folder() -> PathBuf {
        // On some file systems (btrfs, overlayfs) /proc/locks shows another device than stat.
        let folder = Path::new("/dev/shm").join(format!("leader-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_process_is_dying_from_the_signal_to_the_end_of_its_last_thread() {
        let status = "Name:\tlauncher\nSigQ:\t0/3\nSigPnd:\t0000000000000000\n";
        assert!(is_killed(&format!("{status}ShdPnd:\t0000000000000100\n")));
        assert!(!is_killed(&format!(
            "{status}ShdPnd:\t0000000000000202\nSigIgn:\t0000000000000100\n"
        )));
        assert!(!is_dying(std::process::id()));
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let pid = child.id();
        // Until it has been waited for it stays in the table of processes.
        while !is_dying(pid) {
            sleep_until(mono_now_ns() + 1_000_000);
        }
        child.wait().unwrap();
        assert!(is_dying(pid));
    }

    #[test]
    fn a_lock_on_the_same_inode_of_another_device_is_of_another_file() {
        let locks = "1: FLOCK  ADVISORY  WRITE 11 fe:00:815 0 EOF\n\
                     2: FLOCK  ADVISORY  WRITE 12 00:1a:8150 0 EOF\n\
                     3: FLOCK  ADVISORY  WRITE 13 00:1a:815 0 EOF\n";
        let [disk, memory] = [(0xfe, 0), (0, 0x1a)].map(|(major, minor)| makedev(major, minor));
        let found = [disk, memory].map(|device| holder_in(locks, device, 815));
        assert_eq!(found, [Some(11), Some(13)]);
        assert_eq!(holder_in(locks, memory, 816), None);
    }

    #[test]
    fn one_leads_at_a_time_and_the_other_learns_which() {
        let folder = folder();
        assert_eq!(leading(&folder), None);
        let mut first = LeaderLock::take(&folder).unwrap();
        first.announce(&folder).unwrap();
        let own = std::process::id();
        assert_eq!(leading(&folder), Some(own));
        let second = LeaderLock::take(&folder).unwrap_err();
        assert!(matches!(second, LeadError::Led { pid } if pid == Some(own)), "{second}");
        let leader = Leader::of_run(&folder).unwrap();
        assert!(leader.pid == own && leader.is_alive());
        assert!(!Leader { started: leader.started + 1, ..leader }.is_alive(), "a reused number");
        drop(first);
        LeaderLock::take(&folder).unwrap();
        fs::remove_dir_all(&folder).unwrap();
    }
}
