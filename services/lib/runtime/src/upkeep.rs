//! What a loop costs besides its steps: allocations and page faults, which a warm loop has none of.

use core::cell::Cell;
use rustix::fs::{CWD, Mode, OFlags, openat};
use rustix::io::pread;
use std::os::fd::OwnedFd;
use std::sync::OnceLock;

/// Runs a closure and returns how often it allocated, in an executable whose allocator counts.
pub type AllocationCounter = fn(&mut dyn FnMut()) -> u64;

static COUNTER: OnceLock<AllocationCounter> = OnceLock::new();

/// Has the loops of this process count their allocations.
pub fn count_allocations_with(counter: AllocationCounter) {
    // The first counter stays: there is one allocator.
    let _ = COUNTER.set(counter);
}

thread_local! {
    /// Allocations of the transport on this thread.
    static IN_TRANSPORT: Cell<u64> = const { Cell::new(0) };
}

/// Logical time after its first release in which a loop may still fault and allocate \[ns\].
const WARM_UP_NS: u64 = 500_000_000;
/// Logical time between two looks at the system's counts \[ns\].
const LOOK_EVERY_NS: u64 = 100_000_000;

/// What a loop has had since it was warm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Costs {
    /// Allocations of our own.
    pub allocations: u64,
    /// Allocations of the transport, which takes a small block for each sample that it lends.
    pub transport_allocations: u64,
    /// Page faults that memory resolved.
    pub minor_faults: u64,
    /// Page faults that had to wait for a disk.
    pub major_faults: u64,
}

impl Costs {
    fn since(self, before: Self) -> Self {
        Self {
            allocations: self.allocations - before.allocations,
            transport_allocations: self.transport_allocations - before.transport_allocations,
            minor_faults: self.minor_faults.saturating_sub(before.minor_faults),
            major_faults: self.major_faults.saturating_sub(before.major_faults),
        }
    }

    fn add(&mut self, more: Self) {
        self.allocations += more.allocations;
        self.transport_allocations += more.transport_allocations;
        self.minor_faults += more.minor_faults;
        self.major_faults += more.major_faults;
    }
}

/// Allocations of a stretch of a loop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Allocations {
    own: u64,
    of_transport: u64,
}

/// Counts for the thread that it was made on.
#[derive(Debug)]
pub(crate) struct Upkeep {
    stat: Option<OwnedFd>,
    /// Everything so far.
    seen: Costs,
    /// As seen at the last look.
    looked: Costs,
    /// Of the last stretch, until it is known that no process came right after it.
    held: Costs,
    warm_ns: Option<u64>,
    next_look_ns: u64,
    /// A process has come or gone since the last look, or in either of the two stretches before.
    changed: [bool; 3],
    /// In stretches in which no process came or went, and in the others.
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
            held: Costs::default(),
            warm_ns: None,
            next_look_ns: 0,
            changed: [false; 3],
            steady: Costs::default(),
            at_changes: Costs::default(),
        }
    }

    /// A process has come or gone, for which ports are opened or closed.
    pub(crate) fn note_change(&mut self) {
        self.changed[0] = true;
    }

    pub(crate) fn note_allocations(&mut self, count: Allocations) {
        self.seen.allocations += count.own;
        self.seen.transport_allocations += count.of_transport;
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
            // A process that comes opens ports before any other is notified, and one that has gone
            // is missed afterwards.
            let held = core::mem::replace(&mut self.held, new);
            let changed = self.changed != [false; 3];
            if changed { &mut self.at_changes } else { &mut self.steady }.add(held);
        }
        self.changed = [false, self.changed[0], self.changed[1]];
    }
}

/// Runs a stretch of a loop and returns what it allocated.
pub(crate) fn count_stretch(run: &mut dyn FnMut()) -> Allocations {
    let before = IN_TRANSPORT.get();
    let all = count_allocations(run);
    let of_transport = IN_TRANSPORT.get() - before;
    Allocations { own: all.saturating_sub(of_transport), of_transport }
}

/// Runs a call of the transport, whose allocations are its own.
pub(crate) fn in_transport(call: &mut dyn FnMut()) {
    let count = count_allocations(call);
    IN_TRANSPORT.set(IN_TRANSPORT.get() + count);
}

/// Runs something and returns how often it allocated; 0 if nothing counts.
fn count_allocations(run: &mut dyn FnMut()) -> u64 {
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
    // The name before it may hold anything; the field after it is the third.
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_ascii_whitespace().skip(10 - 3);
    let minor = fields.next()?.parse().ok()?;
    let major = fields.nth(1)?.parse().ok()?;
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

    /// Looks each second; of each stretch: what it allocates, and whether a process comes in it.
    fn watched(stretches: &[(u64, bool)]) -> Upkeep {
        let mut upkeep = Upkeep { stat: None, ..Upkeep::of_this_thread() };
        upkeep.look(0);
        for ((allocations, has_arrivals), second) in stretches.iter().zip(1..) {
            upkeep.seen.allocations += allocations;
            if *has_arrivals {
                upkeep.note_change();
            }
            upkeep.look(second * SECOND_NS);
        }
        upkeep
    }

    #[test]
    fn what_a_cold_loop_costs_is_not_held_against_it() {
        let upkeep = watched(&[(5, false), (0, false)]);
        assert_eq!(upkeep.steady, Costs::default());
        let upkeep = watched(&[(5, false), (2, false), (0, false)]);
        assert_eq!(upkeep.steady.allocations, 2);
    }

    #[test]
    fn what_falls_next_to_a_change_is_counted_apart() {
        let stretches = [(0, false), (1, false), (10, false), (100, true), (1000, false)];
        let upkeep = watched(&[&stretches[..], &[(10_000, false), (0, false)]].concat());
        assert_eq!(upkeep.at_changes.allocations, 1110);
        assert_eq!(upkeep.steady.allocations, 10_001);
    }

    #[test]
    fn the_transport_has_an_account_of_its_own() {
        // Every allocation of this test counts as one, whichever test asks.
        count_allocations_with(|run| {
            run();
            1
        });
        let counted = count_stretch(&mut || in_transport(&mut || {}));
        assert_eq!(counted, Allocations { own: 0, of_transport: 1 });
    }

    #[test]
    fn touching_new_memory_is_a_fault_of_this_thread() {
        let mut upkeep = Upkeep::of_this_thread();
        upkeep.look(0);
        upkeep.look(SECOND_NS);
        let pages = vec![1_u8; 64 << 20];
        core::hint::black_box(&pages);
        upkeep.look(2 * SECOND_NS);
        upkeep.look(3 * SECOND_NS);
        assert!(upkeep.steady.minor_faults > 0);
    }
}
