//! Samples that have arrived and are not in effect yet.

use crate::graph::READER_CAPACITY;
use shared_types::{Header, SEATS, Sample};
use std::collections::VecDeque;

/// A sample that has arrived.
pub(super) struct Arrived<T> {
    pub(super) sample: T,
    /// When \[ns\].
    pub(super) receive_mono_ns: u64,
}

impl<T: Sample> Arrived<T> {
    /// Order within one input: effect, seat and sequence.
    fn place(&self) -> (u64, u32, u64) {
        let Header { valid_ns, seat, sequence, .. } = *self.sample.header();
        (valid_ns, seat, sequence)
    }

    fn seat(&self) -> usize {
        usize::try_from(self.sample.header().seat).unwrap_or(SEATS)
    }
}

/// The samples of one input that wait, in the order in which they take effect; never more than a reader keeps.
pub(super) struct Pending<T>(VecDeque<Arrived<T>>);

impl<T> Default for Pending<T> {
    fn default() -> Self {
        Self(VecDeque::with_capacity(READER_CAPACITY))
    }
}

impl<T: Sample> Pending<T> {
    /// Puts a sample in its place; one that comes again takes that of its copy.
    pub(super) fn insert(&mut self, arrived: Arrived<T>) {
        let place = arrived.place();
        // Nearly always it is the newest of all.
        let at = match self.0.back() {
            Some(last) if last.place() >= place => self.0.partition_point(|p| p.place() < place),
            _ => self.0.len(),
        };
        if let Some(same) = self.0.get_mut(at).filter(|p| p.place() == place) {
            *same = arrived;
        } else if self.0.len() < READER_CAPACITY {
            self.0.insert(at, arrived);
        } else {
            self.make_room_for(at, arrived);
        }
    }

    /// Takes a sample in place of the oldest one of the seat that has most of those that wait, so that no writer keeps
    /// another one's out. The newest matter to a loop; the gap before them is counted when they take effect.
    fn make_room_for(&mut self, at: usize, arrived: Arrived<T>) {
        let mut waiting = [0_usize; SEATS];
        for seat in self.0.iter().map(Arrived::seat) {
            if let Some(count) = waiting.get_mut(seat) {
                *count += 1;
            }
        }
        let most = (0..SEATS).max_by_key(|seat| waiting[*seat]);
        let Some(oldest) = self.0.iter().position(|one| Some(one.seat()) == most) else {
            return;
        };
        // Among its own, the oldest is the one to go.
        if oldest >= at && most == Some(arrived.seat()) {
            return;
        }
        self.0.remove(oldest);
        self.0.insert(at - usize::from(oldest < at), arrived);
    }

    /// The next one to take effect.
    pub(super) fn front(&self) -> Option<&Arrived<T>> {
        self.0.front()
    }

    pub(super) fn pop_front(&mut self) {
        self.0.pop_front();
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Arrived<T>> {
        self.0.iter()
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }
}
