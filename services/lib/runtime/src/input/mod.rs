//! One input of a service: what has arrived, what is in effect, what is new.

pub(crate) mod left_out;
mod owner_records;
mod pending;
mod set;
mod stamps;

pub use set::{InputPort, InputSet, InputVisitor};

use self::left_out::{LateRange, LeftOut};
use self::pending::{Arrived, Pending};
use self::stamps::Stamps;
use crate::graph::{Edge, READER_CAPACITY, Roles};
use crate::ownership::SlotBook;
use shared_types::wire::Value;
use shared_types::{Header, OwnerRecord, Role, SEATS, Sample, Seat};
use std::any::Any;

/// Where samples come from: a shared-memory subscriber, or a queue within one process.
pub trait Source<T> {
    /// The next sample that has arrived, if any. Must not block or allocate.
    fn receive(&mut self) -> Option<T>;

    /// Shows everything that has arrived where it lies, with the instant of its arrival on
    /// `CLOCK_MONOTONIC` \[ns\]; 0 where nothing travels.
    fn drain(&mut self, take: &mut dyn FnMut(&T, u64)) {
        while let Some(sample) = self.receive() {
            take(&sample, 0);
        }
    }
}

/// The origin of the first input of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Origin {
    /// Sequence of the IMU sample that it descends from; 0 if none.
    pub cause_sequence: u64,
    /// Its own sequence; 0 if there is none.
    pub sequence: u64,
    /// When it arrived; see [`Header::receive_mono_ns`] \[ns\].
    pub receive_mono_ns: u64,
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
    /// Sequence numbers that never took effect: those that did not arrive, and those that had to make
    /// room for newer ones.
    pub lost: u64,
}

impl core::ops::Add for InputCounts {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            late: self.late.saturating_add(other.late),
            lost: self.lost.saturating_add(other.lost),
        }
    }
}

/// The newest sample of one seat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Newest {
    valid_ns: u64,
    pub(crate) sequence: u64,
    pub(crate) generation: u32,
}

impl Newest {
    pub(crate) fn of(header: &Header) -> Self {
        let Header { valid_ns, sequence, generation, .. } = *header;
        Self { valid_ns, sequence, generation }
    }

    /// True if the seat has published this sample, or a later one, already. Within a seat effect and
    /// sequence grow together; a process that takes a seat in flight counts from anywhere, but later.
    fn has(&self, header: &Header) -> bool {
        (header.valid_ns, header.sequence) <= (self.valid_ns, self.sequence)
    }

    /// Samples that are missing before this one. In a slot, `counts_anew`, each process has numbers of its
    /// own; elsewhere a restarted one goes on with those of its predecessor, whose last samples may be lost.
    pub(crate) fn missing_before(&self, header: &Header, counts_anew: bool) -> u64 {
        let comparable = self.generation == header.generation || !counts_anew;
        if comparable { header.sequence.saturating_sub(self.sequence.saturating_add(1)) } else { 0 }
    }
}

/// One input: the samples accepted but not yet effective, the new ones and the latest.
///
/// A topic of a slot has a writer on each of the slot's seats. The component judges by owner
/// records which of them counts.
pub struct Input<T> {
    source: Option<Box<dyn Source<T>>>,
    edge: Option<Edge>,
    /// Not in effect yet.
    pending: Pending<T>,
    /// What was in effect before, if anything was, and from `fresh_from` on what is new.
    effective: Vec<T>,
    fresh_from: usize,
    /// Arrival of the latest sample \[ns\].
    receive_mono_ns: u64,
    /// Of each seat: its newest sample in effect.
    newest: [Option<Newest>; SEATS],
    /// The same before this step.
    newest_before: [Option<Newest>; SEATS],
    /// Of each seat of a slot: it has not counted at some step since its newest sample, so that
    /// what it has published meanwhile is not missing.
    ignored: [bool; SEATS],
    /// The same before this step.
    ignored_before: [bool; SEATS],
    /// What was in effect at the step of a restored state, or before the first step of a loop that joined, is known and
    /// comes again as history.
    known_until_ns: Option<u64>,
    /// Of each seat: generation of the first process whose samples are taken.
    first_generations: [u32; SEATS],
    /// Of a slot: which seats' samples count when. No loop waits for the others, so their arrival
    /// depends on chance, and they are left out.
    slot: Option<SlotBook>,
    left_out: LeftOut,
    /// Of a slot: what its processes state about when they wrote.
    stamps: Stamps,
    /// Of owner records: all that have been received, and whether there are new ones.
    book: SlotBook,
    news: Option<Role>,
    counts: InputCounts,
}

impl<T: Sample> core::fmt::Debug for Input<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Input")
            .field("topic", &T::SCHEMA.name)
            .field("pending", &self.pending.len())
            .field("fresh", &self.fresh().len())
            .field("latest", &self.latest())
            .finish_non_exhaustive()
    }
}

impl<T: Sample> Default for Input<T> {
    fn default() -> Self {
        Self {
            source: None,
            edge: None,
            pending: Pending::default(),
            effective: Vec::with_capacity(READER_CAPACITY + 1),
            fresh_from: 0,
            receive_mono_ns: 0,
            newest: [None; SEATS],
            newest_before: [None; SEATS],
            ignored: [false; SEATS],
            ignored_before: [false; SEATS],
            known_until_ns: None,
            first_generations: [0; SEATS],
            slot: None,
            left_out: LeftOut::default(),
            stamps: Stamps::default(),
            book: SlotBook::default(),
            news: None,
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
        source.drain(&mut |sample, receive_mono_ns| self.arrive(sample, receive_mono_ns));
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
    pub fn offer(&mut self, sample: T) {
        self.arrive(&sample, 0);
    }

    fn arrive(&mut self, sample: &T, receive_mono_ns: u64) {
        self.learn(sample);
        let header = sample.header();
        let seat = usize::try_from(header.seat).unwrap_or(SEATS);
        let (Some(newest), Some(first_generation)) =
            (self.newest.get(seat), self.first_generations.get(seat))
        else {
            return;
        };
        if header.generation < *first_generation {
            return;
        }
        let of_slot = self.edge.as_ref().filter(|edge| edge.topic.from.is_slot());
        if of_slot.is_some_and(|edge| !self.stamps.follow(edge, header)) {
            return;
        }
        // What a seat publishes after its last known sample is new, however late it arrives. For a
        // seat without a known sample, a state gives only the instant until which others were
        // taken.
        let is_history = || self.known_until_ns.is_some_and(|t| self.in_effect(header.valid_ns, t));
        if newest.map_or_else(is_history, |newest| newest.has(header)) {
            return;
        }
        self.pending.insert(Arrived { sample: *sample, receive_mono_ns });
    }

    /// Moves what is in effect at `t_ns` into `fresh` and `latest`; `previous_ns` is the instant of
    /// the step before, from which lateness is judged.
    pub fn accept(&mut self, t_ns: u64, previous_ns: Option<u64>) {
        self.fresh_from = self.effective.len();
        self.left_out.begin_step();
        (self.newest_before, self.ignored_before) = (self.newest, self.ignored);
        while let Some(Arrived { sample, receive_mono_ns }) = self.pending.front() {
            let header = *sample.header();
            if !self.in_effect(header.valid_ns, t_ns) {
                break;
            }
            if self.slot.is_some_and(|slot| !slot.counts(header.seat, header.valid_ns)) {
                let edge = &self.edge;
                let in_effect = |t_ns| is_in_effect(edge.as_ref(), header.valid_ns, t_ns);
                self.counts.late += u64::from(self.left_out.note(&header, in_effect));
                self.pending.pop_front();
                continue;
            }
            if previous_ns.is_some_and(|p| self.in_effect(header.valid_ns, p)) {
                self.counts.late += 1;
            }
            let seat = usize::try_from(header.seat).unwrap_or(SEATS);
            let newest = self.newest.get_mut(seat);
            let before = newest.and_then(|newest| newest.replace(Newest::of(&header)));
            let ignored = self.ignored.get_mut(seat).is_some_and(core::mem::take);
            let counts_anew = self.counts_anew();
            let missing = |before: Newest| before.missing_before(&header, counts_anew);
            let lost = before.filter(|_| !ignored).map_or(0, missing);
            self.counts.lost = self.counts.lost.saturating_add(lost);
            self.receive_mono_ns = *receive_mono_ns;
            // Samples are large: what was in effect moves only where something is new.
            if self.fresh_from > 1 {
                self.effective[0] = self.effective[self.fresh_from - 1];
                self.effective.truncate(1);
                self.fresh_from = 1;
            }
            self.effective.push(*sample);
            self.pending.pop_front();
        }
        if let Some(slot) = &self.slot {
            for (seat, ignored) in (0..).zip(&mut self.ignored) {
                *ignored |= !slot.counts(seat, t_ns);
            }
        }
    }

    /// Lets what is in effect at `t_ns` be known without being new: a loop that joins a flight begins
    /// with the samples of its first period.
    pub fn skip_until(&mut self, t_ns: u64) {
        self.accept(t_ns, None);
        self.fresh_from = self.effective.len();
        self.counts = InputCounts::default();
        self.known_until_ns = Some(t_ns);
    }

    /// What has been received about the owner of a slot, if there is news since the last time; of owner
    /// records only. What ended before `previous_ns` is forgotten.
    pub fn owner_news(&mut self, previous_ns: Option<u64>) -> Option<(Role, SlotBook)> {
        let role = self.news.take()?;
        self.book.forget_before(previous_ns.unwrap_or(0));
        Some((role, self.book))
    }

    fn learn(&mut self, sample: &T) {
        if let Some(record) = (sample as &dyn Any).downcast_ref::<OwnerRecord>() {
            self.book.learn(record);
            self.news = Some(record.slot);
        }
    }

    /// Takes in which seat owns the slot from when, if this input comes from it.
    /// `previous_ns` is the last step, which did not know that yet.
    pub fn learn_owners(&mut self, role: Role, slot: &SlotBook, previous_ns: Option<u64>) {
        if self.edge.is_some_and(|edge| edge.from == role) {
            self.left_out.supersede(self.slot.as_ref(), previous_ns);
            self.slot = Some(*slot);
        }
    }

    /// Leaves out samples of processes that had gone when this one began, see
    /// [`Handover::first_generations`](shared_types::Handover::first_generations).
    pub fn take_from(&mut self, first_generations: &[u32; Seat::COUNT]) {
        let Some(role) = self.edge.map(|edge| edge.from) else { return };
        for (index, first) in (0..).zip(&mut self.first_generations) {
            *first = Seat { role, index }.number().map_or(0, |number| first_generations[number]);
        }
    }

    /// True if nothing follows any more from a process that had already gone when this one began.
    pub(crate) fn has_gone(&self, seat: usize, generation: u32) -> bool {
        self.first_generations.get(seat).is_some_and(|first| generation < *first)
    }

    /// What had arrived and was in effect at `t_ns` was taken in before a restore: history that repeats it is ignored.
    pub fn knows_until(&mut self, t_ns: u64) {
        self.known_until_ns = Some(t_ns);
    }

    /// From when on a sample that names `valid_ns` is in effect \[ns\].
    pub(crate) fn effect_ns(&self, valid_ns: u64) -> u64 {
        self.edge.as_ref().map_or(valid_ns, |edge| edge.effect_ns(valid_ns))
    }

    pub(crate) fn in_effect(&self, valid_ns: u64, t_ns: u64) -> bool {
        is_in_effect(self.edge.as_ref(), valid_ns, t_ns)
    }

    /// True if a process that takes the producer's place begins to count anew.
    pub(crate) fn counts_anew(&self) -> bool {
        self.edge.is_some_and(|edge| edge.topic.from.is_slot())
    }

    /// Generation of a writer among those that have numbers of their own. Where numbers go on, a
    /// restarted producer repeats its predecessor's last samples, and chance decides which copy
    /// arrives.
    pub(crate) fn generation_of(&self, header: &Header) -> u32 {
        if self.counts_anew() { header.generation } else { 0 }
    }

    /// Number of samples that have been taken in and are not in effect yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.pending.len()
    }

    /// Samples that took effect since the previous step, in order.
    #[must_use]
    pub fn fresh(&self) -> &[T] {
        &self.effective[self.fresh_from..]
    }

    /// What was in effect before this step's fresh samples.
    #[must_use]
    pub fn before_fresh(&self) -> Option<&T> {
        self.effective[..self.fresh_from].last()
    }

    /// First instant from `from_ns` on, the next step, at which a sample of a kind is in effect, as far as samples have
    /// arrived \[ns\].
    pub fn first_in_effect_ns(&self, from_ns: u64, is_meant: impl Fn(&T) -> bool) -> Option<u64> {
        if self.latest().is_some_and(&is_meant) {
            return Some(from_ns);
        }
        let to_come = self.pending.iter().find(|arrived| is_meant(&arrived.sample));
        to_come.map(|arrived| arrived.sample.header().valid_ns.max(from_ns))
    }

    /// The latest sample in effect, whichever process wrote it.
    #[must_use]
    pub fn latest(&self) -> Option<&T> {
        self.effective.last()
    }

    /// The origin of the latest sample.
    #[must_use]
    pub fn origin(&self) -> Origin {
        self.latest().map_or_else(Origin::default, |latest| {
            let Header { cause_sequence, sequence, .. } = *latest.header();
            Origin { cause_sequence, sequence, receive_mono_ns: self.receive_mono_ns }
        })
    }

    /// True if the loop began in flight, or goes on from a state.
    pub(crate) fn joined(&self) -> bool {
        self.known_until_ns.is_some()
    }

    /// Of each seat: its newest sample.
    pub(crate) fn newest(&self) -> [Option<Newest>; SEATS] {
        self.newest
    }

    /// Of each seat: what was its newest sample before this step.
    pub(crate) fn newest_before(&self) -> [Option<Newest>; SEATS] {
        self.newest_before
    }

    /// Of each seat: what came late at this step and was left out, see [`LateRange`].
    pub(crate) fn left_out(&self) -> [Option<LateRange>; SEATS] {
        self.left_out.ranges()
    }

    /// Of each seat: what it published before this step's first sample of it is not missing.
    pub(crate) fn ignored_before(&self) -> [bool; SEATS] {
        self.ignored_before
    }

    /// The latest sample, judged by the age of what it describes.
    #[must_use]
    pub fn link(&self, now_ns: u64, limit_ns: u64) -> Link<'_, T> {
        match self.latest() {
            None => Link::Silent,
            Some(last) => {
                let age_ns = now_ns.saturating_sub(last.described_ns());
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
    pub const LATCH_SIZE: usize = 8 + T::PACKED_SIZE;

    /// Writes the latched value into a published state.
    pub fn pack_latch(&self, out: &mut [u8]) {
        let (present, value) = out.split_at_mut(8);
        u64::from(self.latest().is_some()).pack(present);
        if let Some(latest) = self.latest() {
            latest.pack(value);
        } else {
            value.fill(0);
        }
    }

    /// Restores the latched value from a published state.
    pub fn unpack_latch(&mut self, from: &[u8]) {
        let (present, value) = from.split_at(8);
        let latest = (u64::unpack(present) != 0).then(|| T::unpack(value));
        self.effective.clear();
        self.effective.extend(latest);
        self.fresh_from = self.effective.len();
        self.receive_mono_ns = 0;
        (self.left_out, self.stamps) = (LeftOut::default(), Stamps::default());
        (self.newest, self.ignored) = ([None; SEATS], [false; SEATS]);
        if let Some(latest) = latest {
            self.learn(&latest);
        }
        if let Some(header) = latest.as_ref().map(T::header)
            && let Some(newest) =
                usize::try_from(header.seat).ok().and_then(|i| self.newest.get_mut(i))
        {
            *newest = Some(Newest::of(header));
            self.stamps.begin_with(header);
        }
    }
}

/// Whether a sample takes effect by an instant, at its own where there is no edge.
fn is_in_effect(edge: Option<&Edge>, valid_ns: u64, t_ns: u64) -> bool {
    edge.map_or(valid_ns <= t_ns, |edge| edge.in_effect(valid_ns, t_ns))
}
