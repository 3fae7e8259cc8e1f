//! From the stamps of a flight to durations. Pure: what it is given decides what comes out.

mod chain;
mod steps;

pub use chain::{Chain, Chains, Link, SETPOINT_HOLD};
pub(super) use steps::stamps;
pub use steps::{FIGURES, Moment, Steps};

use observe::stopwatch::{Look, Stopwatch};
use observe::sum;
use observe::usage::Usage;
use runtime::seat_of_loop;
use shared_types::{LoopStats, Role};

/// The part of a flight that is judged, and what came before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Logical end of the warm-up \[ns\].
    pub warm_ns: u64,
    /// Host instant of logical time 0 \[ns\].
    pub start_mono_ns: u64,
    /// Logical end of the flight \[ns\].
    pub end_ns: u64,
}

impl Window {
    /// True once the warm-up is over.
    #[must_use]
    pub fn is_warm(&self, release_ns: u64) -> bool {
        release_ns >= self.warm_ns
    }

    /// Host instant of a logical one \[ns\].
    #[must_use]
    pub fn mono_ns_of(&self, logical_ns: u64) -> u64 {
        self.start_mono_ns + logical_ns
    }

    /// From and to on the host's clock \[ns\].
    #[must_use]
    pub fn mono_ns(&self) -> [u64; 2] {
        [self.mono_ns_of(self.warm_ns), self.mono_ns_of(self.end_ns)]
    }
}

/// Difference of a loop's running totals over the window, over all its lives; none without two samples of them. A process
/// that takes the seat of a dead one in flight counts from nothing.
#[must_use]
pub fn totals(watch: &Stopwatch, role: Role, seat: u32, window: &Window) -> Option<LoopStats> {
    let of_loop = watch.totals.iter().filter(|stats| {
        // The recorder distinguishes loops by 8 times the seat plus the role.
        stats.role == role && seat_of_loop(stats.header.seat) == seat
    });
    let warm: Vec<&LoopStats> =
        of_loop.filter(|stats| window.is_warm(stats.header.release_ns)).collect();
    let nothing = LoopStats::default();
    let pairs = warm.windows(2).map(|pair| {
        let (before, now) = (pair[0], pair[1]);
        let is_other = before.header.generation != now.header.generation;
        let counts_anew = is_other && now.steps < before.steps;
        since(now, if counts_anew { &nothing } else { before })
    });
    pairs.reduce(|all, next| sum(&all, &next))
}

/// What was counted from one sample of a loop's totals to the next.
fn since(last: &LoopStats, first: &LoopStats) -> LoopStats {
    let since = |now: u64, before: u64| now.saturating_sub(before);
    LoopStats {
        steps: since(last.steps, first.steps),
        skipped: since(last.skipped, first.skipped),
        caught_up: since(last.caught_up, first.caught_up),
        input_deadline_misses: since(last.input_deadline_misses, first.input_deadline_misses),
        late_samples: since(last.late_samples, first.late_samples),
        lost_samples: since(last.lost_samples, first.lost_samples),
        rescued_waits: since(last.rescued_waits, first.rescued_waits),
        allocations: since(last.allocations, first.allocations),
        transport_allocations: since(last.transport_allocations, first.transport_allocations),
        allocations_at_changes: since(last.allocations_at_changes, first.allocations_at_changes),
        minor_faults: since(last.minor_faults, first.minor_faults),
        major_faults: since(last.major_faults, first.major_faults),
        faults_at_changes: since(last.faults_at_changes, first.faults_at_changes),
        ..LoopStats::default()
    }
}

/// What a process took within the window, and what of it while others joined or left.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Taken {
    /// With all processes there.
    pub settled: Usage,
    /// While a process came or went.
    pub moved: Usage,
    /// How long the first was \[ns\].
    pub settled_ns: u64,
}

/// Sums up what the process on a seat took from look to look.
#[must_use]
pub fn taken(looks: &[Look], role: Role, seat: u32, window: &Window) -> Taken {
    let [from_ns, to_ns] = window.mono_ns();
    let within: Vec<&Look> =
        looks.iter().filter(|look| (from_ns..to_ns).contains(&look.mono_ns)).collect();
    let of = |look: &Look| look.seen.iter().find(|s| s.role == role && s.seat == seat).cloned();
    let pids = |look: &Look| -> Vec<u32> { look.seen.iter().map(|seen| seen.pid).collect() };
    let mut taken = Taken::default();
    for pair in within.windows(2) {
        let (Some(before), Some(after)) = (of(pair[0]), of(pair[1])) else { continue };
        if before.pid != after.pid {
            taken.moved = taken.moved.and(&after.usage);
            continue;
        }
        let since = after.usage.since(&before.usage);
        if pids(pair[0]) == pids(pair[1]) {
            taken.settled = taken.settled.and(&since);
            taken.settled_ns += pair[1].mono_ns - pair[0].mono_ns;
        } else {
            taken.moved = taken.moved.and(&since);
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;
    use observe::stopwatch::Seen;
    use shared_types::Header;

    const WINDOW: Window = Window { warm_ns: 1000, start_mono_ns: 500, end_ns: 10_000 };

    #[test]
    fn faults_while_a_process_joins_are_counted_apart_and_warm_up_not_at_all() {
        let seen = |role, pid, minor_faults| Seen {
            name: String::new(),
            role,
            seat: 0,
            pid,
            usage: Usage { minor_faults, ..Usage::default() },
        };
        let look = |mono_ns, faults, others: &[u32]| Look {
            mono_ns,
            seen: core::iter::once(seen(Role::Plant, 7, faults))
                .chain(others.iter().map(|pid| seen(Role::Attitude, *pid, 0)))
                .collect(),
        };
        let looks = [
            look(900, 100, &[8]),
            look(1600, 200, &[8]),
            look(2600, 203, &[8]),
            look(3600, 243, &[8, 9]),
            look(4600, 243, &[8, 9]),
        ];
        let taken = taken(&looks, Role::Plant, 0, &WINDOW);
        assert_eq!((taken.settled.minor_faults, taken.moved.minor_faults), (3, 40));
        assert_eq!(taken.settled_ns, 2000);
    }

    #[test]
    fn totals_are_what_was_added_after_the_warm_up() {
        let sample = |release_ns, skipped| LoopStats {
            header: Header { release_ns, seat: Role::Plant.0 + 8, ..Header::default() },
            role: Role::Plant,
            steps: release_ns,
            skipped,
            ..LoopStats::default()
        };
        let samples = vec![sample(0, 5), sample(1000, 9), sample(2000, 9), sample(3000, 10)];
        let mut watch = Stopwatch::default();
        watch.totals = samples;
        let since = totals(&watch, Role::Plant, 1, &WINDOW).unwrap();
        assert_eq!((since.steps, since.skipped), (2000, 1));
        // Killed at 3000, and begun anew; then restarted with its totals.
        let life = |generation, release_ns, steps, skipped| {
            let of = sample(release_ns, skipped);
            LoopStats { steps, header: Header { generation, ..of.header }, ..of }
        };
        watch.totals.extend([life(2, 4000, 50, 3), life(2, 5000, 90, 4), life(3, 6000, 95, 6)]);
        let since = totals(&watch, Role::Plant, 1, &WINDOW).unwrap();
        assert_eq!((since.steps, since.skipped), (2000 + 95, 1 + 6));
        assert!(totals(&watch, Role::Plant, 0, &WINDOW).is_none());
    }
}
