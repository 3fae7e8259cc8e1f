//! Counts what was recorded per topic and seat, by sequence numbers.

use shared_types::wire::{Field, FieldClass, Visitor, Wire};
use shared_types::{Header, Sample, TopicInfo, topics};
use std::collections::BTreeMap;
use std::fmt;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

/// Totals of one producer seat of one topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Samples written.
    pub count: u64,
    /// Sequence of the first sample.
    pub first: u64,
    /// Sequence of the last sample.
    pub last: u64,
    /// Sequence numbers that never arrived between the first and the last sample.
    pub gaps: u64,
    /// Samples that came again and were not written.
    pub repeated: u64,
    /// Times the numbering fell back although logical time went on, or, of a controller, went on faster than its releases.
    pub renumbered: u64,
    /// Processes that wrote, one after the other, as far as their samples show.
    pub writers: u64,
    /// Release of the last sample \[ns\].
    last_release_ns: u64,
    /// Generation of its writer.
    generation: u32,
    /// Its [`content`].
    content: u64,
    /// Shortest time between two samples with successive numbers \[ns\]; 0 before there were two.
    period_ns: u64,
}

impl Tally {
    /// Takes note of numbers that are missing before a sample of the same process. If it may be a controller and there
    /// were not as many releases, its count is wrong and nothing is lost.
    fn note_missing(&mut self, missing: u64, release_ns: u64, is_of_controllers: bool) {
        let since_ns = release_ns.saturating_sub(self.last_release_ns);
        let releases = since_ns.checked_div(self.period_ns).filter(|_| is_of_controllers);
        if missing == 0 {
            if since_ns > 0 && (self.period_ns == 0 || since_ns < self.period_ns) {
                self.period_ns = since_ns;
            }
        } else if releases.is_some_and(|releases| missing >= releases.max(1)) {
            self.renumbered += 1;
        } else {
            self.gaps = self.gaps.saturating_add(missing);
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, first, last, gaps, repeated, renumbered, writers, .. } = self;
        write!(f, r#"{{"count":{count},"first":{first},"last":{last},"gaps":{gaps},"#)?;
        write!(f, r#""repeated":{repeated},"renumbered":{renumbered},"writers":{writers}}}"#)
    }
}

/// What to do with a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SequenceCheck {
    /// Write it.
    New,
    /// A restarted producer repeats a step: leave it out.
    Repeated,
}

/// A channel under audit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stream(usize);

/// Sequence audit of a whole recording.
#[derive(Debug, Clone, Default)]
pub struct SequenceAudit {
    channels: Vec<Channel>,
}

#[derive(Debug, Clone)]
struct Channel {
    name: String,
    /// Controllers write it, one sample at a release at most; users bring some, which may count wrongly.
    is_of_controllers: bool,
    /// Totals by seat.
    seats: BTreeMap<u32, Tally>,
}

impl SequenceAudit {
    /// Puts a channel under audit, by the name of its topic.
    pub fn register(&mut self, name: impl Into<String>) -> Stream {
        let (name, seats) = (name.into(), BTreeMap::new());
        let topic = name.trim_start_matches('/');
        let is_of_slot = |info: &TopicInfo| info.name == topic && info.from.is_slot();
        let is_of_controllers =
            topic == topics::LOOP_STATS.info.name || topics::all().into_iter().any(is_of_slot);
        self.channels.push(Channel { name, is_of_controllers, seats });
        Stream(self.channels.len() - 1)
    }

    /// Takes note of a sample.
    ///
    /// A number that does not grow is a repetition, unless its logical time does grow: then the
    /// producer lost its count, and dropping its samples would lose data. A restarted process whose last step is another
    /// one now, because a process that it reads has died too, repeats nothing: some followed it, and some the one before.
    pub fn observe(
        &mut self,
        Stream(stream): Stream,
        header: &Header,
        content: u64,
    ) -> SequenceCheck {
        let Header { seat, sequence, release_ns, generation, .. } = *header;
        let Some(channel) = self.channels.get_mut(stream) else { return SequenceCheck::New };
        let tally = channel.seats.entry(seat).or_default();
        let is_another =
            sequence == tally.last && generation > tally.generation && content != tally.content;
        if tally.count == 0 {
            (tally.first, tally.writers) = (sequence, 1);
        } else if sequence > tally.last {
            // A process that takes a seat in flight counts on from another seat's numbers.
            if generation == tally.generation {
                let missing = sequence - tally.last - 1;
                tally.note_missing(missing, release_ns, channel.is_of_controllers);
            }
        } else if release_ns > tally.last_release_ns {
            tally.renumbered += 1;
        } else if !is_another {
            tally.repeated += 1;
            return SequenceCheck::Repeated;
        }
        if tally.count > 0 && generation != tally.generation {
            tally.writers += 1;
            tally.period_ns = 0;
        }
        tally.count += 1;
        tally.last = sequence;
        tally.last_release_ns = release_ns;
        tally.generation = generation;
        tally.content = content;
        SequenceCheck::New
    }

    /// Channel, seat and totals, in order of registration.
    pub fn tallies(&self) -> impl Iterator<Item = (&str, u32, &Tally)> {
        self.channels.iter().flat_map(|Channel { name, seats, .. }| {
            seats.iter().map(move |(seat, tally)| (name.as_str(), *seat, tally))
        })
    }

    /// Samples under audit.
    #[must_use]
    pub fn samples(&self) -> u64 {
        self.tallies().fold(0, |all: u64, (.., tally)| all.saturating_add(tally.count))
    }

    /// Sequence numbers that never arrived: channel, and how many of all its seats.
    #[must_use]
    pub fn gaps(&self) -> Vec<(&str, u64)> {
        let gaps = |seats: &BTreeMap<u32, Tally>| {
            seats.values().map(|tally| tally.gaps).fold(0, u64::saturating_add)
        };
        let all = self.channels.iter().map(|channel| (channel.name.as_str(), gaps(&channel.seats)));
        all.filter(|(_, gaps)| *gaps > 0).collect()
    }

    /// As metadata: `channel#seat` -> totals in JSON.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let entry = |(channel, seat, tally): (&str, u32, &Tally)| {
            (format!("{channel}#{seat}"), tally.to_string())
        };
        self.tallies().map(entry).collect()
    }
}

/// What distinguishes the samples that two processes on one seat of a slot publish under one number, where that is
/// possible; 0 of all other topics.
pub fn content<T: Sample>(topic: &TopicInfo, sample: &T) -> u64 {
    if !topic.from.is_slot() {
        return 0;
    }
    let mut content = Content(DefaultHasher::new());
    sample.visit(&mut content);
    content.0.finish()
}

/// Hashes what happened.
struct Content(DefaultHasher);

impl Content {
    fn takes(field: &Field) -> bool {
        !matches!(field.class, FieldClass::Machine | FieldClass::Padding)
    }
}

impl Visitor for Content {
    fn f64s(&mut self, field: &'static Field, values: &[f64]) {
        if Self::takes(field) {
            for value in values {
                value.to_bits().hash(&mut self.0);
            }
        }
    }
    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        if Self::takes(field) {
            values.hash(&mut self.0);
        }
    }
    fn bytes(&mut self, field: &'static Field, values: &[u8]) {
        if Self::takes(field) {
            values.hash(&mut self.0);
        }
    }
    fn message<T: Wire>(&mut self, field: &'static Field, value: &T) {
        if Self::takes(field) {
            value.visit(self);
        }
    }
}

/// Gaps as text: `3 of imu, 1 of truth`.
#[must_use]
pub fn name_gaps(gaps: &[(&str, u64)]) -> String {
    let parts = gaps.iter().map(|(channel, count)| format!("{count} of {channel}"));
    parts.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::{SequenceAudit, SequenceCheck, Tally, content};
    use shared_types::{Header, WrenchCommand, topics};

    fn header(seat: u32, sequence: u64, release_ns: u64) -> Header {
        Header { seat, sequence, release_ns, ..Header::default() }
    }

    fn only(audit: &SequenceAudit) -> Tally {
        let mut tallies = audit.tallies();
        let (_, _, tally) = tallies.next().unwrap_or_else(|| panic!("nothing observed"));
        assert!(tallies.next().is_none());
        *tally
    }

    #[test]
    fn an_unbroken_stream_has_neither_gaps_nor_repetitions() {
        let mut audit = SequenceAudit::default();
        let imu = audit.register("/imu");
        for sequence in 1..=1000 {
            assert_eq!(
                audit.observe(imu, &header(0, sequence, sequence * 1000), 0),
                SequenceCheck::New
            );
        }
        let tally = only(&audit);
        assert_eq!((tally.count, tally.first, tally.last), (1000, 1, 1000));
        assert_eq!((tally.gaps, tally.repeated, tally.renumbered), (0, 0, 0));
    }

    #[test]
    fn lost_numbers_are_counted_one_by_one() {
        let mut audit = SequenceAudit::default();
        let imu = audit.register("/imu");
        for sequence in [3, 4, 8, 9, 11] {
            audit.observe(imu, &header(0, sequence, sequence), 0);
        }
        let tally = only(&audit);
        assert_eq!((tally.count, tally.first, tally.last, tally.gaps), (5, 3, 11, 4));
    }

    #[test]
    fn numbers_at_the_end_of_their_range_are_counted_and_no_sum_overflows() {
        let mut audit = SequenceAudit::default();
        let imu = audit.register("/imu");
        let jumps =
            [(0, 1, 1), (0, u64::MAX, 2), (0, 1, 3), (0, u64::MAX, 4), (1, 1, 1), (1, 9, 2)];
        for (seat, sequence, release_ns) in jumps {
            audit.observe(imu, &header(seat, sequence, release_ns), 0);
        }
        assert_eq!(audit.gaps(), [("/imu", u64::MAX)]);
    }

    #[test]
    fn a_restarted_producer_repeats_its_last_steps_without_leaving_a_trace() {
        let mut audit = SequenceAudit::default();
        let imu = audit.register("/imu");
        let steps = [1, 2, 3, 4, 3, 4, 5, 6];
        let written: Vec<u64> = steps
            .into_iter()
            .filter(|&s| audit.observe(imu, &header(0, s, s * 1000), 0) == SequenceCheck::New)
            .collect();
        assert_eq!(written, [1, 2, 3, 4, 5, 6]);
        let tally = only(&audit);
        assert_eq!((tally.count, tally.gaps, tally.repeated), (6, 0, 2));
    }

    #[test]
    fn a_restarted_controller_that_commands_something_else_repeats_nothing() {
        let mut audit = SequenceAudit::default();
        let info = &topics::WRENCH_COMMAND.info;
        let commands = audit.register(info.name);
        let mut observe = |generation, sequence, thrust_n, publish_mono_ns| {
            let header = Header { generation, publish_mono_ns, ..header(0, sequence, sequence) };
            let command = WrenchCommand { header, thrust_n, ..WrenchCommand::default() };
            audit.observe(commands, &header, content(info, &command))
        };
        assert_eq!(observe(0, 1, 1.0, 5), SequenceCheck::New);
        assert_eq!(observe(0, 2, 1.0, 6), SequenceCheck::New);
        assert_eq!(observe(1, 2, 1.0, 9), SequenceCheck::Repeated, "the same at another time");
        assert_eq!(observe(1, 2, 1.5, 9), SequenceCheck::New);
        assert_eq!(observe(1, 2, 1.5, 9), SequenceCheck::Repeated);
        assert_eq!(observe(1, 3, 1.5, 10), SequenceCheck::New);
        let tally = only(&audit);
        assert_eq!((tally.count, tally.gaps, tally.repeated, tally.writers), (4, 0, 2, 2));
    }

    #[test]
    fn a_producer_that_lost_its_count_is_still_recorded() {
        let mut audit = SequenceAudit::default();
        let imu = audit.register("/imu");
        for (sequence, release_ns) in [(1, 10), (2, 20), (1, 30), (2, 40)] {
            assert_eq!(audit.observe(imu, &header(0, sequence, release_ns), 0), SequenceCheck::New);
        }
        let tally = only(&audit);
        assert_eq!((tally.count, tally.renumbered, tally.repeated), (4, 1, 0));
    }

    #[test]
    fn numbers_that_a_controller_leaves_out_without_time_for_them_are_not_lost() {
        let mut audit = SequenceAudit::default();
        let commands = audit.register("/wrench_command");
        let mut observe = |sequence, release_ns| {
            audit.observe(commands, &header(0, sequence, release_ns), 1);
            (only(&audit).gaps, only(&audit).renumbered)
        };
        assert_eq!(observe(1, 10), (0, 0));
        assert_eq!(observe(2, 12), (0, 0));
        assert_eq!(observe(1_003, 14), (0, 1), "one release later");
        assert_eq!(observe(1_004, 16), (0, 1));
        assert_eq!(observe(u64::MAX - 2, 18), (0, 2));
        assert_eq!(observe(u64::MAX, 22), (1, 2), "the release at 20 is lost");
    }

    #[test]
    fn only_of_what_controllers_write_numbers_can_be_left_out() {
        for (topic, is_lost) in [
            (&topics::LOOP_STATS.info, false),
            (&topics::DEVIATION.info, true),
            (&topics::IMU.info, true),
        ] {
            let mut audit = SequenceAudit::default();
            let stream = audit.register(topic.name);
            for (sequence, release_ns) in [(1, 100), (2, 200), (30, 300)] {
                audit.observe(stream, &header(0, sequence, release_ns), 0);
            }
            let gaps = if is_lost { 27 } else { 0 };
            assert_eq!(only(&audit).gaps, gaps, "{}", topic.name);
        }
    }

    #[test]
    fn a_process_that_takes_a_seat_counts_on_from_another_number_without_a_gap() {
        let mut audit = SequenceAudit::default();
        let commands = audit.register("/wrench_command");
        for (generation, sequence) in [(0, 3), (0, 4), (1, 90), (1, 92)] {
            let header = Header { generation, ..header(1, sequence, sequence) };
            assert_eq!(audit.observe(commands, &header, 0), SequenceCheck::New);
        }
        assert_eq!((only(&audit).gaps, only(&audit).writers), (1, 2));
    }

    #[test]
    fn seats_and_channels_are_counted_apart() {
        let mut audit = SequenceAudit::default();
        let (a, b) = (audit.register("/a"), audit.register("/b"));
        for (channel, seat) in [(a, 1), (b, 0), (a, 0), (a, 1)] {
            audit.observe(channel, &header(seat, 7, 0), 0);
        }
        let metadata = audit.to_metadata();
        let keys: Vec<_> = metadata.keys().map(String::as_str).collect();
        assert_eq!(keys, ["/a#0", "/a#1", "/b#0"]);
        let expected =
            r#"{"count":1,"first":7,"last":7,"gaps":0,"repeated":1,"renumbered":0,"writers":1}"#;
        assert_eq!(metadata["/a#1"], expected);
    }
}
