//! Right of way for the loops of a realtime flight.

use std::thread;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Puts the calling thread ahead of everything that has no such priority (`SCHED_FIFO`, 1 to 99).
/// False if this process has no right to it, and stays as it is.
#[must_use]
pub fn take_fifo(priority: u8) -> bool {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let priority = priority.try_into().map(ThreadPriority::Crossplatform);
    priority.is_ok_and(|priority| {
        set_thread_priority_and_policy(thread_native_id(), priority, policy).is_ok()
    })
}

/// True if threads of this process may [`take_fifo`]; tried on one that does nothing else.
#[must_use]
pub fn may_take_fifo(priority: u8) -> bool {
    thread::spawn(move || take_fifo(priority)).join().unwrap_or(false)
}
