//! How far the loops of a flight in one process have got, whichever seat each has.

use runtime::graph::{Edge, Marks};
use runtime::{MarkView, SeatMarks};
use shared_types::{Flag, Handover, RegistryEntry, Role, Seat as Place};

/// How far every loop has got.
#[derive(Debug)]
pub(super) enum FlightMarks {
    /// Of a flight in which every loop keeps its place.
    Plain(Marks),
    /// Of one in which slots change hands.
    Seats(Box<SeatMarks>),
}

impl FlightMarks {
    /// Takes in how far a loop has got.
    #[inline]
    pub(super) fn advance(&mut self, place: Place, generation: u32, mark_ns: u64) {
        match self {
            Self::Plain(marks) => marks[place.role.index()] = mark_ns,
            Self::Seats(marks) => marks.advance(place.role, place.index, generation, mark_ns),
        }
    }

    /// A hand-over, to which the writers that the loop receives from are added.
    pub(super) fn name_writers(&self, order: Handover, state: &[u8]) -> Handover {
        match self {
            Self::Plain(_) => order,
            Self::Seats(marks) => marks.name_writers(order, state),
        }
    }

    /// The loop that sits on a seat has come, or is gone and not waited for.
    pub(super) fn seat(&mut self, place: Place, generation: u32, present: bool) {
        if let Self::Seats(marks) = self {
            marks.learn_registry(&[RegistryEntry {
                role: place.role,
                seat: place.index,
                generation,
                present: Flag::from(present),
                ..RegistryEntry::default()
            }]);
        }
    }
}

impl MarkView for FlightMarks {
    #[inline]
    fn of(&self, edge: &Edge) -> u64 {
        match self {
            Self::Plain(marks) => marks.of(edge),
            Self::Seats(marks) => marks.of(edge),
        }
    }
    #[inline]
    fn of_role(&self, role: Role) -> u64 {
        match self {
            Self::Plain(marks) => marks.of_role(role),
            Self::Seats(marks) => marks.of_role(role),
        }
    }
}
