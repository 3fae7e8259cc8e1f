//! One input of a service: what has arrived, what is in effect, what is new.

use crate::graph::{Edge, READER_CAPACITY, Roles};
use shared_types::wire::Value;
use shared_types::{Header, Sample, Stamped, Topic};
use std::collections::VecDeque;

/// Where samples come from: a shared-memory subscriber, or a queue within one process.
pub trait Source<T> {
    /// The next sample that has arrived, if any. Must not block or allocate.
    fn receive(&mut self) -> Option<Stamped<T>>;
}

/// Age of an input's latest value at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Link<'a, T> {
    /// Nothing has ever been in effect.
    Silent,
    /// In effect since at most the limit.
    Fresh(&'a T),
    /// In effect, but older than the limit.
    Stale {
        /// The last value.
        last: &'a T,
        /// Time since it became effective \[ns\].
        age_ns: u64,
    },
}

/// Counters of one input.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct InputCounts {
    /// Samples that arrived after the step in which they should have taken effect.
    pub late: u64,
    /// Sequence numbers never received.
    pub lost: u64,
    /// Samples dropped because the reader was full.
    pub overflowed: u64,
}

/// One input: the samples accepted but not yet effective, the new ones and the latest.
pub struct Input<T> {
    source: Option<Box<dyn Source<T>>>,
    edge: Option<Edge>,
    pending: VecDeque<Stamped<T>>,
    fresh: Vec<Stamped<T>>,
    before: Option<Stamped<T>>,
    latest: Option<Stamped<T>>,
    counts: InputCounts,
}

impl<T: Sample> core::fmt::Debug for Input<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Input")
            .field("topic", &T::SCHEMA.name)
            .field("pending", &self.pending.len())
            .field("fresh", &self.fresh.len())
            .field("latest", &self.latest)
            .finish_non_exhaustive()
    }
}

impl<T: Sample> Default for Input<T> {
    fn default() -> Self {
        Self {
            source: None,
            edge: None,
            pending: VecDeque::with_capacity(READER_CAPACITY),
            fresh: Vec::with_capacity(READER_CAPACITY),
            before: None,
            latest: None,
            counts: InputCounts::default(),
        }
    }
}

impl<T: Sample> Input<T> {
    /// Connects the input. Without an edge (a topic outside the waiting graph, like owner records)
    /// samples take effect at their instant.
    pub fn connect(&mut self, source: Box<dyn Source<T>>, edge: Option<Edge>) {
        self.source = Some(source);
        self.edge = edge;
    }

    /// Takes everything that has arrived into the pending queue, ordered by (effect, seat,
    /// sequence). A sample that comes again (a restarted producer repeats its last step) replaces
    /// the pending one and is otherwise ignored.
    pub fn receive(&mut self) {
        let Some(mut source) = self.source.take() else { return };
        while let Some(stamped) = source.receive() {
            self.offer(stamped);
        }
        self.source = Some(source);
    }

    /// As [`receive`](Self::receive), but looks only if the producer has moved its mark, or is
    /// outside the waiting graph: what a mark does not cover yet permits no step.
    pub fn receive_if_moved(&mut self, moved: Roles) {
        if self.edge.is_none_or(|edge| moved.contains(edge.from) || !edge.from.is_stepping()) {
            self.receive();
        }
    }

    /// Takes one sample, as if it had arrived.
    pub fn offer(&mut self, stamped: Stamped<T>) {
        let key = order(stamped.sample.header());
        if self.latest.as_ref().is_some_and(|last| {
            let header = last.sample.header();
            header.seat == key.1 && stamped.sample.header().sequence <= header.sequence
        }) {
            return;
        }
        let at = self.pending.partition_point(|p| order(p.sample.header()) < key);
        if let Some(same) = self.pending.get_mut(at).filter(|p| order(p.sample.header()) == key) {
            *same = stamped;
        } else if self.pending.len() < READER_CAPACITY {
            self.pending.insert(at, stamped);
        } else {
            self.counts.overflowed += 1;
        }
    }

    /// Moves what is in effect at `t_ns` into `fresh` and `latest`; `previous_ns` is the instant of
    /// the step before, from which lateness is judged.
    pub fn accept(&mut self, t_ns: u64, previous_ns: Option<u64>) {
        self.fresh.clear();
        let due = |this: &Self| {
            this.pending.front().is_some_and(|s| this.in_effect(s.sample.header().valid_ns, t_ns))
        };
        while due(self) {
            let Some(stamped) = self.pending.pop_front() else { break };
            let header = stamped.sample.header();
            if previous_ns.is_some_and(|p| self.in_effect(header.valid_ns, p)) {
                self.counts.late += 1;
            }
            let last = self.fresh.last().or(self.latest.as_ref()).map(|l| l.sample.header());
            if let Some(last) = last.filter(|last| last.seat == header.seat) {
                self.counts.lost += header.sequence.saturating_sub(last.sequence + 1);
            }
            self.fresh.push(stamped);
        }
        // Samples are large: copied only where something is new.
        if let Some(newest) = self.fresh.last() {
            self.before = self.latest.replace(*newest);
        }
    }

    pub(crate) fn in_effect(&self, valid_ns: u64, t_ns: u64) -> bool {
        self.edge.map_or(valid_ns <= t_ns, |edge| edge.in_effect(valid_ns, t_ns))
    }

    /// Number of samples that have been taken in and are not in effect yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.pending.len()
    }

    /// Samples that took effect since the previous step, in order.
    #[must_use]
    pub fn fresh(&self) -> &[Stamped<T>] {
        &self.fresh
    }

    /// What was in effect before this step's fresh samples.
    #[must_use]
    pub fn before_fresh(&self) -> Option<&Stamped<T>> {
        if self.fresh.is_empty() { self.latest.as_ref() } else { self.before.as_ref() }
    }

    /// The latest sample in effect, with its writer.
    #[must_use]
    pub fn latest(&self) -> Option<&Stamped<T>> {
        self.latest.as_ref()
    }

    /// The latest sample in effect.
    #[must_use]
    pub fn sample(&self) -> Option<&T> {
        self.latest.as_ref().map(|s| &s.sample)
    }

    /// The latest sample, judged by its age.
    #[must_use]
    pub fn link(&self, now_ns: u64, limit_ns: u64) -> Link<'_, T> {
        match self.sample() {
            None => Link::Silent,
            Some(last) => {
                let age_ns = now_ns.saturating_sub(last.header().valid_ns);
                if age_ns <= limit_ns { Link::Fresh(last) } else { Link::Stale { last, age_ns } }
            }
        }
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> InputCounts {
        self.counts
    }

    /// Bytes of the latch in a published state.
    pub const LATCH_SIZE: usize = 8 + 16 + T::PACKED_SIZE;

    /// Writes the latched value into a published state.
    pub fn pack_latch(&self, out: &mut [u8]) {
        let (present, rest) = out.split_at_mut(8);
        u64::from(self.latest.is_some()).pack(present);
        if let Some(latest) = &self.latest {
            let (author, value) = rest.split_at_mut(16);
            latest.author.pack(author);
            latest.sample.pack(value);
        } else {
            rest.fill(0);
        }
    }

    /// Restores the latched value from a published state.
    pub fn unpack_latch(&mut self, from: &[u8]) {
        let (present, rest) = from.split_at(8);
        let (author, value) = rest.split_at(16);
        self.latest = (u64::unpack(present) != 0)
            .then(|| Stamped { sample: T::unpack(value), author: <[u64; 2]>::unpack(author) });
    }
}

/// Order of samples within one input.
fn order(header: &Header) -> (u64, u32, u64) {
    (header.valid_ns, header.seat, header.sequence)
}

/// Does something for every input of a service, with its type.
pub trait InputVisitor {
    /// What can go wrong.
    type Error;
    /// Called once per input, in declaration order.
    ///
    /// # Errors
    /// Whatever the visitor meets; it ends the walk.
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Self::Error>;
}

/// The inputs of a service; declared with [`inputs!`](crate::inputs).
pub trait InputSet: Default {
    /// Bytes of all latches.
    const LATCH_SIZE: usize;
    /// Layout of the latches.
    const LAYOUT_HASH: u64;

    /// Walks the inputs.
    ///
    /// # Errors
    /// The visitor's first error.
    fn visit<V: InputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error>;
    /// Takes what has arrived on every input.
    fn receive(&mut self);
    /// Takes what has arrived on the inputs whose producers are among `moved`, or step unwaited.
    fn receive_if_moved(&mut self, moved: Roles);
    /// Puts into effect what is due on every input.
    fn accept(&mut self, t_ns: u64, previous_ns: Option<u64>);
    /// Sum of all inputs' counters.
    fn counts(&self) -> InputCounts;
    /// Sequence of the IMU sample that the first declared input descends from; 0 if none.
    fn cause_sequence(&self) -> u64;
    /// Writes all latches; `out` holds [`InputSet::LATCH_SIZE`] bytes.
    fn pack_latches(&self, out: &mut [u8]);
    /// Restores all latches.
    fn unpack_latches(&mut self, from: &[u8]);
}

/// Declares a service's inputs: `inputs! { pub struct Inputs { imu: Imu = IMU, .. } }`. The first
/// one is the cause of the service's outputs.
#[macro_export]
macro_rules! inputs {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$field_meta:meta])* $field:ident : $sample:ty = $topic:path),* $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Debug, Default)]
        pub struct $name {
            $($(#[$field_meta])* pub $field: $crate::Input<$sample>,)*
        }

        impl $crate::InputSet for $name {
            const LATCH_SIZE: usize = 0 $(+ $crate::Input::<$sample>::LATCH_SIZE)*;
            const LAYOUT_HASH: u64 = {
                let hash = ::shared_types::wire::HASH_SEED;
                $(let hash = ::shared_types::wire::hash_bytes(
                    hash,
                    &<$sample as ::shared_types::wire::Wire>::SCHEMA.layout_hash.to_le_bytes(),
                );)*
                hash
            };
            fn visit<V: $crate::InputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
                $(visitor.visit(&$topic, &mut self.$field)?;)*
                let _ = visitor;
                Ok(())
            }
            fn receive(&mut self) {
                $(self.$field.receive();)*
            }
            fn receive_if_moved(&mut self, moved: $crate::graph::Roles) {
                $(self.$field.receive_if_moved(moved);)*
                let _ = moved;
            }
            fn accept(&mut self, t_ns: u64, previous_ns: Option<u64>) {
                $(self.$field.accept(t_ns, previous_ns);)*
                let _ = (t_ns, previous_ns);
            }
            fn counts(&self) -> $crate::InputCounts {
                let total = $crate::InputCounts::default();
                $(let total = total + self.$field.counts();)*
                total
            }
            fn cause_sequence(&self) -> u64 {
                let causes: &[Option<u64>] = &[
                    $(self.$field.sample().map(|s| {
                        ::shared_types::Sample::header(s).cause_sequence
                    })),*
                ];
                causes.first().copied().flatten().unwrap_or(0)
            }
            fn pack_latches(&self, out: &mut [u8]) {
                let rest = out;
                $(let (head, rest) = rest.split_at_mut($crate::Input::<$sample>::LATCH_SIZE);
                self.$field.pack_latch(head);)*
                debug_assert!(rest.is_empty());
            }
            fn unpack_latches(&mut self, from: &[u8]) {
                let rest = from;
                $(let (head, rest) = rest.split_at($crate::Input::<$sample>::LATCH_SIZE);
                self.$field.unpack_latch(head);)*
                debug_assert!(rest.is_empty());
            }
        }
    };
}

impl core::ops::Add for InputCounts {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            late: self.late + other.late,
            lost: self.lost + other.lost,
            overflowed: self.overflowed + other.overflowed,
        }
    }
}
