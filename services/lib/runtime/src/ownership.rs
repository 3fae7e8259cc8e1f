//! Which seat counts: a slot's owner from instant to instant.
//!
//! A slot's consumers wait for the seats that may command at an instant, owner and fallback, and
//! never for a shadow. Ownership changes at an effective instant T: what takes effect before T comes
//! from the old owner, what takes effect from T on from the new one.

use shared_types::{NO_SEAT, OwnerRecord, SEATS};

/// Announced changes of a slot that can lie ahead.
const MAX_TENURES: usize = 8;

/// The seats that command a slot from an instant on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Tenure {
    from_ns: u64,
    epoch: u64,
    owner: u32,
    fallback: u32,
    /// Which seats are taken.
    members: [bool; SEATS],
}

/// The tenures of one slot: the one in effect and those announced.
#[derive(Debug, Clone, Copy, Default)]
pub struct SlotBook {
    tenures: [Tenure; MAX_TENURES],
    count: usize,
}

impl SlotBook {
    /// Takes in a record; one of an epoch that is known already has no effect.
    pub fn learn(&mut self, record: &OwnerRecord) {
        let known = self.tenures().last().map_or(0, |last| last.epoch);
        if record.epoch <= known {
            return;
        }
        if self.count == MAX_TENURES {
            self.tenures.copy_within(1.., 0);
            self.count -= 1;
        }
        self.tenures[self.count] = Tenure {
            from_ns: record.header.valid_ns,
            epoch: record.epoch,
            owner: record.owner,
            fallback: record.fallback,
            members: core::array::from_fn(|seat| record.period_ns[seat] > 0),
        };
        self.count += 1;
    }

    fn tenures(&self) -> &[Tenure] {
        &self.tenures[..self.count]
    }

    /// Forgets what ended before the step at `t_ns`, which has been run.
    pub fn forget_before(&mut self, t_ns: u64) {
        let over = self.tenures().iter().skip(1).take_while(|next| next.from_ns < t_ns).count();
        self.tenures.copy_within(over.., 0);
        self.count -= over;
    }

    /// True if `seat` may command, now or at an announced instant.
    #[must_use]
    pub fn concerns(&self, seat: u32) -> bool {
        self.count == 0 && seat == 0
            || self.tenures().iter().any(|t| t.owner == seat || t.fallback == seat)
    }

    /// True if what `seat` publishes for the instant `t_ns` can be followed: then, and only then, has it been
    /// waited for.
    #[must_use]
    pub fn counts(&self, seat: u32, t_ns: u64) -> bool {
        let in_effect = self.tenures().iter().rev().find(|tenure| tenure.from_ns <= t_ns);
        in_effect
            .or(self.tenures().first())
            .is_none_or(|tenure| tenure.owner == seat || tenure.fallback == seat)
    }

    /// Instant from which `seat` is no longer taken; none if that has not been announced \[ns\].
    #[must_use]
    pub fn released_ns(&self, seat: u32) -> Option<u64> {
        let last = self.tenures().last()?;
        let index = usize::try_from(seat).ok()?;
        (!last.members.get(index).copied().unwrap_or(false)).then_some(last.from_ns)
    }

    /// True if `seat` is taken at `t_ns` or later, as far as any record states.
    pub(crate) fn is_taken_from(&self, seat: u32, t_ns: u64) -> bool {
        let index = usize::try_from(seat).unwrap_or(SEATS);
        let over = self.tenures().iter().skip(1).take_while(|next| next.from_ns <= t_ns).count();
        let mut current = self.tenures().iter().skip(over);
        self.count == 0 || current.any(|tenure| tenure.members.get(index).copied().unwrap_or(false))
    }

    /// Mark of the slot for an arrow of this latency \[ns\].
    pub(crate) fn mark_ns(&self, seats: &[u64; SEATS], latency_ns: u64) -> u64 {
        let mark_of = |seat: u32| {
            let index = usize::try_from(seat).ok().filter(|_| seat != NO_SEAT);
            index.and_then(|index| seats.get(index)).copied().unwrap_or(u64::MAX)
        };
        if self.count == 0 {
            return mark_of(0);
        }
        // First release whose sample takes effect in the tenure; the first tenure has all before it.
        let mut begin_ns = 0;
        for (index, tenure) in self.tenures().iter().enumerate() {
            let mark_ns = mark_of(tenure.owner).min(mark_of(tenure.fallback));
            let next = self.tenures().get(index + 1);
            let end_ns = next.map_or(u64::MAX, |next| next.from_ns.saturating_sub(latency_ns));
            if mark_ns < end_ns {
                return mark_ns.max(begin_ns);
            }
            begin_ns = end_ns;
        }
        u64::MAX
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use shared_types::Header;

    pub(crate) const MS: u64 = 1_000_000;

    pub(crate) fn record(epoch: u64, valid_ms: u64, owner: u32, fallback: u32) -> OwnerRecord {
        let header = Header { valid_ns: valid_ms * MS, ..Header::default() };
        OwnerRecord { header, epoch, owner, fallback, period_ns: [10; 4], ..OwnerRecord::default() }
    }

    #[test]
    fn what_is_over_is_forgotten_once_a_step_has_passed_it() {
        let mut book = SlotBook::default();
        for (epoch, valid_ms, owner) in [(1, 0, 0), (2, 100, 1), (3, 200, 2)] {
            book.learn(&record(epoch, valid_ms, owner, NO_SEAT));
        }
        book.learn(&record(2, 500, 3, NO_SEAT));
        assert!(!book.concerns(3), "an old epoch says nothing");
        book.forget_before(100 * MS);
        assert!(book.concerns(0), "the step at the change itself still takes from both");
        book.forget_before(100 * MS + 1);
        assert!(!book.concerns(0) && book.concerns(1) && book.concerns(2));
        book.forget_before(900 * MS);
        assert!(!book.concerns(1) && book.concerns(2));
    }

    #[test]
    fn a_seat_counts_for_the_instants_of_its_tenure_and_as_a_fallback() {
        let mut book = SlotBook::default();
        assert!(book.counts(3, 0), "without a record every seat does");
        book.learn(&record(1, 0, 0, NO_SEAT));
        book.learn(&record(2, 100, 1, 0));
        for (seat, at_ms, counts) in
            [(0, 99, true), (1, 99, false), (1, 100, true), (0, 100, true), (2, 100, false)]
        {
            assert_eq!(book.counts(seat, at_ms * MS), counts, "{seat} at {at_ms}");
        }
    }

    #[test]
    fn a_seat_that_a_record_leaves_out_is_released_from_then_on() {
        let mut book = SlotBook::default();
        book.learn(&record(1, 0, 0, NO_SEAT));
        assert_eq!(book.released_ns(1), None);
        let without = OwnerRecord { period_ns: [10, 0, 10, 10], ..record(2, 300, 0, NO_SEAT) };
        book.learn(&without);
        assert_eq!(book.released_ns(1), Some(300 * MS));
        assert_eq!(book.released_ns(0), None);
    }
}
