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
    /// successor, which publishes it again with the same number; the recorder keeps the first copy alone. Here such
    /// samples become the successor's, for a reader that had them from there.
    fn attribute<T: Sample>(&self, by_writer: &mut BTreeMap<Writer, Vec<T>>) {
        for (&writer, &first) in self.first.iter().filter(|(_, first)| **first > 0) {
            let begins = by_writer.get(&writer).and_then(|samples| samples.first());
            let begins = begins.map_or(u64::MAX, |sample| sample.header().sequence);
            let before = Writer { generation: 0, ..writer }..writer;
            let Some((known, samples)) = by_writer.range_mut(before).next_back() else { continue };
            let Some(&last) = self.last.get(known) else { continue };
            let at = samples.partition_point(|s| s.header().sequence < first.max(last + 1));
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
mod tests {
    use super::*;
    use shared_types::{Imu, Role, WrenchCommand, topics};

    const MS: u64 = 1_000_000;

    fn imu(sequence: u64) -> Imu {
        let header = Header { sequence, valid_ns: sequence * MS, ..Header::default() };
        Imu { header, ..Imu::default() }
    }

    fn deviation(kind: DeviationKind, step_ms: u64, first: u64, last: u64) -> Deviation {
        let header = Header { release_ns: step_ms * MS, ..Header::default() };
        let input = Deviation::input_from("imu");
        Deviation { header, kind, first, last, input, ..Deviation::default() }
    }

    /// Sequences that a step each millisecond has.
    fn played(deviations: &[Deviation]) -> Vec<Vec<u64>> {
        let now_ns = Rc::new(Cell::new(0));
        let mut source = TapeSource::new(
            &(1..=8).map(imu).collect::<Vec<_>>(),
            &topics::IMU.info,
            Edge::unwaited(&topics::IMU.info, Role::Estimator),
            Exceptions::of(&topics::IMU.info, deviations.iter()),
            Arrival::default(),
            Rc::clone(&now_ns),
        );
        let step = |step_ms: u64| {
            now_ns.set(step_ms * MS);
            let arrived = core::iter::from_fn(|| source.receive());
            arrived.map(|s| s.header.sequence).collect()
        };
        (1..=8).map(step).collect()
    }

    #[test]
    fn nominally_a_sample_is_there_at_the_step_that_it_takes_effect_at() {
        let expected: Vec<_> = (1..=8).map(|sequence| vec![sequence]).collect();
        assert_eq!(played(&[]), expected);
    }

    #[test]
    fn late_and_lost_samples_come_as_they_came_in_flight() {
        let of_another_input = Deviation {
            input: Deviation::input_from("pose_fix"),
            ..deviation(DeviationKind::LostSamples, 1, 1, 8)
        };
        let played = played(&[
            deviation(DeviationKind::LostSamples, 3, 2, 2),
            deviation(DeviationKind::LateSamples, 6, 3, 5),
            of_another_input,
        ]);
        let expected =
            [vec![1], vec![], vec![], vec![], vec![], vec![3, 4, 5, 6], vec![7], vec![8]];
        assert_eq!(played, expected);
    }

    #[test]
    fn a_killed_loop_had_received_nothing_of_the_successor_of_what_it_followed() {
        let now_ns = Rc::new(Cell::new(8 * MS));
        let sample = |sequence, generation| {
            let Imu { header, .. } = imu(sequence);
            Imu { header: Header { generation, ..header }, ..Imu::default() }
        };
        let slot = &topics::WRENCH_COMMAND.info;
        let mut source = TapeSource::new(
            &[sample(1, 0), sample(2, 0), sample(3, 1), sample(4, 1)],
            slot,
            Edge::unwaited(slot, Role::Estimator),
            Exceptions::default().killed_after(Some(&sample(2, 0).header)),
            Arrival::default(),
            now_ns,
        );
        let received: Vec<_> = core::iter::from_fn(|| source.receive()).collect();
        assert_eq!(received.iter().map(|s| s.header.sequence).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn a_writer_that_had_left_when_the_process_joined_is_read_if_that_is_reported() {
        let slot = &topics::WRENCH_COMMAND.info;
        let sample = |seat, sequence, valid_ms| {
            let header = Header {
                seat,
                sequence,
                valid_ns: valid_ms * MS,
                release_ns: valid_ms * MS,
                ..Header::default()
            };
            WrenchCommand { header, ..WrenchCommand::default() }
        };
        // Seat 0 publishes its last sample at 2 ms; the process joins at 3 ms.
        let samples = [sample(0, 1, 1), sample(0, 2, 2), sample(1, 1, 2), sample(1, 2, 4)];
        let received = |deviations: &[Deviation]| {
            let mut source = TapeSource::new(
                &samples,
                slot,
                Edge::unwaited(slot, Role::Plant),
                Exceptions::of(slot, deviations.iter()),
                Arrival { at_ns: Some(3 * MS), blank: true, in_flight: true, in_order: false },
                Rc::new(Cell::new(8 * MS)),
            );
            let received = core::iter::from_fn(|| source.receive());
            received.map(|s| (s.header.seat, s.header.sequence)).collect::<Vec<_>>()
        };
        let input = Deviation::input_from(slot.name);
        let began = |writer_seat, first| Deviation {
            input,
            writer_seat,
            ..deviation(DeviationKind::Began, 3, first, first)
        };
        assert_eq!(received(&[began(1, 0)]), [(1, 1), (1, 2)]);
        assert_eq!(received(&[began(0, 0), began(1, 2)]), [(0, 1), (0, 2), (1, 2)]);
        assert_eq!(received(&[began(0, 2)]), [(0, 2)]);
    }

    #[test]
    fn a_writer_that_was_late_when_the_process_joined_had_kept_its_history_by_then() {
        let topic = &topics::IMU.info;
        let history = topic.history as u64;
        let of = |release_ms: u64| {
            let mut sample = imu(release_ms);
            sample.header.release_ns = release_ms * MS;
            sample
        };
        let samples: Vec<_> = (1..=4 * history).map(of).collect();
        // It joins at 3 histories, when the last two of them had not been published, and has the newest half late.
        let join_ms = 3 * history + 1;
        let deviations = [
            deviation(DeviationKind::Began, join_ms, 0, 0),
            deviation(DeviationKind::LostSamples, join_ms + 1, history + 1, 2 * history),
            deviation(DeviationKind::LateSamples, join_ms + 1, 2 * history + 1, 3 * history),
        ];
        let now_ns = Rc::new(Cell::new(join_ms * MS));
        let mut source = TapeSource::new(
            &samples,
            topic,
            Edge::unwaited(topic, Role::Estimator),
            Exceptions::of(topic, deviations.iter()),
            Arrival { at_ns: Some(join_ms * MS), blank: true, in_flight: true, in_order: false },
            now_ns,
        );
        let received: Vec<u64> =
            core::iter::from_fn(|| source.receive()).map(|s| s.header.sequence).collect();
        assert_eq!(received, (1..=history).collect::<Vec<_>>());
    }

    #[test]
    fn a_writer_that_was_killed_before_its_samples_reached_the_process_is_left_out() {
        let slot = &topics::WRENCH_COMMAND.info;
        let sample = |generation, sequence| {
            let header = Header { generation, sequence, valid_ns: MS, ..Header::default() };
            WrenchCommand { header, ..WrenchCommand::default() }
        };
        let ended = |writer_generation, last| Deviation {
            input: Deviation::input_from(slot.name),
            writer_generation,
            ..deviation(DeviationKind::Ended, 8, last, last)
        };
        let mut source = TapeSource::new(
            &[sample(0, 7), sample(0, 8), sample(1, 8), sample(2, 8), sample(2, 9)],
            slot,
            Edge::unwaited(slot, Role::Plant),
            Exceptions::of(slot, [ended(0, 7), ended(2, 9)].iter()),
            Arrival { in_order: true, ..Arrival::default() },
            Rc::new(Cell::new(8 * MS)),
        );
        let received = core::iter::from_fn(|| source.receive());
        let received: Vec<_> = received.map(|s| (s.header.generation, s.header.sequence)).collect();
        assert_eq!(received, [(0, 7), (2, 8), (2, 9)]);
    }

    #[test]
    fn a_copy_that_only_the_recorder_had_of_a_killed_writer_comes_from_its_successor() {
        let slot = &topics::WRENCH_COMMAND.info;
        let command = |generation, sequence| {
            let header = Header { generation, sequence, valid_ns: MS, ..Header::default() };
            WrenchCommand { header, ..WrenchCommand::default() }
        };
        let of = |kind, writer_generation, sequence| Deviation {
            input: Deviation::input_from(slot.name),
            writer_generation,
            ..deviation(kind, 8, sequence, sequence)
        };
        let deviations = [of(DeviationKind::Ended, 0, 7), of(DeviationKind::Began, 1, 8)];
        let played = |recorded: &[WrenchCommand]| {
            let mut source = TapeSource::new(
                recorded,
                slot,
                Edge::unwaited(slot, Role::Plant),
                Exceptions::of(slot, deviations.iter()),
                Arrival::default(),
                Rc::new(Cell::new(8 * MS)),
            );
            let played = core::iter::from_fn(|| source.receive());
            played.map(|s| (s.header.generation, s.header.sequence)).collect::<Vec<_>>()
        };
        let expected = [(0, 7), (1, 8), (1, 9), (1, 10)];
        assert_eq!(
            played(&[command(0, 7), command(0, 8), command(0, 9), command(1, 10)]),
            expected
        );
        // A candidate on a seat that another one had before counts from 1.
        let candidate = [command(0, 7), command(0, 8), command(1, 1), command(1, 8), command(1, 9)];
        assert_eq!(played(&candidate), [(0, 7), (1, 8), (1, 9)]);
        // In realtime both copies may be recorded.
        let both = [command(0, 7), command(0, 8), command(1, 8), command(1, 9), command(1, 10)];
        assert_eq!(played(&both), expected);
    }

    #[test]
    fn what_a_writer_publishes_for_instants_before_it_had_its_seat_does_not_count() {
        let slot = &topics::WRENCH_COMMAND.info;
        let sample = |sequence| {
            let header =
                Header { generation: 1, sequence, valid_ns: sequence * MS, ..Header::default() };
            WrenchCommand { header, ..WrenchCommand::default() }
        };
        let samples: Vec<_> = (1..=6).map(sample).collect();
        // It catches up from 1 ms on and has its seat from 4 ms on; that sample 2 was received is reported.
        let late = Deviation {
            input: Deviation::input_from(slot.name),
            writer_generation: 1,
            ..deviation(DeviationKind::LateSamples, 5, 2, 2)
        };
        let mut exceptions = Exceptions::of(slot, [late].iter());
        exceptions.seated(slot, (0, 1), 4 * MS);
        let mut source = TapeSource::new(
            &samples,
            slot,
            Edge::unwaited(slot, Role::Plant),
            exceptions,
            Arrival::default(),
            Rc::new(Cell::new(8 * MS)),
        );
        let received = core::iter::from_fn(|| source.receive());
        assert_eq!(received.map(|s| s.header.sequence).collect::<Vec<_>>(), [2, 4, 5, 6]);
    }

    #[test]
    fn what_a_writer_published_before_its_first_sample_was_read_never_arrived() {
        let began = Deviation { last: 3, ..deviation(DeviationKind::Began, 3, 3, 3) };
        let expected: Vec<_> =
            (1..=8).map(|sequence| if sequence < 3 { vec![] } else { vec![sequence] }).collect();
        assert_eq!(played(&[began]), expected);
    }

    #[test]
    fn what_had_not_arrived_at_the_end_never_does() {
        let steps = |played: Vec<Vec<u64>>| played.iter().filter(|s| !s.is_empty()).count();
        assert_eq!(steps(played(&[deviation(DeviationKind::Ended, 9, 5, 5)])), 5);
        assert_eq!(steps(played(&[deviation(DeviationKind::Ended, 9, 0, 0)])), 0);
    }
}
