//! Which processes are to blame for a flight that stands still.

use runtime::clock::WallMap;
use runtime::{Graph, MarkView as _, SeatMarks};
use shared_types::{ClockMode, ClockRecord, RegistryEntry, Role, Seat};

/// How long loops may stand still, and what time it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct StallCheck {
    pub(super) now_mono_ns: u64,
    pub(super) stall_ns: u64,
    pub(super) lag_ns: u64,
}

/// Processes to blame for standing still. Lockstep, once none has moved for long enough: those that have
/// permission to step. Realtime: those that lag behind the plant by more than `lag_ns`, or the plant, if it
/// lags behind the wall clock by more than `stall_ns`; a machine that stalls as a whole stalls all of them,
/// and only the longer timeout applies. Once the plant has finished it cannot run ahead of a loop that
/// stands still just before the end: the wall clock does.
pub(super) fn stalled(
    record: &ClockRecord,
    graph: &Graph,
    present: &[RegistryEntry],
    marks: &SeatMarks,
    check: StallCheck,
) -> Vec<RegistryEntry> {
    let wall_ns = WallMap::new(record).logical_ns(check.now_mono_ns);
    let plant_ns = match marks.of_role(Role::Plant) {
        mark_ns if mark_ns < record.end_ns => mark_ns,
        _ => wall_ns.max(record.end_ns),
    };
    let long_over = record.end_ns.saturating_add(check.stall_ns) < wall_ns;
    let is_stalled = |entry: &&RegistryEntry| {
        let Some(node) = graph.node(entry.role) else { return false };
        let mark_ns = marks.of_seat(seat_of(entry), entry.generation);
        // A process that has just taken a seat in flight has not received its first samples yet.
        let arrives = mark_ns == 0 && has_joined_in_flight(entry) && !long_over;
        if mark_ns >= record.end_ns || (arrives && record.mode != ClockMode::Lockstep) {
            false
        } else if record.mode == ClockMode::Lockstep {
            graph.runnable(node, mark_ns, marks, record.allowed_ns)
        } else if node.role == Role::Plant {
            mark_ns.saturating_add(check.stall_ns) < wall_ns
        } else {
            mark_ns.saturating_add(check.lag_ns) < plant_ns
        }
    };
    present.iter().filter(is_stalled).copied().collect()
}

/// Where the processes that have joined a lockstep flight began. A process that stands still does not repeat its mark
/// for a reader that has just come, so that a newcomer may wait for it although the mark permits its first step.
#[derive(Debug, Default)]
pub(super) struct Newcomers(Vec<Newcomer>);

#[derive(Debug)]
struct Newcomer {
    seat: Seat,
    generation: u32,
    begun_ns: u64,
}

impl Newcomer {
    fn is(&self, entry: &RegistryEntry) -> bool {
        self.seat == seat_of(entry) && self.generation == entry.generation
    }
}

impl Newcomers {
    /// Notes the first mark of whatever has joined.
    pub(super) fn look(&mut self, present: &[RegistryEntry], marks: &SeatMarks) {
        self.0.retain(|known| present.iter().any(|entry| known.is(entry)));
        for entry in present.iter().filter(|entry| has_joined_in_flight(entry)) {
            let (seat, generation) = (seat_of(entry), entry.generation);
            let begun_ns = marks.of_seat(seat, generation);
            if begun_ns > 0 && !self.0.iter().any(|known| known.is(entry)) {
                self.0.push(Newcomer { seat, generation, begun_ns });
            }
        }
    }

    /// Those of the processes that stand still that are to blame: newcomers only if there are no others.
    pub(super) fn excuse(
        &self,
        stalled: Vec<RegistryEntry>,
        marks: &SeatMarks,
    ) -> Vec<RegistryEntry> {
        let is_new = |entry: &RegistryEntry| {
            let mark_ns = marks.of_seat(seat_of(entry), entry.generation);
            let known = self.0.iter().find(|known| known.is(entry));
            has_joined_in_flight(entry) && known.is_none_or(|known| known.begun_ns == mark_ns)
        };
        let (new, others): (Vec<_>, Vec<_>) = stalled.into_iter().partition(is_new);
        if others.is_empty() { new } else { others }
    }
}

fn seat_of(entry: &RegistryEntry) -> Seat {
    Seat { role: entry.role, index: entry.seat }
}

fn has_joined_in_flight(entry: &RegistryEntry) -> bool {
    entry.seat > 0 || entry.generation > 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::Scenario;
    use shared_types::Flag;

    const MS: u64 = 1_000_000;

    /// Roles blamed for standing still `now_ms` after the beginning of a flight of `end_ms`.
    fn blamed(end_ms: u64, generation: u32, marks_ms: &[(Role, u64)], now_ms: u64) -> Vec<Role> {
        let scenario = Scenario::load("hover", &[]).expect("a shipped scenario");
        let graph = scenario.graph().expect("wired");
        let record = ClockRecord {
            end_ns: end_ms * MS,
            speed: 1.0,
            mode: ClockMode::Realtime,
            started: Flag::Yes,
            ..ClockRecord::default()
        };
        let entry = |&(role, _): &(Role, u64)| {
            let generation = if role == Role::Plant { 0 } else { generation };
            RegistryEntry { role, generation, present: Flag::Yes, ..RegistryEntry::default() }
        };
        let present: Vec<RegistryEntry> = marks_ms.iter().map(entry).collect();
        let mut marks = SeatMarks::default();
        for (entry, (role, mark_ms)) in present.iter().zip(marks_ms) {
            marks.advance(*role, 0, entry.generation, mark_ms.saturating_mul(MS));
        }
        let check = StallCheck { now_mono_ns: now_ms * MS, stall_ns: 2000 * MS, lag_ns: 300 * MS };
        stalled(&record, &graph, &present, &marks, check).iter().map(|e| e.role).collect()
    }

    #[test]
    fn a_loop_that_hangs_just_before_the_end_is_blamed_once_the_wall_clock_is_ahead() {
        let blamed = |mark_ms, now_ms| {
            blamed(3000, 0, &[(Role::Plant, u64::MAX), (Role::Position, mark_ms)], now_ms)
        };
        // It has as long as in the middle of the flight.
        assert_eq!(blamed(2940, 3200), []);
        assert_eq!(blamed(2940, 3241), [Role::Position]);
        assert_eq!(blamed(3000, 9000), [], "it has finished");
    }

    #[test]
    fn a_loop_is_blamed_by_the_plant_and_not_by_the_clock_while_the_plant_is_late() {
        let of =
            |plant_ms| blamed(3000, 0, &[(Role::Plant, plant_ms), (Role::Position, 1000)], 2500);
        assert_eq!(of(1200), []);
        assert_eq!(of(1400), [Role::Position]);
        assert_eq!(of(400), [Role::Plant], "which has the longer timeout");
    }

    #[test]
    fn a_successor_that_never_publishes_is_blamed_when_the_flight_has_long_been_over() {
        let blamed =
            |now_ms| blamed(3000, 1, &[(Role::Plant, u64::MAX), (Role::Position, 0)], now_ms);
        assert_eq!(blamed(4900), []);
        assert_eq!(blamed(5100), [Role::Position]);
    }

    /// Roles to blame of which all stand still: each has begun at an instant and has come to another \[ms\].
    fn to_blame(of_ms: &[(Role, u32, u64, u64)]) -> Vec<(Role, u32)> {
        let entry = |&(role, generation, ..): &(Role, u32, u64, u64)| RegistryEntry {
            role,
            generation,
            present: Flag::Yes,
            ..RegistryEntry::default()
        };
        let present: Vec<RegistryEntry> = of_ms.iter().map(entry).collect();
        let (mut marks, mut newcomers) = (SeatMarks::default(), Newcomers::default());
        for (role, generation, begun_ms, _) in of_ms {
            marks.advance(*role, 0, *generation, begun_ms * MS);
        }
        newcomers.look(&present, &marks);
        for (role, generation, _, mark_ms) in of_ms {
            marks.advance(*role, 0, *generation, mark_ms * MS);
        }
        newcomers.look(&present, &marks);
        newcomers.excuse(present, &marks).iter().map(|e| (e.role, e.generation)).collect()
    }

    #[test]
    fn a_newcomer_is_blamed_only_if_nothing_else_stands_still() {
        let (old, new) = ((Role::Position, 0, 0, 7000), (Role::Attitude, 1, 7000, 7000));
        assert_eq!(to_blame(&[old, new]), [(Role::Position, 0)]);
        assert_eq!(to_blame(&[new]), [(Role::Attitude, 1)]);
        // Before its first samples.
        assert_eq!(to_blame(&[old, (Role::Attitude, 1, 0, 0)]), [(Role::Position, 0)]);
        // Once it has gone on it has received what it waited for.
        let moved = (Role::Attitude, 1, 7000, 7010);
        assert_eq!(to_blame(&[old, moved]), [(Role::Position, 0), (Role::Attitude, 1)]);
    }
}
