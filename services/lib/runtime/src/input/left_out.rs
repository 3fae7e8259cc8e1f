//! Samples that came too late to be followed: the record that ends their seat came late, and so did they.

use crate::ownership::SlotBook;
use shared_types::{Header, SEATS};

/// Samples of one process that came after the step that they were due at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LateRange {
    pub(crate) generation: u32,
    /// Sequence.
    pub(crate) first: u64,
    /// Sequence.
    pub(crate) last: u64,
    /// When the first of them should have been in effect \[ns\].
    pub(crate) due_ns: u64,
}

/// What an input of a slot leaves out at a step though it would have counted at its own: a replay, which has each sample
/// at its step unless it is reported as late, would follow it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LeftOut {
    /// What was known of the slot's owners before the last news, and the last step that went by it \[ns\].
    superseded: Option<(SlotBook, u64)>,
    /// By seat, of the present step.
    ranges: [Option<LateRange>; SEATS],
}

impl LeftOut {
    /// Takes in what was known until the step at an instant, now that there is news.
    pub(super) fn supersede(&mut self, book: Option<&SlotBook>, previous_ns: Option<u64>) {
        self.superseded = book.copied().zip(previous_ns);
    }

    pub(super) fn begin_step(&mut self) {
        self.ranges = [None; SEATS];
    }

    /// Takes note of a sample that does not count any more, and returns true, if it would have counted at its step;
    /// `in_effect` is true if it was due by the step at an instant.
    pub(super) fn note(&mut self, header: &Header, in_effect: impl Fn(u64) -> bool) -> bool {
        let Header { seat, generation, sequence, valid_ns: due_ns, .. } = *header;
        let counted =
            |(book, until_ns): (SlotBook, u64)| in_effect(until_ns) && book.counts(seat, due_ns);
        let range = usize::try_from(seat).ok().and_then(|index| self.ranges.get_mut(index));
        let Some(range) = range.filter(|_| self.superseded.is_some_and(counted)) else {
            return false;
        };
        let new = LateRange { generation, first: sequence, last: sequence, due_ns };
        match range.as_mut().filter(|range| range.generation == generation) {
            Some(range) => range.last = sequence,
            None => *range = Some(new),
        }
        true
    }

    pub(super) fn ranges(&self) -> [Option<LateRange>; SEATS] {
        self.ranges
    }
}
