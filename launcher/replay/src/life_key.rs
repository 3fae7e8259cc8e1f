//! What distinguishes the processes that have filled a role.

use runtime::seat_of_loop;
use shared_types::Header;

/// One life of a process: its seat, and how many had the seat before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct LifeKey {
    pub(super) seat: u32,
    pub(super) generation: u32,
}

impl LifeKey {
    /// Of the process that wrote a sample or a state.
    pub(super) fn of(header: &Header) -> Self {
        Self { seat: header.seat, generation: header.generation }
    }

    /// Of the loop that reported a deviation.
    pub(super) fn of_deviation(header: &Header) -> Self {
        Self { seat: seat_of_loop(header.seat), generation: header.generation }
    }

    /// Of the loop that published totals.
    pub(super) fn of_stats(header: &Header) -> Self {
        Self::of_deviation(header)
    }
}
