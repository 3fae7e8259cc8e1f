//! Owner records as an input: which seat may command at an instant.

use super::Input;
use shared_types::OwnerRecord;
use slot::{Authority, Record, Seat};

impl Input<OwnerRecord> {
    /// The record in effect at `t_ns`, an instant since the last step.
    #[must_use]
    pub fn in_effect_at(&self, t_ns: u64) -> Option<&OwnerRecord> {
        let fresh = self.fresh().iter().rev().find(|record| record.header.valid_ns <= t_ns);
        fresh.or_else(|| self.before_fresh())
    }

    /// Authority of the writer of a command at the command's effective instant; in a slot without a
    /// record no command counts.
    #[must_use]
    pub fn authority_of(&self, command: &shared_types::Header) -> Authority {
        let record = self.in_effect_at(command.valid_ns).and_then(Record::read);
        let seat = Seat::new(command.seat);
        record.zip(seat).map_or(Authority::Stray, |(record, seat)| record.authority(seat))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ownership::tests::record;
    use shared_types::Header;

    #[test]
    fn a_seat_without_a_process_has_no_authority_although_the_record_names_it() {
        let mut records = Input::<OwnerRecord>::default();
        records.offer(OwnerRecord { period_ns: [0, 10, 10, 0], ..record(1, 0, 0, 1) });
        records.accept(0, None);
        let of = |seat| records.authority_of(&Header { seat, ..Header::default() });
        let expected = [Authority::Stray, Authority::Fallback, Authority::Member, Authority::Stray];
        assert_eq!([0, 1, 2, 3].map(of), expected);
        assert_eq!(of(9), Authority::Stray, "of a seat that there is not");
    }
}
