//! The first part of a published state.

use shared_types::Header;
use shared_types::wire::Value as _;

shared_types::memory! {
    /// First part of a published state: where in the flight it was taken.
    pub struct StateHeader {
        /// Layout of this header, memory, latches and sequences together.
        pub layout_hash: u64,
        /// Index of the release that has just run.
        pub release_index: u64,
        /// Its instant \[ns\].
        pub release_ns: u64,
        /// Steps run so far.
        pub steps: u64,
        /// Releases skipped so far.
        pub skipped: u64,
        /// Releases run late so far.
        pub caught_up: u64,
        /// Steps started without final inputs so far.
        pub input_deadline_misses: u64,
        /// Samples that came after the step they were for so far.
        pub late_samples: u64,
        /// Samples never seen so far.
        pub lost_samples: u64,
        /// Sequence of this state.
        pub state_sequence: u64,
        /// Sequence of the last loop statistics.
        pub stats_sequence: u64,
        /// Sequence of the last deviation that this life of the process has published.
        pub deviation_sequence: u64,
    }
}

impl StateHeader {
    /// The first part of a published state; none of bytes that are too few to be one.
    #[must_use]
    pub fn of(state: &[u8]) -> Option<Self> {
        state.get(..Self::PACKED_SIZE).map(Self::unpack)
    }

    /// True if a published state is one of this layout, so that a process of that layout can go on from it.
    #[must_use]
    pub fn has_layout(state: &[u8], layout_hash: u64) -> bool {
        Self::of(state).is_some_and(|head| head.layout_hash == layout_hash)
    }

    /// True if a published state has the same place in the flight as the header that it was sent with.
    #[must_use]
    pub fn agrees_with(state: &[u8], header: &Header) -> bool {
        Self::of(state).is_some_and(|head| {
            (head.release_ns, head.state_sequence) == (header.release_ns, header.sequence)
        })
    }
}
