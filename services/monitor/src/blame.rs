//! Which of the two slots' owners answers for a finding.

use crate::finding::Finding;
use crate::judge::Findings;

/// The owner of a slot that is to be judged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Watched {
    pub(crate) epoch: u64,
    pub(crate) instance: u32,
    /// Seat of its fallback, `NO_SEAT` for none.
    pub(crate) fallback: u32,
}

/// What commands a slot.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Hands {
    /// An owner that has not proven itself.
    Watched(Watched),
    /// An owner that has.
    Proven,
    /// The fallback, in place of an owner that has tripped or failed.
    Replaced,
}

/// Assigns the findings to the watched owners. If the other slot's owner has proven itself, the watched one is blamed for
/// all of them. A slot whose owner was replaced has been to blame already: the other one answers for its own only.
pub(crate) fn blame(findings: Findings, hands: &[Hands; 2]) -> [Option<Finding>; 2] {
    let Findings { attitude, position, asked, commanded } = findings;
    match hands {
        [Hands::Watched(_), Hands::Watched(_)] => [attitude.or(commanded), asked.or(position)],
        [Hands::Watched(_), Hands::Proven] => [attitude.or(commanded).or(position), None],
        [Hands::Watched(_), Hands::Replaced] => [attitude.or(commanded), None],
        [Hands::Proven, Hands::Watched(_)] => [None, asked.or(position).or(attitude)],
        [Hands::Replaced, Hands::Watched(_)] => [None, asked.or(position)],
        _ => [None, None],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{NO_SEAT, TripCause};

    fn found(cause: TripCause) -> Finding {
        Finding::of(cause, 1.0, 0.5)
    }

    #[test]
    fn the_watched_owner_answers_for_a_proven_one_and_never_for_one_that_was_replaced() {
        let watched = Hands::Watched(Watched { epoch: 1, instance: 0, fallback: NO_SEAT });
        let (turns, leaves) = (TripCause::AttitudeDeparts, TripCause::PositionDeparts);
        let none = Findings::default();
        let both = Findings { attitude: Some(found(turns)), position: Some(found(leaves)), ..none };
        let of_position = Findings { position: Some(found(leaves)), ..none };
        let of_attitude = Findings { attitude: Some(found(turns)), ..none };
        let climbs = TripCause::ThrustBeyond;
        let of_asked = Findings { asked: Some(found(climbs)), ..none };
        let causes = |findings: Findings, hands: [Hands; 2]| {
            blame(findings, &hands).map(|finding| finding.map(|finding| finding.cause))
        };
        assert_eq!(causes(both, [watched; 2]), [Some(turns), Some(leaves)]);
        assert_eq!(causes(of_position, [watched, Hands::Proven]), [Some(leaves), None]);
        assert_eq!(causes(of_attitude, [Hands::Proven, watched]), [None, Some(turns)]);
        assert_eq!(causes(of_position, [watched, Hands::Replaced]), [None; 2]);
        assert_eq!(causes(of_asked, [Hands::Proven, watched]), [None, Some(climbs)]);
        assert_eq!(causes(of_asked, [watched, Hands::Proven]), [None; 2], "its own alone");
        assert_eq!(causes(of_attitude, [Hands::Replaced, watched]), [None; 2]);
        assert_eq!(causes(both, [watched, Hands::Replaced]), [Some(turns), None]);
        assert_eq!(causes(both, [Hands::Replaced, watched]), [None, Some(leaves)]);
        assert_eq!(causes(both, [Hands::Proven, Hands::Replaced]), [None; 2]);
        let pushes = TripCause::TurnsBeyond;
        let of_commanded = Findings { commanded: Some(found(pushes)), ..none };
        assert_eq!(causes(of_commanded, [watched, Hands::Proven]), [Some(pushes), None]);
        assert_eq!(causes(of_commanded, [watched; 2]), [Some(pushes), None]);
        assert_eq!(causes(of_commanded, [watched, Hands::Replaced]), [Some(pushes), None]);
        assert_eq!(causes(of_commanded, [Hands::Proven, watched]), [None; 2], "its own alone");
    }
}
