//! What a flight needs of the machine.

use super::settings::{Clock, Settings};
pub use host::memory::Available;
use runtime::namespace::BASE;
use std::path::PathBuf;
use thiserror::Error;

/// What a flight is given room for whose memory is not locked \[MB\]: 12 were counted, and slow readers make rings fill.
pub const SHARED_MEMORY_MB: u64 = 160;

/// What a flight has in shared memory whose processes lock it, which touches all of it \[MB\]: with a candidate and a
/// standby in each slot 441 were counted, and 19 for each instance.
pub const LOCKED_MEMORY_MB: u64 = 480;

/// What processes take of their own beside it \[MB\], their executable included, and how much more where all of it is
/// locked: with a candidate and a standby in each slot 136 were counted in all in lockstep, 546 with shared memory
/// reserved, and 623 with all of it locked.
const OWN_MEMORY_MB: u64 = 128;
const OWN_LOCKED_MB: u64 = 128;

/// What a process that joins may add to it \[MB\] where all memory is taken: 19 were counted for a controller, and an
/// estimator that was started again with 24 died of it.
const REALTIME_INSTANCE_MB: u64 = 48;

/// The same where only what is touched is taken: 2 were enough in lockstep.
const INSTANCE_MB: u64 = 8;

/// What it takes of its own \[MB\].
const OWN_INSTANCE_MB: u64 = 24;

/// File descriptors that a launcher may have open at once: with a candidate in each slot 657 were counted.
pub const DESCRIPTORS: u64 = 768;

/// Processes and threads that a flight may have at once, each of which counts: 24 were counted, and 31 with a
/// candidate in a slot and its rehearsal.
pub const TASKS: u64 = 48;

/// Memory that a flight, or a process that joins one, may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryNeed {
    /// Shared memory \[MB\].
    pub shared_mb: u64,
    /// Memory of the processes' own \[MB\].
    pub own_mb: u64,
}

/// Too little memory. Processes die of it: by SIGBUS where shared memory is not there, killed by the kernel where a group of
/// processes may have no more.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Shortage {
    /// The file system of shared memory.
    #[error(
        "{BASE} has {free_mb} MB free and {needed_mb} MB may be needed: remove what fills it, or enlarge it with `mount -o remount,size=512m {BASE}`"
    )]
    Shared {
        /// What is free \[MB\].
        free_mb: u64,
        /// What may be taken \[MB\].
        needed_mb: u64,
    },
    /// All memory.
    #[error(
        "{} leaves {free_mb} MB of memory and {needed_mb} MB may be needed, shared memory included: end other programs, or raise the limit, as by `--memory` of a container",
        by.display()
    )]
    All {
        /// File of the kernel that sets the limit.
        by: PathBuf,
        /// What is left \[MB\].
        free_mb: u64,
        /// What may be taken \[MB\].
        needed_mb: u64,
    },
}

impl MemoryNeed {
    /// Of a flight that takes what it touches, as each does in lockstep.
    pub const LOCKSTEP: Self = Self { shared_mb: SHARED_MEMORY_MB, own_mb: OWN_MEMORY_MB };

    /// Of a flight whose shared memory is taken before it is touched, and not locked.
    pub const RESERVED: Self = Self { shared_mb: LOCKED_MEMORY_MB, own_mb: OWN_MEMORY_MB };

    /// Of a flight that locks all of its memory.
    pub const LOCKED: Self = Self { own_mb: OWN_MEMORY_MB + OWN_LOCKED_MB, ..Self::RESERVED };

    /// Of a flight on a machine where memory may be locked or not.
    #[must_use]
    pub fn of_flight(settings: &Settings, may_lock: bool) -> Self {
        if locks(settings, may_lock) { Self::LOCKED } else { Self::LOCKSTEP }
    }

    /// Of a process that joins in flight, in one that takes all of its shared memory or what it touches.
    #[must_use]
    pub fn of_instance(settings: &Settings, takes_all: bool) -> Self {
        let takes_all = is_realtime(settings) && takes_all;
        let shared_mb = if takes_all { REALTIME_INSTANCE_MB } else { INSTANCE_MB };
        Self { shared_mb, own_mb: OWN_INSTANCE_MB }
    }

    /// Whether it can be had here, where `taken_mb` of the shared memory are its own already. What the system does not
    /// report is not short.
    ///
    /// # Errors
    /// What is short.
    pub fn look(self, taken_mb: u64) -> Result<(), Shortage> {
        self.is_met(free_shared_memory_mb(), Available::here(), taken_mb)
    }

    fn is_met(
        self,
        free_mb: Option<u64>,
        left: Option<Available>,
        taken_mb: u64,
    ) -> Result<(), Shortage> {
        let needed_mb = self.shared_mb.saturating_sub(taken_mb);
        if let Some(free_mb) = free_mb.filter(|free_mb| *free_mb < needed_mb) {
            return Err(Shortage::Shared { free_mb, needed_mb });
        }
        let needed_mb = needed_mb + self.own_mb;
        match left {
            Some(Available { mb: free_mb, by }) if free_mb < needed_mb => {
                Err(Shortage::All { by, free_mb, needed_mb })
            }
            _ => Ok(()),
        }
    }
}

/// Shared memory that is free \[MB\]; none if the system does not report it.
#[must_use]
pub fn free_shared_memory_mb() -> Option<u64> {
    let stat = rustix::fs::statvfs(BASE).ok()?;
    Some(stat.f_bavail.saturating_mul(stat.f_frsize) >> 20)
}

/// True of a realtime flight whose processes lock their memory, on a machine where they may or not.
#[must_use]
pub fn locks(settings: &Settings, may_lock: bool) -> bool {
    is_realtime(settings) && settings.realtime.lock_memory && may_lock
}

fn is_realtime(settings: &Settings) -> bool {
    settings.scenario.clock == Clock::Realtime
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_short_is_reported_with_what_bounds_it() {
        let need = MemoryNeed { shared_mb: 160, own_mb: 40 };
        let left = |mb| Some(Available { mb, by: PathBuf::from("/memory.max") });
        assert_eq!(need.is_met(None, None, 0), Ok(()));
        assert_eq!(need.is_met(Some(160), left(200), 0), Ok(()));
        let short = need.is_met(Some(159), left(0), 0).unwrap_err();
        assert_eq!(short, Shortage::Shared { free_mb: 159, needed_mb: 160 });
        let short = need.is_met(Some(160), left(199), 0).unwrap_err();
        assert!(short.to_string().starts_with("/memory.max leaves 199 MB of memory and 200 MB"));
        // What has been taken before need not be free as well.
        assert_eq!(need.is_met(Some(10), left(50), 150), Ok(()));
        assert!(need.is_met(Some(9), left(50), 150).is_err());
        assert!(need.is_met(Some(10), left(49), 150).is_err());
    }
}
