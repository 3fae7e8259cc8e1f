//! Which of several attitude controllers tells whom the consumer of the position slot follows.

use super::watch::Followed;
use slot::{SEATS, Seat};

/// Every attitude controller that runs consumes set points, also one that shadows, and tells whom it follows; the one
/// that the plant follows decides. It may have told before the plant has come to follow it, so that the last word of
/// each is kept.
#[derive(Debug, Default)]
pub(super) struct Consumers {
    told: [Option<Followed>; SEATS],
    flying: Option<u32>,
    /// Since when the plant has followed that one \[ns\].
    since_ns: u64,
}

impl Consumers {
    /// Seat of the attitude controller that the plant follows; `None` until the plant has told.
    pub(super) fn flying(&self) -> Option<u32> {
        self.flying
    }

    /// Keeps what the attitude controller on a seat tells. What the one that flies has told before counts from when it has
    /// flown, whichever of the two samples came first.
    pub(super) fn tells(&mut self, by_seat: u32, followed: Followed) -> Followed {
        if let Some(seat) = Seat::new(by_seat) {
            self.told[seat.index()] = Some(followed);
        }
        Followed { at_ns: followed.at_ns.max(self.since_ns), ..followed }
    }

    /// The plant tells whom it follows. If that is another one than before, its last word counts from now on.
    pub(super) fn plant_tells(&mut self, followed: &Followed) -> Option<Followed> {
        if self.flying.replace(followed.seat) == Some(followed.seat) {
            return None;
        }
        self.since_ns = followed.at_ns;
        let told = self.told[Seat::new(followed.seat)?.index()]?;
        Some(Followed { at_ns: told.at_ns.max(followed.at_ns), ..told })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn follows(seat: u32, at_ns: u64) -> Followed {
        Followed { at_ns, epoch: 1, seat, ..Followed::default() }
    }

    #[test]
    fn the_last_word_of_a_controller_counts_from_when_the_plant_follows_it() {
        let mut consumers = Consumers::default();
        consumers.tells(1, Followed { tripped: true, ..follows(3, 20) });
        assert_eq!(consumers.plant_tells(&follows(0, 10)), None, "it has told nothing");
        assert_eq!(consumers.flying(), Some(0));
        assert_eq!(consumers.plant_tells(&follows(0, 30)), None);
        let told = consumers.plant_tells(&follows(1, 40));
        assert_eq!(told, Some(Followed { tripped: true, ..follows(3, 40) }));
        assert_eq!(consumers.plant_tells(&follows(1, 50)), None, "once");
        consumers.tells(0, follows(2, 60));
        assert_eq!(consumers.plant_tells(&follows(0, 50)), Some(follows(2, 60)));
        assert_eq!(consumers.plant_tells(&follows(9, 70)), None, "of a seat that there is not");
    }

    #[test]
    fn it_does_not_matter_which_of_the_two_is_heard_first() {
        let tripped = Followed { tripped: true, ..follows(3, 20) };
        let (mut before, mut after) = (Consumers::default(), Consumers::default());
        let _ = before.tells(1, tripped);
        let told = before.plant_tells(&follows(1, 40));
        assert_eq!(after.plant_tells(&follows(1, 40)), None);
        assert_eq!(told, Some(after.tells(1, tripped)));
    }
}
