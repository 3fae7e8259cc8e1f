//! What a loop costs besides its steps: allocations and page faults, which a warm loop has none of.

use rustix::fs::{CWD, Mode, OFlags, openat};
use rustix::io::pread;
use std::os::fd::OwnedFd;
use std::sync::OnceLock;

/// Runs a closure and tells how often it allocated, in an executable whose allocator counts.
pub type AllocationCounter = fn(&mut dyn FnMut()) -> u64;

static COUNTER: OnceLock<AllocationCounter> = OnceLock::new();

/// Has the loops of this process count their allocations.
pub fn count_allocations_with(counter: AllocationCounter) {
    // The first counter stays: there is one allocator.
    let _ = COUNTER.set(counter);
}

/// Logical time after its first release in which a loop may still fault and allocate \[ns\].
const WARM_UP_NS: u64 = 500_000_000;
/// Logical time between two looks at the system's counts \[ns\].
const LOOK_EVERY_NS: u64 = 100_000_000;

/// What a loop has had since it was warm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Costs {
    /// Allocations.
    pub allocations: u64,
    /// Page faults that memory resolved.
    pub minor_faults: u64,
    /// Page faults that had to wait for a disk.
    pub major_faults: u64,
}

impl Costs {
    fn since(self, before: Self) -> Self {
        Self {
            allocations: self.allocations - before.allocations,
            minor_faults: self.minor_faults.saturating_sub(before.minor_faults),
            major_faults: self.major_faults.saturating_sub(before.major_faults),
        }
    }

    fn add(&mut self, more: Self) {
        self.allocations += more.allocations;
        self.minor_faults += more.minor_faults;
        self.major_faults += more.major_faults;
    }
}

/// Counts for the thread that it was made on.
#[derive(Debug)]
pub(crate) struct Upkeep {
    stat: Option<OwnedFd>,
    /// Everything so far.
    seen: Costs,
    /// As seen at the last look.
    looked: Costs,
    warm_ns: Option<u64>,
    next_look_ns: u64,
    /// Somebody has come or gone since the last look, or in the stretch before.
    changed: [bool; 2],
    /// In stretches in which nobody came or went, and in the others.
    pub(crate) steady: Costs,
    pub(crate) at_changes: Costs,
}

impl Upkeep {
    pub(crate) fn of_this_thread() -> Self {
        let flags = OFlags::RDONLY | OFlags::CLOEXEC;
        Self {
            stat: openat(CWD, "/proc/thread-self/stat", flags, Mode::empty()).ok(),
            seen: Costs::default(),
            looked: Costs::default(),
            warm_ns: None,
            next_look_ns: 0,
            changed: [false; 2],
            steady: Costs::default(),
            at_changes: Costs::default(),
        }
    }

    /// Somebody has come or gone, for whom ports are opened or closed.
    pub(crate) fn note_change(&mut self) {
        self.changed[0] = true;
    }

    pub(crate) fn note_allocations(&mut self, count: u64) {
        self.seen.allocations += count;
    }

    /// Looks at the system's counts if it is time to; a few microseconds, between two steps.
    pub(crate) fn look(&mut self, now_ns: u64) {
        let warm_ns = *self.warm_ns.get_or_insert(now_ns + WARM_UP_NS);
        if now_ns < self.next_look_ns.max(warm_ns) {
            return;
        }
        let was_warm = self.next_look_ns > 0;
        self.next_look_ns = now_ns + LOOK_EVERY_NS;
        if let Some((minor, major)) = self.stat.as_ref().and_then(read_faults) {
            (self.seen.minor_faults, self.seen.major_faults) = (minor, major);
        }
        let new = self.seen.since(self.looked);
        self.looked = self.seen;
        if was_warm {
            let changed = self.changed != [false; 2];
            if changed { &mut self.at_changes } else { &mut self.steady }.add(new);
        }
        self.changed = [false, self.changed[0]];
    }
}

/// Runs something and tells how often it allocated; 0 if nobody counts.
pub(crate) fn count_allocations(run: &mut dyn FnMut()) -> u64 {
    if let Some(count) = COUNTER.get() {
        return count(run);
    }
    run();
    0
}

fn read_faults(stat: &OwnedFd) -> Option<(u64, u64)> {
    let mut bytes = [0; 512];
    let length = pread(stat, &mut bytes, 0).ok()?;
    parse_faults(core::str::from_utf8(&bytes[..length]).ok()?)
}

/// Minor and major faults of a line of `/proc/PID/stat`.
fn parse_faults(stat: &str) -> Option<(u64, u64)> {
    // The name before it may hold anything; the word after it is the third.
    let (_, rest) = stat.rsplit_once(')')?;
    let mut words = rest.split_ascii_whitespace().skip(10 - 3);
    let minor = words.next()?.parse().ok()?;
    let major = words.nth(1)?.parse().ok()?;
    Some((minor, major))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    #[test]
    fn faults_are_found_behind_any_name() {
        let stat = "7 (a b) R) S 1 7 7 0 -1 4194560 99 5 3 1 150 50 0 0 20 0 1 0 9000 1 256 0";
        assert_eq!(parse_faults(stat), Some((99, 3)));
        assert_eq!(parse_faults("7 (x) S 1"), None);
    }

    #[test]
    fn what_a_cold_loop_costs_is_not_held_against_it() {
        let mut upkeep = Upkeep { stat: None, ..Upkeep::of_this_thread() };
        upkeep.look(0);
        upkeep.note_allocations(5);
        upkeep.look(SECOND_NS);
        assert_eq!(upkeep.steady, Costs::default());
        upkeep.note_allocations(2);
        upkeep.look(2 * SECOND_NS);
        assert_eq!(upkeep.steady.allocations, 2);
    }

    #[test]
    fn what_falls_to_a_change_or_just_after_it_is_counted_apart() {
        let mut upkeep = Upkeep { stat: None, ..Upkeep::of_this_thread() };
        upkeep.look(0);
        upkeep.look(SECOND_NS);
        upkeep.note_change();
        for (second, allocations) in [(2, 1), (3, 10), (4, 100)] {
            upkeep.note_allocations(allocations);
            upkeep.look(second * SECOND_NS);
        }
        assert_eq!(upkeep.at_changes.allocations, 11);
        assert_eq!(upkeep.steady.allocations, 100);
    }

    #[test]
    fn touching_new_memory_is_a_fault_of_this_thread() {
        let mut upkeep = Upkeep::of_this_thread();
        upkeep.look(0);
        upkeep.look(SECOND_NS);
        let pages = vec![1_u8; 64 << 20];
        core::hint::black_box(&pages);
        upkeep.look(2 * SECOND_NS);
        assert!(upkeep.steady.minor_faults > 0);
    }
}
