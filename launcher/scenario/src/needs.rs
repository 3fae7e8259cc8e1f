//! What a flight needs of the machine.

use super::settings::{Clock, Settings};
use rustix::process::{Resource, geteuid, getrlimit};
use std::fs;
use std::os::unix::fs::MetadataExt as _;

/// What a flight is given room for whose memory is not locked \[MB\]: 12 were counted, and slow readers make rings fill.
pub const SHARED_MEMORY_MB: u64 = 160;

/// What a flight has in shared memory whose processes lock it, which touches all of it \[MB\]: with a candidate and a
/// standby in each slot 441 were counted, and 19 for each instance.
pub const LOCKED_MEMORY_MB: u64 = 480;

/// What a process that joins may add to it \[MB\] where all memory is taken: 19 were counted for a controller, and an estimator that was
/// started again with 24 died of it.
const REALTIME_INSTANCE_MB: u64 = 48;

/// The same where only what is touched is taken: 2 were enough in lockstep.
const INSTANCE_MB: u64 = 8;

/// File descriptors that a launcher may have open at once: with a candidate in each slot 657 were counted.
pub const DESCRIPTORS: u64 = 768;

/// Processes and threads that a flight may have at once, each of which counts: 24 were counted, and 31 with a
/// candidate in a slot and its rehearsal.
pub const TASKS: u64 = 48;

/// Processes and threads of a user whose number is limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tasks {
    /// Those that are there.
    pub used: u64,
    /// As many as may be.
    pub limit: u64,
}

impl Tasks {
    /// Of this process's user; none where nothing limits them.
    #[must_use]
    pub fn of_user() -> Option<Self> {
        // The limit is not for root, whatever it says.
        let limit = getrlimit(Resource::Nproc).current.filter(|_| !geteuid().is_root())?;
        let own = geteuid().as_raw();
        let processes = fs::read_dir("/proc").ok()?.flatten();
        let processes = processes.filter(|entry| {
            entry.file_name().to_string_lossy().parse::<u32>().is_ok()
                && entry.metadata().is_ok_and(|found| found.uid() == own)
        });
        let threads = processes
            .map(|entry| fs::read_dir(entry.path().join("task")).map_or(0, Iterator::count));
        Some(Self { used: threads.sum::<usize>() as u64, limit })
    }

    /// True if a flight has room beside those that are there.
    #[must_use]
    pub fn suffice(&self) -> bool {
        self.limit.saturating_sub(self.used) >= TASKS
    }
}

/// Shared memory that a flight may touch \[MB\], on a machine where memory may be locked or not.
#[must_use]
pub fn shared_memory_mb(settings: &Settings, may_lock: bool) -> u64 {
    if locks(settings, may_lock) { LOCKED_MEMORY_MB } else { SHARED_MEMORY_MB }
}

/// Shared memory that a process may take that joins in flight \[MB\], in one that takes all of it or what it touches:
/// without it, it and those that it talks to would die of SIGBUS.
#[must_use]
pub fn instance_mb(settings: &Settings, takes_all: bool) -> u64 {
    if is_realtime(settings) && takes_all { REALTIME_INSTANCE_MB } else { INSTANCE_MB }
}

/// True of a realtime flight whose processes lock their memory, on a machine where they may or not.
#[must_use]
pub fn locks(settings: &Settings, may_lock: bool) -> bool {
    is_realtime(settings) && settings.realtime.lock_memory && may_lock
}

fn is_realtime(settings: &Settings) -> bool {
    settings.scenario.clock == Clock::Realtime
}
