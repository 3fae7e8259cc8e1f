//! Which of several attitude controllers counts as the consumer of the position slot.

use super::watch::Followed;
use slot::{SEATS, Seat};

/// Every attitude controller that runs consumes set points, also one that shadows, and reports which seat it follows;
/// the one that the plant follows decides. It may have reported before the plant has come to follow it, so the last
/// report of each is kept.
#[derive(Debug, Default)]
pub(super) struct Consumers {
    last: [Option<Followed>; SEATS],
    flying: Option<u32>,
    /// Since when the plant has followed that one \[ns\].
    since_ns: u64,
    claim: Option<Claim>,
}

/// What an attitude controller that is watched says against the position slot's owner, which would cost that its slot:
/// the monitor has until `due_ns` to find that it is not so.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Claim {
    by_seat: u32,
    followed: Followed,
    due_ns: u64,
}

impl Consumers {
    /// Seat of the attitude controller that the plant follows; `None` until the plant has reported.
    pub(super) fn flying(&self) -> Option<u32> {
        self.flying
    }

    /// Keeps the report of the attitude controller on a seat. What the one that flies has reported before counts from
    /// when it has flown, whichever of the two samples came first.
    pub(super) fn take(&mut self, by_seat: u32, followed: Followed) -> Followed {
        if let Some(seat) = Seat::new(by_seat) {
            self.last[seat.index()] = Some(followed);
        }
        Followed { at_ns: followed.at_ns.max(self.since_ns), ..followed }
    }

    /// Keeps back what the watched controller on a seat says against the owner that it is to follow, until `due_ns`; the
    /// rest of its report is returned. A claim that is no longer made is dropped.
    pub(super) fn keep_claim(&mut self, by_seat: u32, followed: Followed, due_ns: u64) -> Followed {
        let is_claim = followed.failed_over || followed.tripped;
        self.claim = is_claim.then_some(Claim { by_seat, followed, due_ns });
        Followed { failed_over: false, tripped: false, ..followed }
    }

    /// What has been kept back and is due, once.
    pub(super) fn take_due(&mut self, until_ns: u64) -> Option<(u32, Followed)> {
        let claim = self.claim.take_if(|claim| claim.due_ns <= until_ns)?;
        Some((claim.by_seat, claim.followed))
    }

    /// Takes which controller the plant follows. If it is another one than before, its last report counts from now.
    pub(super) fn take_plant(&mut self, followed: &Followed) -> Option<Followed> {
        if self.flying.replace(followed.seat) == Some(followed.seat) {
            return None;
        }
        self.since_ns = followed.at_ns;
        let last = self.last[Seat::new(followed.seat)?.index()]?;
        Some(Followed { at_ns: last.at_ns.max(followed.at_ns), ..last })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn follows(seat: u32, at_ns: u64) -> Followed {
        Followed { at_ns, epoch: 1, seat, ..Followed::default() }
    }

    #[test]
    fn the_last_command_of_a_controller_counts_from_when_the_plant_follows_it() {
        let mut consumers = Consumers::default();
        consumers.take(1, Followed { tripped: true, ..follows(3, 20) });
        assert_eq!(consumers.take_plant(&follows(0, 10)), None, "it has reported nothing");
        assert_eq!(consumers.flying(), Some(0));
        assert_eq!(consumers.take_plant(&follows(0, 30)), None);
        let kept = consumers.take_plant(&follows(1, 40));
        assert_eq!(kept, Some(Followed { tripped: true, ..follows(3, 40) }));
        assert_eq!(consumers.take_plant(&follows(1, 50)), None, "once");
        consumers.take(0, follows(2, 60));
        assert_eq!(consumers.take_plant(&follows(0, 50)), Some(follows(2, 60)));
        assert_eq!(consumers.take_plant(&follows(9, 70)), None, "of a seat that there is not");
    }

    #[test]
    fn a_claim_is_due_if_it_is_still_made_then() {
        let mut consumers = Consumers::default();
        let claims = Followed { failed_over: true, ..follows(3, 20) };
        assert_eq!(consumers.keep_claim(1, claims, 70), follows(3, 20));
        assert_eq!(consumers.take_due(69), None);
        assert_eq!(consumers.take_due(70), Some((1, claims)));
        assert_eq!(consumers.take_due(71), None, "once");
        let _ = consumers.keep_claim(1, claims, 70);
        assert_eq!(consumers.keep_claim(1, follows(3, 30), 80), follows(3, 30));
        assert_eq!(consumers.take_due(90), None, "taken back");
    }

    #[test]
    fn it_does_not_matter_which_of_the_two_is_received_first() {
        let tripped = Followed { tripped: true, ..follows(3, 20) };
        let (mut before, mut after) = (Consumers::default(), Consumers::default());
        let _ = before.take(1, tripped);
        let kept = before.take_plant(&follows(1, 40));
        assert_eq!(after.take_plant(&follows(1, 40)), None);
        assert_eq!(kept, Some(after.take(1, tripped)));
    }
}
