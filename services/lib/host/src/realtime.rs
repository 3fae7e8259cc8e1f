//! What a realtime loop asks of the system: right of way, memory that stays, processors, exact timers.

use core::hint::black_box;
use core::num::NonZeroU64;
use runtime::priority::Schedule;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{
    CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity,
    set_current_timer_slack,
};
use serde::{Deserialize, Serialize};
use std::fs;
use thiserror::Error;

/// Stack that a step may use \[bytes\]; touched before the flight.
const STACK: usize = 512 * 1024;

/// How loops are scheduled.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Policy {
    /// Like any program.
    Other,
    /// `SCHED_FIFO`, with a priority for each loop.
    #[default]
    Fifo,
    /// `SCHED_DEADLINE`, with a budget for each loop.
    Deadline,
}

/// What all loops of a flight have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Realtime {
    /// How they are scheduled.
    pub policy: Policy,
    /// Whether their memory is kept in place, all of it touched before the flight.
    pub lock_memory: bool,
    /// By how much the system may put off a timer \[ns\].
    pub timer_slack_ns: u64,
    /// Whether to refuse to fly without all of this.
    pub strict: bool,
}

/// What one loop asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setup {
    /// Right of way, if any.
    pub schedule: Option<Schedule>,
    /// Processors to stay on; none for any.
    pub cpus: Vec<usize>,
    /// See [`Realtime::lock_memory`].
    pub lock_memory: bool,
    /// See [`Realtime::timer_slack_ns`].
    pub timer_slack_ns: u64,
}

/// What the system did not grant, and what would make it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Shortfall {
    /// No `SCHED_FIFO`.
    #[error(
        "no right to priority {0} (SCHED_FIFO): raise `ulimit -r` to {0}, or give cap_sys_nice"
    )]
    Fifo(u8),
    /// No `SCHED_DEADLINE`.
    #[error(
        "no right to SCHED_DEADLINE, or too little processor time left for it: give cap_sys_nice, lower realtime.budget_share, and leave realtime.cpus away"
    )]
    Deadline,
    /// No `mlockall`.
    #[error("no right to lock memory: raise `ulimit -l` to unlimited, or give cap_ipc_lock")]
    Memory,
    /// No such processors.
    #[error("not allowed on the processors of realtime.cpus: name some of this machine")]
    Processors,
    /// No `PR_SET_TIMERSLACK`.
    #[error("timers keep the system's slack")]
    TimerSlack,
}

impl Setup {
    /// Asks for all of it, for the calling thread, and for its process as far as memory is concerned.
    /// To be called when every port is open. What is not granted is left as it is.
    #[must_use]
    pub fn apply(&self) -> Vec<Shortfall> {
        let mut shortfalls = Vec::new();
        if !self.cpus.is_empty() && !stay_on_any(&self.cpus) {
            shortfalls.push(Shortfall::Processors);
        }
        if let Some(slack) = NonZeroU64::new(self.timer_slack_ns)
            && set_current_timer_slack(Some(slack)).is_err()
        {
            shortfalls.push(Shortfall::TimerSlack);
        }
        touch_stack();
        if self.lock_memory && mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).is_err() {
            shortfalls.push(Shortfall::Memory);
        }
        if let Some(schedule) = self.schedule.filter(|schedule| !schedule.take()) {
            shortfalls.push(of_schedule(schedule));
        }
        shortfalls
    }

    /// What [`apply`](Self::apply) would not be granted, without asking for it. Whether there is time
    /// left for a budget can only be found by asking.
    #[must_use]
    pub fn shortfalls(&self) -> Vec<Shortfall> {
        let processors = allowed_processors();
        let no_processors = self.cpus.iter().any(|cpu| !processors.contains(cpu));
        let schedule = self.schedule.filter(|schedule| !schedule.is_allowed());
        [
            no_processors.then_some(Shortfall::Processors),
            (self.lock_memory && !may_lock_memory()).then_some(Shortfall::Memory),
            schedule.map(of_schedule),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

fn of_schedule(schedule: Schedule) -> Shortfall {
    match schedule {
        Schedule::Fifo(priority) => Shortfall::Fifo(priority),
        Schedule::Deadline { .. } => Shortfall::Deadline,
    }
}

/// Processors that the calling thread may run on.
#[must_use]
pub fn allowed_processors() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
    (0..CpuSet::MAX_CPU).filter(|cpu| set.is_set(*cpu)).collect()
}

/// True if all memory of a process may be locked.
#[must_use]
pub fn may_lock_memory() -> bool {
    let capable =
        capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    (capable && has_initial_users()) || getrlimit(Resource::Memlock).current.is_none()
}

/// True unless this process is in a namespace of users of its own, as in a container without root: what it may do there
/// counts for nothing where the kernel asks what it may do on the machine.
pub(crate) fn has_initial_users() -> bool {
    fs::read_to_string("/proc/self/uid_map")
        .is_ok_and(|map| map.split_whitespace().eq(["0", "0", "4294967295"]))
}

fn stay_on_any(cpus: &[usize]) -> bool {
    let mut set = CpuSet::new();
    cpus.iter().filter(|cpu| **cpu < CpuSet::MAX_CPU).for_each(|cpu| set.set(*cpu));
    sched_setaffinity(None, &set).is_ok()
}

/// Has the pages of the stack that steps will use in place.
#[inline(never)]
#[expect(clippy::large_stack_arrays, reason = "the stack is what it is about")]
fn touch_stack() {
    let pages = [1_u8; STACK];
    black_box(&pages);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    fn setup(cpus: Vec<usize>) -> Setup {
        Setup { schedule: None, cpus, lock_memory: false, timer_slack_ns: 1000 }
    }

    #[test]
    fn a_thread_is_moved_to_its_processors_and_its_timers_become_exact() {
        thread::spawn(|| {
            let cpu = *allowed_processors().last().unwrap();
            assert_eq!(setup(vec![cpu]).apply(), []);
            assert_eq!(allowed_processors(), [cpu]);
            assert_eq!(rustix::thread::current_timer_slack().unwrap(), 1000);
        })
        .join()
        .unwrap();
    }

    #[test]
    fn what_is_not_granted_is_named_and_changes_nothing() {
        thread::spawn(|| {
            let before = allowed_processors();
            let none = setup(vec![CpuSet::MAX_CPU - 1]);
            assert_eq!(none.shortfalls(), [Shortfall::Processors]);
            assert_eq!(none.apply(), [Shortfall::Processors]);
            assert_eq!(allowed_processors(), before);
        })
        .join()
        .unwrap();
        for shortfall in [Shortfall::Fifo(12), Shortfall::Deadline, Shortfall::Memory] {
            assert!(shortfall.to_string().contains(':'), "{shortfall}");
        }
    }
}
