//! Samples that came too late to be followed: the record that ends their seat came late, and so did they.

use crate::ownership::SlotBook;
use shared_types::{Header, SEATS};

/// How many changes of what is known of a slot's owners a sample may be late by.
const CHANGES: usize = 4;

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
    /// What was known of the slot's owners before the last news, the oldest first, and the last step that went by it
    /// \[ns\].
    superseded: [Option<(SlotBook, u64)>; CHANGES],
    /// By seat, of the present step.
    ranges: [Option<LateRange>; SEATS],
}

impl LeftOut {
    /// Takes in what was known until the step at an instant, now that there is news.
    pub(super) fn supersede(&mut self, book: Option<&SlotBook>, previous_ns: Option<u64>) {
        if let Some(known) = book.copied().zip(previous_ns) {
            self.superseded.rotate_left(1);
            self.superseded[CHANGES - 1] = Some(known);
        }
    }

    pub(super) fn begin_step(&mut self) {
        self.ranges = [None; SEATS];
    }

    /// Takes note of a sample that does not count any more, and returns true, if it would have counted at its step;
    /// `in_effect` is true if it was due by the step at an instant.
    pub(super) fn note(&mut self, header: &Header, in_effect: impl Fn(u64) -> bool) -> bool {
        let Header { seat, generation, sequence, valid_ns: due_ns, .. } = *header;
        // The oldest that was still known at the sample's own step.
        let mut known = self.superseded.iter().flatten();
        let at_its_step = known.find(|(_, until_ns)| in_effect(*until_ns));
        let counted = at_its_step.is_some_and(|(book, _)| book.counts(seat, due_ns));
        let range = usize::try_from(seat).ok().and_then(|index| self.ranges.get_mut(index));
        let Some(range) = range.filter(|_| counted) else {
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
