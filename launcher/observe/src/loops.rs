//! What every loop counted, whichever process ran it.
//!
//! A process that is started again goes on with the totals of the one before, as its state has them; one
//! that takes the seat in flight begins at zero. So the totals of a seat are those of the last life of each
//! of its tenants, and what a tenant counted is not forgotten when another follows it.

use runtime::seat_of_loop;
use shared_types::{Header, LoopStats, Role, Seating, SeatingKind};
use std::collections::{BTreeMap, BTreeSet};

/// Role and seat.
type Place = (u32, u32);

/// Last totals of every life of every loop.
#[derive(Debug, Clone, Default)]
pub struct LoopLedger {
    lives: BTreeMap<(Place, u32), LoopStats>,
    /// Lives that began with totals of their own.
    tenants: BTreeSet<(Place, u32)>,
    /// Those of them that go on from what their seat had, where one before them died.
    restarted: BTreeSet<(Place, u32)>,
}

impl LoopLedger {
    /// Takes a loop's totals.
    pub fn observe(&mut self, stats: &LoopStats) {
        let Header { seat, generation, .. } = stats.header;
        self.lives.insert(((stats.role.0, seat_of_loop(seat)), generation), *stats);
    }

    /// Takes note of a process that begins in flight.
    pub fn seated(&mut self, seating: &Seating) {
        if seating.kind != SeatingKind::Joined {
            return;
        }
        let life = ((seating.role.0, seating.seat), seating.generation);
        let has_state = seating.has_state.is_set();
        if seating.join_ns > 0 || !has_state {
            self.tenants.insert(life);
        }
        if has_state && seating.state_seat == seating.seat {
            self.restarted.insert(life);
        }
    }

    /// Totals of each seat, all its tenants together; what it counts as `generation` are restarts alone.
    #[must_use]
    pub fn seats(&self) -> Vec<LoopStats> {
        let mut seats: BTreeMap<Place, LoopStats> = BTreeMap::new();
        let mut lives = self.lives.iter().peekable();
        while let Some(((place, _), stats)) = lives.next() {
            let next = lives.peek().map(|(life, _)| **life).filter(|(of, _)| of == place);
            let goes_on = next.is_some_and(|next| !self.tenants.contains(&next));
            let is_restart = next.is_some_and(|next| self.restarted.contains(&next));
            let all = seats.entry(*place).or_default();
            all.generation += u64::from(goes_on || is_restart);
            if !goes_on {
                *all = sum(all, stats);
            }
        }
        seats.into_values().collect()
    }

    /// Deadlines missed and releases left out by every loop of a role.
    #[must_use]
    pub fn missed(&self, role: Role) -> u64 {
        let seats = self.seats().into_iter().filter(|stats| stats.role == role);
        seats.fold(0, |all, stats| all.saturating_add(missed(&stats)))
    }
}

/// Releases that a loop left out, and steps that it made without its inputs.
#[must_use]
pub fn missed(stats: &LoopStats) -> u64 {
    stats.skipped.saturating_add(stats.input_deadline_misses)
}

/// What all loops together counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Totals {
    /// Releases left out, and steps without final inputs.
    pub missed: u64,
    /// Samples that came after the step they were for.
    pub late: u64,
    /// Samples that a loop never saw, most of them while it was being restarted.
    pub unseen: u64,
    /// Processes that were started again.
    pub restarts: u64,
}

impl Totals {
    /// Of the loops of a flight.
    #[must_use]
    pub fn of(loops: &[LoopStats]) -> Self {
        loops.iter().fold(Self::default(), |all, stats| Self {
            missed: all.missed.saturating_add(missed(stats)),
            late: all.late.saturating_add(stats.late_samples),
            unseen: all.unseen.saturating_add(stats.lost_samples),
            restarts: all.restarts.saturating_add(stats.generation),
        })
    }
}

/// Of a seat's totals, as orders and replays name it.
#[must_use]
pub fn seat_name(stats: &LoopStats) -> String {
    let label = stats.role.label();
    match seat_of_loop(stats.header.seat) {
        0 => label.to_owned(),
        seat => format!("{label}@{seat}"),
    }
}

/// Totals of `past` tenants of a seat and of the one after them.
#[must_use]
pub fn sum(past: &LoopStats, next: &LoopStats) -> LoopStats {
    LoopStats {
        steps: past.steps.saturating_add(next.steps),
        skipped: past.skipped.saturating_add(next.skipped),
        caught_up: past.caught_up.saturating_add(next.caught_up),
        input_deadline_misses: past
            .input_deadline_misses
            .saturating_add(next.input_deadline_misses),
        late_samples: past.late_samples.saturating_add(next.late_samples),
        lost_samples: past.lost_samples.saturating_add(next.lost_samples),
        rescued_waits: past.rescued_waits.saturating_add(next.rescued_waits),
        allocations: past.allocations.saturating_add(next.allocations),
        transport_allocations: past
            .transport_allocations
            .saturating_add(next.transport_allocations),
        minor_faults: past.minor_faults.saturating_add(next.minor_faults),
        major_faults: past.major_faults.saturating_add(next.major_faults),
        allocations_at_changes: past
            .allocations_at_changes
            .saturating_add(next.allocations_at_changes),
        faults_at_changes: past.faults_at_changes.saturating_add(next.faults_at_changes),
        generation: past.generation,
        // Which loop it is, and its last totals.
        ..*next
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Flag;

    fn totals(seat: u32, generation: u32, steps: u64) -> LoopStats {
        let header = Header { seat: 8 * seat + Role::Attitude.0, generation, ..Header::default() };
        LoopStats { header, role: Role::Attitude, steps, skipped: 1, ..LoopStats::default() }
    }

    fn seated(seat: u32, generation: u32, join_ns: u64) -> Seating {
        let (role, has_state) = (Role::Attitude, Flag::Yes);
        Seating { role, seat, generation, join_ns, has_state, ..Seating::default() }
    }

    #[test]
    fn totals_end_at_the_largest_number() {
        let mut ledger = LoopLedger::default();
        for generation in [0, 1] {
            let input_deadline_misses = u64::MAX;
            ledger.observe(&LoopStats { input_deadline_misses, ..totals(0, generation, u64::MAX) });
            ledger.seated(&seated(0, generation, 9));
        }
        assert_eq!(ledger.missed(Role::Attitude), u64::MAX);
        assert_eq!(Totals::of(&ledger.seats()).missed, u64::MAX);
    }

    #[test]
    fn a_process_started_again_goes_on_and_one_that_takes_the_seat_adds() {
        let mut ledger = LoopLedger::default();
        for (seat, generation, steps) in [(0, 0, 10), (0, 0, 20), (1, 0, 5), (0, 1, 30)] {
            ledger.observe(&totals(seat, generation, steps));
        }
        // The sample that distinguishes a tenant from a restart may come after its first totals.
        ledger.observe(&totals(1, 1, 7));
        ledger.observe(&totals(1, 0, 6));
        ledger.seated(&seated(1, 1, 9));
        ledger.seated(&seated(0, 1, 0));
        // Another one is started again and joins, from the state of its own seat.
        ledger.observe(&totals(1, 2, 1));
        ledger.seated(&Seating { state_seat: 1, ..seated(1, 2, 20) });
        let seats = ledger.seats();
        let names: Vec<_> = seats.iter().map(seat_name).collect();
        assert_eq!(names, ["attitude", "attitude@1"]);
        let totals: Vec<_> = seats.iter().map(|s| (s.steps, s.skipped, s.generation)).collect();
        assert_eq!(totals, [(30, 1, 1), (14, 3, 1)]);
        let missed = [Role::Attitude, Role::Position].map(|role| ledger.missed(role));
        assert_eq!(missed, [4, 0]);
    }
}
