//! Samples that arrive when a script says, on a clock that a conductor moves.

use crate::graph::Edge;
use crate::input::Source;
use crate::ownership::MarkView;
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

/// What is on the way to whom.
#[derive(Debug)]
pub struct Delays {
    script: Rc<Script>,
    now_mono_ns: Cell<u64>,
    /// By reader and topic.
    on_the_way: RefCell<BTreeMap<(Seat, &'static str), OnTheWay>>,
}

impl Delays {
    /// Of what a script on that clock says, before anything has been sent.
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
