//! A recorded topic as an input: each sample arrives when it did in flight.

use core::cell::Cell;
use runtime::Source;
use runtime::graph::Edge;
use shared_types::{Deviation, DeviationKind, Sample};
use std::collections::BTreeMap;
use std::rc::Rc;

/// How the samples of one input departed from their edge.
#[derive(Debug, Default)]
pub(super) struct Exceptions {
    /// First sequence -> last sequence and the step that had them, late.
    late: BTreeMap<u64, (u64, u64)>,
    /// First sequence -> last sequence that never arrived.
    lost: BTreeMap<u64, u64>,
    /// Last sequence that arrived, if it is known.
    last: Option<u64>,
}

impl Exceptions {
    /// Those of one input among the deviations of a process's life.
    pub(super) fn of<'a>(input: &str, deviations: impl Iterator<Item = &'a Deviation>) -> Self {
        let mut exceptions = Self::default();
        for deviation in deviations.filter(|d| d.input_name() == input) {
            let Deviation { first, last, .. } = *deviation;
            let step_ns = deviation.header.release_ns;
            match deviation.kind {
                DeviationKind::LateSamples => {
                    exceptions.late.insert(first, (last, step_ns));
                }
                DeviationKind::LostSamples => {
                    exceptions.lost.insert(first, last);
                }
                DeviationKind::Ended => exceptions.last = Some(last),
                _ => {}
            }
        }
        exceptions
    }

    /// The same of a process that was killed when it had `last` in effect.
    pub(super) fn killed_after(self, last: u64) -> Self {
        Self { last: self.last.or(Some(last)), ..self }
    }

    /// True if the sample came when the loop had ended, or never.
    fn came_too_late(&self, sequence: u64) -> bool {
        self.last.is_some_and(|last| sequence > last)
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
}

impl<T> TapeSource<T> {
    pub(super) fn new(
        samples: Rc<Vec<T>>,
        edge: Edge,
        exceptions: Exceptions,
        now_ns: Rc<Cell<u64>>,
    ) -> Self {
        Self { samples, next: 0, edge, now_ns, exceptions }
    }
}

impl<T: Sample> Source<T> for TapeSource<T> {
    fn receive(&mut self) -> Option<T> {
        let now_ns = self.now_ns.get();
        loop {
            let sample = *self.samples.get(self.next)?;
            let header = *sample.header();
            if self.exceptions.is_lost(header.sequence) {
                self.next += 1;
                continue;
            }
            if self.exceptions.came_too_late(header.sequence) {
                return None;
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
            return Some(sample);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Header, Imu, Role, topics};

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
            Rc::new((1..=8).map(imu).collect()),
            Edge::unwaited(&topics::IMU.info, Role::Estimator),
            Exceptions::of("imu", deviations.iter()),
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
    fn what_had_not_arrived_at_the_end_never_does() {
        let steps = |played: Vec<Vec<u64>>| played.iter().filter(|s| !s.is_empty()).count();
        assert_eq!(steps(played(&[deviation(DeviationKind::Ended, 9, 5, 5)])), 5);
        assert_eq!(steps(played(&[deviation(DeviationKind::Ended, 9, 0, 0)])), 0);
    }
}
