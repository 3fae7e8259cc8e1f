//! A recorded topic as an input: each sample arrives when it did in flight.

use core::cell::Cell;
use runtime::Source;
use runtime::graph::Edge;
use shared_types::{Author, Deviation, DeviationKind, Header, Sample, Stamped};
use std::collections::BTreeMap;
use std::rc::Rc;

/// How the samples of one input departed from their edge.
#[derive(Debug, Default)]
pub(super) struct Exceptions {
    /// First sequence -> last sequence and the step that had them, late.
    late: BTreeMap<u64, (u64, u64)>,
    /// First sequence -> last sequence that never arrived.
    lost: BTreeMap<u64, u64>,
    /// Step, first sequence and writer, in the order of the steps.
    writers: Vec<(u64, u64, Author)>,
}

impl Exceptions {
    /// Those of one input among the deviations of a process's life.
    pub(super) fn of<'a>(input: &str, deviations: impl Iterator<Item = &'a Deviation>) -> Self {
        let mut exceptions = Self::default();
        for deviation in deviations.filter(|d| d.input_name() == input) {
            let Deviation { first, last, author, .. } = *deviation;
            let step_ns = deviation.header.release_ns;
            match deviation.kind {
                DeviationKind::LateSamples => {
                    exceptions.late.insert(first, (last, step_ns));
                }
                DeviationKind::LostSamples => {
                    exceptions.lost.insert(first, last);
                }
                DeviationKind::Writer => exceptions.writers.push((step_ns, first, author)),
                _ => {}
            }
        }
        exceptions
    }

    fn is_lost(&self, sequence: u64) -> bool {
        self.lost.range(..=sequence).next_back().is_some_and(|(_, last)| sequence <= *last)
    }

    /// Step at which a late sample arrived \[ns\].
    fn arrival_ns(&self, sequence: u64) -> Option<u64> {
        let (_, (last, step_ns)) = self.late.range(..=sequence).next_back()?;
        (sequence <= *last).then_some(*step_ns)
    }
}

/// Plays a recorded topic to an input.
pub(super) struct TapeSource<T> {
    samples: Rc<Vec<T>>,
    next: usize,
    edge: Edge,
    /// Step that is about to run \[ns\].
    now_ns: Rc<Cell<u64>>,
    exceptions: Exceptions,
    next_writer: usize,
    /// Writer of what comes next; after a restore that of the latched sample.
    author: Rc<Cell<Author>>,
}

impl<T> TapeSource<T> {
    pub(super) fn new(
        samples: Rc<Vec<T>>,
        edge: Edge,
        exceptions: Exceptions,
        now_ns: Rc<Cell<u64>>,
        author: Rc<Cell<Author>>,
    ) -> Self {
        Self { samples, next: 0, edge, now_ns, exceptions, next_writer: 0, author }
    }

    fn author_of(&mut self, header: &Header) -> Author {
        let now_ns = self.now_ns.get();
        let begun = |(step_ns, first, _): &&(u64, u64, Author)| {
            *step_ns < now_ns || (*step_ns == now_ns && *first <= header.sequence)
        };
        while let Some((_, _, author)) = self.exceptions.writers.get(self.next_writer).filter(begun)
        {
            self.author.set(*author);
            self.next_writer += 1;
        }
        self.author.get()
    }
}

impl<T: Sample> Source<T> for TapeSource<T> {
    fn receive(&mut self) -> Option<Stamped<T>> {
        let now_ns = self.now_ns.get();
        loop {
            let sample = *self.samples.get(self.next)?;
            let header = *sample.header();
            if self.exceptions.is_lost(header.sequence) {
                self.next += 1;
                continue;
            }
            // Nominally a sample is there by the step that it is in effect at.
            let arrived = self.exceptions.arrival_ns(header.sequence).map_or_else(
                || self.edge.in_effect(header.valid_ns, now_ns),
                |step_ns| step_ns <= now_ns,
            );
            if !arrived {
                return None;
            }
            self.next += 1;
            let author = self.author_of(&header);
            return Some(Stamped { sample, author });
        }
    }
}
