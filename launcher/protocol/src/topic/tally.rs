//! How often samples come, and what is missing between them.

use serde::Serialize;
use shared_types::Header;
use shared_types::time::s_from_ns;
use std::collections::BTreeMap;

/// Of one writer.
#[derive(Debug, Clone, Copy, Default)]
struct Writer {
    count: u64,
    first: Header,
    last: Header,
    gaps: u64,
    shortest_ns: u64,
    longest_ns: u64,
}

/// Of one topic.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    writers: BTreeMap<u32, Writer>,
}

/// What a tally has of one writer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Counted {
    /// Seat of the writer.
    pub seat: u32,
    /// Samples.
    pub count: u64,
    /// Release of the first \[s\].
    pub first_s: f64,
    /// Release of the last \[s\].
    pub last_s: f64,
    /// Samples per logical second; none of a single sample.
    pub hz: Option<f64>,
    /// Shortest logical time between two samples \[s\].
    pub shortest_s: Option<f64>,
    /// Longest logical time between two samples \[s\].
    pub longest_s: Option<f64>,
    /// Samples per second of the wall clock, by when they were published.
    pub wall_hz: Option<f64>,
    /// Sequence numbers that never came.
    pub gaps: u64,
}

impl Tally {
    /// Counts a sample.
    pub fn count(&mut self, header: &Header) {
        let writer = self.writers.entry(header.seat).or_default();
        if writer.count == 0 {
            writer.first = *header;
            writer.shortest_ns = u64::MAX;
        } else {
            let interval_ns = header.release_ns.saturating_sub(writer.last.release_ns);
            writer.shortest_ns = writer.shortest_ns.min(interval_ns);
            writer.longest_ns = writer.longest_ns.max(interval_ns);
            // A process that takes a seat in flight counts from elsewhere.
            if header.generation == writer.last.generation {
                let missing =
                    header.sequence.saturating_sub(writer.last.sequence.saturating_add(1));
                writer.gaps = writer.gaps.saturating_add(missing);
            }
        }
        writer.last = *header;
        writer.count += 1;
    }

    /// Samples so far.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.writers.values().map(|writer| writer.count).sum()
    }

    /// What it has counted, by seat.
    #[must_use]
    pub fn counted(&self) -> Vec<Counted> {
        self.writers.iter().map(|(seat, writer)| writer.counted(*seat)).collect()
    }
}

impl Writer {
    fn counted(&self, seat: u32) -> Counted {
        let Self { count, first, last, gaps, shortest_ns, longest_ns } = *self;
        let several = count > 1;
        let per_second = |from_ns: u64, to_ns: u64| {
            let span_s = to_ns.saturating_sub(from_ns) as f64 / 1e9;
            (several && span_s > 0.0).then(|| (count - 1) as f64 / span_s)
        };
        Counted {
            seat,
            count,
            first_s: s_from_ns(first.release_ns),
            last_s: s_from_ns(last.release_ns),
            hz: per_second(first.release_ns, last.release_ns),
            shortest_s: several.then(|| s_from_ns(shortest_ns)),
            longest_s: several.then(|| s_from_ns(longest_ns)),
            wall_hz: per_second(first.publish_mono_ns, last.publish_mono_ns),
            gaps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(sequence: u64, release_ms: u64, seat: u32) -> Header {
        let release_ns = release_ms * 1_000_000;
        let publish_mono_ns = 5_000_000_000 + 2 * release_ns;
        Header { sequence, release_ns, publish_mono_ns, seat, ..Header::default() }
    }

    #[test]
    fn rates_intervals_and_gaps_are_counted_writer_by_writer() {
        let mut tally = Tally::default();
        for (sequence, ms) in [(1, 0), (2, 10), (3, 20), (6, 50)] {
            tally.count(&header(sequence, ms, 0));
        }
        tally.count(&header(9, 40, 1));
        let [a, b] = &tally.counted()[..] else { panic!("two writers") };
        assert_eq!((a.seat, a.count, a.gaps, tally.total()), (0, 4, 2, 5));
        assert!((a.hz.unwrap() - 60.0).abs() < 1e-9 && (a.wall_hz.unwrap() - 30.0).abs() < 1e-9);
        assert!((a.shortest_s.unwrap() - 0.01).abs() < 1e-12);
        assert!((a.longest_s.unwrap() - 0.03).abs() < 1e-12);
        assert_eq!((b.count, b.hz, b.shortest_s, b.wall_hz), (1, None, None, None));
    }
}
