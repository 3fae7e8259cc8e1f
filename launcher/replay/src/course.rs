//! When the steps of a recorded loop ran, and what happened to the loop between them.

use runtime::{Executor, Rate};
use shared_types::{Deviation, DeviationKind};
use std::collections::BTreeMap;

/// What a loop went through that no edge shows: releases left out or caught up, deadlines missed.
#[derive(Debug, Default)]
pub struct Course {
    /// Releases left out, by the number of the first.
    skips: BTreeMap<u64, Deviation>,
    /// By which releases are numbered; none of a loop that reported nothing.
    rate: Option<Rate>,
    /// What else happened to the loop before a step, by the step's instant \[ns\].
    before: BTreeMap<u64, Vec<Deviation>>,
}

/// A loop that can go through it again.
pub trait Repeats {
    /// Instant of the next release \[ns\].
    fn next_ns(&self) -> u64;
    /// See [`Executor::repeat`].
    fn repeat(&mut self, deviation: &Deviation);
}

impl Repeats for Executor {
    fn next_ns(&self) -> u64 {
        self.mark_ns()
    }
    fn repeat(&mut self, deviation: &Deviation) {
        Self::repeat(self, deviation);
    }
}

impl Course {
    /// Of a loop at `rate`, from what it reported.
    pub fn new<'a>(rate: Rate, deviations: impl IntoIterator<Item = &'a Deviation>) -> Self {
        let mut course = Self { rate: Some(rate), ..Self::default() };
        for deviation in deviations {
            match deviation.kind {
                DeviationKind::SkippedReleases => {
                    course.skips.insert(deviation.first, *deviation);
                }
                DeviationKind::MissedDeadline | DeviationKind::CaughtUp => {
                    let step_ns = deviation.header.release_ns;
                    course.before.entry(step_ns).or_default().push(*deviation);
                }
                _ => {}
            }
        }
        course
    }

    /// What is left out from an instant on. A loop that joined late reports in one what it left out by joining,
    /// which it has left out again when it gets here, and what it was too late for.
    fn skip_at(&self, next_ns: u64) -> Option<Deviation> {
        let first = self.rate?.first_at_or_after(next_ns);
        let (_, skip) = self.skips.range(..=first).next_back()?;
        (skip.last >= first).then_some(Deviation { first, ..*skip })
    }

    /// Has the loop go through what happened between its last step and the next.
    pub fn prepare(&self, executor: &mut (impl Repeats + ?Sized)) {
        while let Some(skip) = self.skip_at(executor.next_ns()) {
            executor.repeat(&skip);
        }
        for deviation in self.before.get(&executor.next_ns()).into_iter().flatten() {
            executor.repeat(deviation);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Course, Repeats};
    use runtime::Rate;
    use shared_types::{Deviation, DeviationKind};

    const PERIOD_NS: u64 = 10_000_000;

    /// The next release of a loop at 100 Hz.
    struct Loop(u64);

    impl Repeats for Loop {
        fn next_ns(&self) -> u64 {
            self.0 * PERIOD_NS
        }
        fn repeat(&mut self, deviation: &Deviation) {
            assert_eq!(deviation.first, self.0);
            self.0 = deviation.last + 1;
        }
    }

    #[test]
    fn a_loop_that_joined_in_the_middle_of_what_it_left_out_leaves_out_the_rest() {
        let kind = DeviationKind::SkippedReleases;
        let skip = |first, last| Deviation { kind, first, last, ..Deviation::default() };
        let course = Course::new(Rate::from_hz(100.0).unwrap(), &[skip(171, 218), skip(250, 250)]);
        for (at, then) in [(170, 170), (171, 219), (203, 219), (218, 219), (219, 219), (250, 251)] {
            let mut executor = Loop(at);
            course.prepare(&mut executor);
            assert_eq!(executor.0, then, "at {at}");
        }
    }
}
