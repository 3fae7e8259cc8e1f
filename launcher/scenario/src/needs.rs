//! What a flight needs of the machine.

use super::settings::{Clock, Settings};

/// What a flight is given room for whose memory is not locked \[MB\]: 12 were counted, and slow readers make rings fill.
pub const SHARED_MEMORY_MB: u64 = 160;

/// What a flight has in shared memory whose processes lock it, which touches all of it \[MB\]: with a candidate and a
/// standby in each slot 441 were counted, and 19 for each instance.
pub const LOCKED_MEMORY_MB: u64 = 480;

/// File descriptors that a launcher may have open at once: with a candidate in each slot 657 were counted.
pub const DESCRIPTORS: u64 = 768;

/// Shared memory that a flight may touch \[MB\], on a machine where memory may be locked or not.
#[must_use]
pub fn shared_memory_mb(settings: &Settings, may_lock: bool) -> u64 {
    let is_realtime = settings.scenario.clock == Clock::Realtime;
    if is_realtime && settings.realtime.lock_memory && may_lock {
        LOCKED_MEMORY_MB
    } else {
        SHARED_MEMORY_MB
    }
}
