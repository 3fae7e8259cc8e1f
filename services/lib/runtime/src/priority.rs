//! Right of way for the loops of a realtime flight.

use core::time::Duration;
use std::thread::Builder;
use thread_priority::{
    DeadlineFlags, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// How the system is to schedule a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schedule {
    /// Ahead of everything of a lower priority, 1 to 99 (`SCHED_FIFO`).
    Fifo(u8),
    /// A budget of processor time in each period (`SCHED_DEADLINE`).
    Deadline {
        /// Processor time \[ns\].
        budget_ns: u64,
        /// In each of these \[ns\].
        period_ns: u64,
    },
}

impl Schedule {
    /// Has the calling thread scheduled so. False if this process has no right to it, and stays as it
    /// is.
    #[must_use]
    pub fn take(self) -> bool {
        let (policy, priority) = match self {
            Self::Fifo(priority) => {
                let Ok(priority) = priority.try_into() else { return false };
                (RealtimeThreadSchedulePolicy::Fifo, ThreadPriority::Crossplatform(priority))
            }
            Self::Deadline { budget_ns, period_ns } => {
                let priority = ThreadPriority::Deadline {
                    runtime: Duration::from_nanos(budget_ns),
                    deadline: Duration::from_nanos(period_ns),
                    period: Duration::from_nanos(period_ns),
                    // Such a thread may start no other that is scheduled likewise.
                    flags: DeadlineFlags::RESET_ON_FORK,
                };
                (RealtimeThreadSchedulePolicy::Deadline, priority)
            }
        };
        let policy = ThreadSchedulePolicy::Realtime(policy);
        set_thread_priority_and_policy(thread_native_id(), priority, policy).is_ok()
    }

    /// True if threads of this process may be scheduled so; tried on one that does nothing else.
    #[must_use]
    pub fn is_allowed(self) -> bool {
        let tried = Builder::new().spawn(move || self.take());
        tried.is_ok_and(|thread| thread.join().unwrap_or(false))
    }
}
