//! A recorded topic as an input: each sample arrives when it did in flight.

use core::cell::Cell;
use runtime::Source;
use runtime::graph::Edge;
use shared_types::{Deviation, DeviationKind, Header, Sample, TopicInfo};
use std::collections::BTreeMap;
use std::rc::Rc;

/// A writer on an input: its seat, and how many processes had that before. Of roles with one seat the
/// restarted count as one: they go on with the numbers of their predecessors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Writer {
    seat: u32,
    generation: u32,
}

impl Writer {
    fn of(header: &Header, topic: &TopicInfo) -> Self {
        Self::new(header.seat, header.generation, topic)
    }

    fn new(seat: u32, generation: u32, topic: &TopicInfo) -> Self {
        let slot = topic.from.is_slot();
        Self { seat, generation: if slot { generation } else { 0 } }
    }
}

/// How the samples of one input departed from their edge.
#[derive(Debug, Default)]
pub(super) struct Exceptions {
    /// Writer and first sequence -> last sequence and the step that had them, late.
    late: BTreeMap<(Writer, u64), (u64, u64)>,
    /// Writer and first sequence -> last sequence that never arrived.
    lost: BTreeMap<(Writer, u64), u64>,
    /// First sequence that arrived, of the writers for which it is known; 0 if it is not.
    first: BTreeMap<Writer, u64>,
    /// Last sequence that arrived, of the writers for which it is known.
    last: BTreeMap<Writer, u64>,
    /// Since when those writers have had their seats that took free ones in flight \[ns\].
    seated_ns: BTreeMap<Writer, u64>,
    /// Nothing arrived at all.
    silent: bool,
    /// What a process that was killed had in effect: seat, and effect and sequence, which only grow there.
    latched: Option<(u32, (u64, u64))>,
}

impl Exceptions {
    /// Those of one input among the deviations of a process's life.
    pub(super) fn of<'a>(
        topic: &TopicInfo,
        deviations: impl Iterator<Item = &'a Deviation>,
    ) -> Self {
        let mut exceptions = Self::default();
        for deviation in deviations.filter(|d| d.input_name() == topic.name) {
            let Deviation { first, last, writer_seat, writer_generation, .. } = *deviation;
            let writer = Writer::new(writer_seat, writer_generation, topic);
            let step_ns = deviation.header.release_ns;
            match deviation.kind {
                DeviationKind::LateSamples => {
                    exceptions.late.insert((writer, first), (last, step_ns));
                }
                DeviationKind::LostSamples => {
                    exceptions.lost.insert((writer, first), last);
                }
                DeviationKind::Began => {
                    exceptions.first.insert(writer, first);
                }
                DeviationKind::Ended if last == 0 => exceptions.silent = true,
                DeviationKind::Ended => {
                    exceptions.last.insert(writer, last);
                }
                _ => {}
            }
        }
        exceptions
    }

    /// The same of a process that was killed when it had `latched` in effect.
    pub(super) fn killed_after(mut self, latched: Option<&Header>) -> Self {
        self.latched = latched.map(|h| (h.seat, (h.valid_ns, h.sequence)));
        self.silent |= latched.is_none();
        self
    }

    /// The same where a writer took a free seat at `from_ns`: nothing counts that it published for instants before,
    /// though another process had the seat at some of them.
    pub(super) fn seated(
        &mut self,
        topic: &TopicInfo,
        (seat, generation): (u32, u32),
        from_ns: u64,
    ) {
        self.seated_ns.insert(Writer::new(seat, generation, topic), from_ns);
    }

    /// True if the sample came when the loop had ended, or never. Of the seat that was in effect at the end
    /// nothing newer had come, from no process that had it.
    fn came_too_late(&self, writer: Writer, header: &Header) -> bool {
        let newer = |(seat, end): (u32, (u64, u64))| {
            header.seat == seat && (header.valid_ns, header.sequence) > end
        };
        self.silent
            || self.last.get(&writer).is_some_and(|last| header.sequence > *last)
            || self.latched.is_some_and(newer)
    }

    /// False for a writer of which the process never had anything. A seat may have had one between two others that
    /// was killed before its first samples had reached all processes.
    fn has_received(&self, writer: Writer, arrival: &Arrival, topic: &TopicInfo) -> bool {
        let is_known = self.first.contains_key(&writer);
        if topic.from.seats() == 1 {
            return is_known || !arrival.in_flight;
        }
        if is_known || self.last.contains_key(&writer) {
            return true;
        }
        // A process that was there from the start and was killed reported nothing of the first writer of a seat.
        let on_seat =
            Writer { generation: 0, ..writer }..=Writer { generation: u32::MAX, ..writer };
        let is_silent_of_seat = self.first.range(on_seat.clone()).next().is_none()
            && self.last.range(on_seat).next().is_none();
        !arrival.in_flight && !arrival.in_order && is_silent_of_seat
    }

    fn is_lost(&self, writer: Writer, Header { sequence, valid_ns, .. }: Header) -> bool {
        let is_from_before = self.seated_ns.get(&writer).is_some_and(|from_ns| valid_ns < *from_ns);
        if is_from_before && self.arrival_ns(writer, sequence).is_none() {
            return true;
        }
        if self.first.get(&writer).is_some_and(|first| sequence < *first) {
            return true;
        }
        let before = self.lost.range((writer, 0)..=(writer, sequence)).next_back();
        before.is_some_and(|(_, last)| sequence <= *last)
    }

    /// True if the sample came after the step at an instant, or never \[ns\].
    fn came_after(&self, writer: Writer, header: &Header, at_ns: u64) -> bool {
        let late = self.arrival_ns(writer, header.sequence).is_some_and(|step_ns| step_ns > at_ns);
        late || self.is_lost(writer, *header) || self.came_too_late(writer, header)
    }

    /// What a process published and had no time to announce, before it was killed, reaches the readers from its
    /// successor, which publishes it again with the same number; the recorder keeps the first copy alone unless the
    /// second one is another command. Here such samples become the successor's, for a reader that had them from there.
    ///
    /// One that joined had such a copy before its first step without its number being reported: that is the last sample
    /// of the one before, if the successor's own samples follow it, or there are none.
    fn attribute<T: Sample>(&self, by_writer: &mut BTreeMap<Writer, Vec<T>>) {
        for (&writer, &first) in &self.first {
            let begins = by_writer.get(&writer).and_then(|samples| samples.first());
            let begins = begins.map_or(u64::MAX, |sample| sample.header().sequence);
            let before = Writer { generation: 0, ..writer }..writer;
            let Some((known, samples)) = by_writer.range_mut(before).next_back() else { continue };
            let follows = samples.last().is_some_and(|last| {
                begins == u64::MAX || last.header().sequence.checked_add(1) == Some(begins)
            });
            let at = match self.last.get(known) {
                Some(&last) if first > 0 => samples
                    .partition_point(|s| s.header().sequence < first.max(last.saturating_add(1))),
                None if first == 0 && follows => samples.len() - 1,
                _ => continue,
            };
            let mut copies = samples.split_off(at);
            copies.retain_mut(|sample| {
                sample.header_mut().generation = writer.generation;
                sample.header().sequence < begins
            });
            by_writer.entry(writer).or_default().splice(0..0, copies);
        }
    }

    /// Step at which a late sample arrived \[ns\].
    fn arrival_ns(&self, writer: Writer, sequence: u64) -> Option<u64> {
        let before = self.late.range((writer, 0)..=(writer, sequence)).next_back();
        let (_, (last, step_ns)) = before?;
        (sequence <= *last).then_some(*step_ns)
    }
}

/// How a process came to a flight under way.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Arrival {
    /// When \[ns\]; none for one that begins with the flight or goes on in its place.
    pub(super) at_ns: Option<u64>,
    /// Without a state to go on from.
    pub(super) blank: bool,
    /// It joined, or goes on from a state: it reported the first sample of every writer that it received from.
    pub(super) in_flight: bool,
    /// It left in order: it reported the last sample of every writer that it received from.
    pub(super) in_order: bool,
}

/// What one writer published.
struct Reel<T> {
    writer: Writer,
    samples: Vec<T>,
    next: usize,
}

/// Plays a recorded topic to an input.
pub(super) struct TapeSource<T> {
    reels: Vec<Reel<T>>,
    edge: Edge,
    /// Step that is about to run \[ns\].
    now_ns: Rc<Cell<u64>>,
    exceptions: Exceptions,
}

impl<T: Sample> TapeSource<T> {
    /// Plays `samples`; to a process that joined a flight, what writers that were there had kept for it,
    /// and what came after. A writer may have left before such a process had its ports open.
    pub(super) fn new(
        samples: &[T],
        topic: &TopicInfo,
        edge: Edge,
        exceptions: Exceptions,
        arrival: Arrival,
        now_ns: Rc<Cell<u64>>,
    ) -> Self {
        let mut by_writer: BTreeMap<Writer, Vec<T>> = BTreeMap::new();
        for sample in samples {
            by_writer.entry(Writer::of(sample.header(), topic)).or_default().push(*sample);
        }
        exceptions.attribute(&mut by_writer);
        let reel = |(writer, samples): (Writer, Vec<T>)| {
            let next = match arrival.at_ns {
                _ if !exceptions.has_received(writer, &arrival, topic) => samples.len(),
                Some(at_ns) if arrival.blank => {
                    let mut before = samples.partition_point(|s| s.header().release_ns < at_ns);
                    // Of a writer that was late then, what it had kept ends earlier.
                    let is_to_come = |s: &T| exceptions.came_after(writer, s.header(), at_ns);
                    while before.checked_sub(1).is_some_and(|last| is_to_come(&samples[last])) {
                        before -= 1;
                    }
                    before.saturating_sub(topic.history)
                }
                _ => 0,
            };
            Reel { writer, samples, next }
        };
        let reels = by_writer.into_iter().map(reel).collect();
        Self { reels, edge, now_ns, exceptions }
    }
}

impl<T: Sample> Reel<T> {
    fn play(&mut self, edge: &Edge, exceptions: &Exceptions, now_ns: u64) -> Option<T> {
        loop {
            let sample = *self.samples.get(self.next)?;
            let header = *sample.header();
            if exceptions.is_lost(self.writer, header) {
                self.next += 1;
                continue;
            }
            if exceptions.came_too_late(self.writer, &header) {
                return None;
            }
            // Nominally a sample is there by the step that it is in effect at.
            let arrived = exceptions.arrival_ns(self.writer, header.sequence).map_or_else(
                || edge.in_effect(header.valid_ns, now_ns),
                |step_ns| step_ns <= now_ns,
            );
            if !arrived {
                return None;
            }
            self.next += 1;
            return Some(sample);
        }
    }
}

impl<T: Sample> Source<T> for TapeSource<T> {
    fn receive(&mut self) -> Option<T> {
        let Self { reels, edge, now_ns, exceptions } = self;
        reels.iter_mut().find_map(|reel| reel.play(edge, exceptions, now_ns.get()))
    }
}

#[cfg(test)]
mod tests;
