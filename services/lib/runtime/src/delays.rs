//! Samples that arrive when a script prescribes, on a clock that a conductor moves.

use crate::graph::Edge;
use crate::graph::MarkView;
use crate::input::Source;
use core::cell::{Cell, RefCell};
use shared_types::{Role, Sample, Seat};
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use timing::{Arrival, Script};

/// Samples of a topic that have not arrived at one reader.
#[derive(Debug, Clone, Copy)]
struct OnTheWay {
    /// When the next one arrives, on the host clock \[ns\].
    arrives_mono_ns: u64,
    /// Release of the oldest \[ns\].
    release_ns: u64,
}

/// The samples on the way, by reader.
#[derive(Debug)]
pub struct Delays {
    script: Rc<Script>,
    now_mono_ns: Cell<u64>,
    /// By reader and topic.
    on_the_way: RefCell<BTreeMap<(Seat, &'static str), OnTheWay>>,
}

impl Delays {
    /// The delays of a script on that clock, before anything has been sent.
    #[must_use]
    pub fn new(script: Rc<Script>) -> Self {
        Self { script, now_mono_ns: Cell::new(0), on_the_way: RefCell::default() }
    }

    /// Moves the clock \[ns\].
    pub fn move_to(&self, now_mono_ns: u64) {
        self.now_mono_ns.set(now_mono_ns);
    }

    /// When the next sample arrives that a loop has not received \[ns\].
    #[must_use]
    pub fn next_arrival_mono_ns(&self, reader: Seat) -> Option<u64> {
        let on_the_way = self.on_the_way.borrow();
        let of_reader = on_the_way.iter().filter(|((seat, _), _)| *seat == reader);
        of_reader.map(|(_, samples)| samples.arrives_mono_ns).min()
    }

    /// What `inner` gives, as it arrives at a loop.
    pub fn delay<T: Sample>(
        self: &Rc<Self>,
        (reader, topic): (Seat, &'static str),
        inner: impl Source<T> + 'static,
    ) -> Box<dyn Source<T>> {
        if self.script.samples().iter().any(|entry| entry.topic == topic) {
            let delays = Rc::clone(self);
            let (held, releases) = (VecDeque::new(), BTreeMap::new());
            Box::new(DelayedSource { inner, delays, reader, topic, held, releases })
        } else {
            Box::new(inner)
        }
    }
}

/// Samples that are held back until they arrive.
struct DelayedSource<T, S> {
    inner: S,
    delays: Rc<Delays>,
    reader: Seat,
    topic: &'static str,
    /// By arrival \[ns\].
    held: VecDeque<(u64, T)>,
    /// How many of them there are of each release \[ns\].
    releases: BTreeMap<u64, u32>,
}

impl<T: Sample, S: Source<T>> DelayedSource<T, S> {
    fn take_in(&mut self) {
        while let Some(sample) = self.inner.receive() {
            let header = sample.header();
            let Arrival { delay_ns, copies } = self.delays.script.arrival(self.topic, header);
            let arrives_mono_ns = header.publish_mono_ns.saturating_add(delay_ns);
            let at = self.held.partition_point(|(other_ns, _)| *other_ns <= arrives_mono_ns);
            for _ in 0..copies {
                self.held.insert(at, (arrives_mono_ns, sample));
            }
            if copies > 0 {
                *self.releases.entry(header.release_ns).or_default() += copies;
            }
        }
    }
}

impl<T: Sample, S: Source<T>> Source<T> for DelayedSource<T, S> {
    fn receive(&mut self) -> Option<T> {
        self.take_in();
        let now_mono_ns = self.delays.now_mono_ns.get();
        let arrived = self.held.pop_front_if(|(arrives_ns, _)| *arrives_ns <= now_mono_ns);
        let key = (self.reader, self.topic);
        let mut on_the_way = self.delays.on_the_way.borrow_mut();
        if let Some((_, sample)) = &arrived
            && let Entry::Occupied(mut copies) = self.releases.entry(sample.header().release_ns)
        {
            *copies.get_mut() -= 1;
            if *copies.get() == 0 {
                copies.remove();
            }
        }
        match (self.held.front(), self.releases.first_key_value()) {
            (Some((arrives_mono_ns, _)), Some((release_ns, _))) => {
                let (arrives_mono_ns, release_ns) = (*arrives_mono_ns, *release_ns);
                on_the_way.insert(key, OnTheWay { arrives_mono_ns, release_ns });
            }
            _ => {
                on_the_way.remove(&key);
            }
        }
        arrived.map(|(_, sample)| sample)
    }
}

/// How far producers have got for one reader: a mark promises no sample that is still on the way.
#[derive(Debug)]
pub struct DelayedMarks<'a, M> {
    /// As they have been announced.
    pub marks: &'a M,
    /// What is on the way.
    pub delays: &'a Delays,
    /// The loop.
    pub reader: Seat,
}

impl<M: MarkView> MarkView for DelayedMarks<'_, M> {
    fn of(&self, edge: &Edge) -> u64 {
        let on_the_way = self.delays.on_the_way.borrow();
        let samples = on_the_way.get(&(self.reader, edge.topic.name));
        let mark_ns = self.marks.of(edge);
        samples.map_or(mark_ns, |samples| mark_ns.min(samples.release_ns))
    }
    fn of_role(&self, role: Role) -> u64 {
        self.marks.of_role(role)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Graph, Marks, MissPolicy, Node};
    use crate::rate::Rate;
    use shared_types::{Header, Imu, topics};
    use timing::{Duration, SampleEffect, SampleEntry, Window};

    const MS: u64 = 1_000_000;
    const READER: Seat = Seat::first(Role::Estimator);

    /// What has been sent, by release and instant of publication \[ms\].
    struct Sent(VecDeque<Imu>);

    impl Sent {
        fn of(releases_ms: &[(u64, u64)]) -> Self {
            let imu = |(&(release_ms, publish_ms), sequence)| {
                let (release_ns, publish_mono_ns) = (release_ms * MS, publish_ms * MS);
                let header = Header { sequence, release_ns, publish_mono_ns, ..Header::default() };
                Imu { header, ..Imu::default() }
            };
            Self(releases_ms.iter().zip(0..).map(imu).collect())
        }
    }

    impl Source<Imu> for Sent {
        fn receive(&mut self) -> Option<Imu> {
            self.0.pop_front()
        }
    }

    /// From one release to right before another \[ms\], what happens to its samples.
    type Entry = (u64, u64, SampleEffect);

    fn delayed(entries: &[Entry], sent: Sent) -> (Rc<Delays>, Box<dyn Source<Imu>>) {
        let topic = topics::IMU.info.name;
        let entry = |(from_ms, until_ms, effect): &Entry| SampleEntry {
            topic: topic.to_owned(),
            window: Window { from_ns: from_ms * MS, until_ns: until_ms * MS },
            effect: effect.clone(),
        };
        let script = Script::new(7, Vec::new(), entries.iter().map(entry).collect());
        let delays = Rc::new(Delays::new(Rc::new(script)));
        let source = delays.delay((READER, topic), sent);
        (delays, source)
    }

    fn late(ms: u64) -> SampleEffect {
        SampleEffect::Late(Duration::Fixed(ms * MS))
    }

    /// Sequences of what has arrived by an instant \[ms\].
    fn arrived(delays: &Delays, source: &mut dyn Source<Imu>, at_ms: u64) -> Vec<u64> {
        delays.move_to(at_ms * MS);
        std::iter::from_fn(|| source.receive()).map(|imu| imu.header.sequence).collect()
    }

    #[test]
    fn samples_come_in_the_order_of_their_arrival_and_at_one_instant_as_they_were_sent() {
        let sent = Sent::of(&[(0, 0), (1, 1), (2, 2), (5, 5)]);
        let (delays, mut source) = delayed(&[(0, 1, late(5)), (2, 3, late(1))], sent);
        assert_eq!(arrived(&delays, &mut *source, 0), []);
        assert_eq!(delays.next_arrival_mono_ns(READER), Some(MS));
        assert_eq!(delays.next_arrival_mono_ns(Seat::first(Role::Monitor)), None);
        assert_eq!(arrived(&delays, &mut *source, 2), [1]);
        assert_eq!(arrived(&delays, &mut *source, 4), [2]);
        assert_eq!(arrived(&delays, &mut *source, 5), [0, 3]);
        assert_eq!(delays.next_arrival_mono_ns(READER), None);
    }

    #[test]
    fn what_is_lost_never_comes_and_what_is_doubled_comes_twice() {
        let sent = Sent::of(&[(0, 0), (1, 1), (2, 2)]);
        let entries = [(0, 1, SampleEffect::Lost), (1, 2, SampleEffect::Duplicated)];
        let (delays, mut source) = delayed(&entries, sent);
        assert_eq!(arrived(&delays, &mut *source, 9), [1, 1, 2]);
    }

    #[test]
    fn a_mark_promises_no_sample_that_is_still_on_the_way() {
        let node = |role| Node {
            role,
            rate: Rate::from_hz(1000.0).unwrap(),
            lead_ns: 0,
            input_deadline_ns: MS,
            miss_policy: MissPolicy::CatchUp,
        };
        let graph = Graph::new(vec![node(Role::Plant), node(Role::Estimator)], &|_| 0).unwrap();
        let edge = graph.edges().iter().find(|edge| edge.topic.name == topics::IMU.info.name);
        let mut marks = Marks::default();
        marks[Role::Plant.index()] = 8 * MS;
        let sent = Sent::of(&[(0, 0), (1, 1), (2, 2)]);
        let entries = [(1, 2, SampleEffect::Duplicated), (1, 3, late(4))];
        let (delays, mut source) = delayed(&entries, sent);
        let seen_ms = |at_ms: u64, source: &mut dyn Source<Imu>| {
            let _ = arrived(&delays, source, at_ms);
            let marks = DelayedMarks { marks: &marks, delays: &delays, reader: READER };
            marks.of(edge.expect("it reads the IMU")) / MS
        };
        assert_eq!([0, 4, 5, 6].map(|at_ms| seen_ms(at_ms, &mut *source)), [1, 1, 2, 8]);
    }
}
