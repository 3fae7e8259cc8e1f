//! When the steps of a recorded loop ran, and what happened to the loop between them.

use runtime::{Executor, Rate, Service};
use shared_types::{Deviation, DeviationKind};
use std::collections::BTreeMap;

/// What a loop went through that no edge tells: releases left out or caught up, deadlines missed.
#[derive(Debug, Default)]
pub(crate) struct Course {
    /// Releases left out, by the instant of the first \[ns\].
    skips: BTreeMap<u64, Deviation>,
    /// What else happened to the loop before a step, by the step's instant \[ns\].
    before: BTreeMap<u64, Vec<Deviation>>,
}

/// A loop that can go through it again.
pub(crate) trait Repeats {
    /// Instant of the next release \[ns\].
    fn next_ns(&self) -> u64;
    /// See [`Executor::repeat`].
    fn repeat(&mut self, deviation: &Deviation);
}

impl<S: Service> Repeats for Executor<S> {
    fn next_ns(&self) -> u64 {
        self.mark_ns()
    }
    fn repeat(&mut self, deviation: &Deviation) {
        Self::repeat(self, deviation);
    }
}

impl Course {
    /// Of a loop at `rate`, from what it told.
    pub(crate) fn new<'a>(rate: Rate, told: impl IntoIterator<Item = &'a Deviation>) -> Self {
        let mut course = Self::default();
        for deviation in told {
            match deviation.kind {
                DeviationKind::SkippedReleases => {
                    course.skips.insert(rate.release_ns(deviation.first), *deviation);
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

    /// Has the loop go through what happened between its last step and the next.
    pub(crate) fn prepare(&self, executor: &mut (impl Repeats + ?Sized)) {
        while let Some(skip) = self.skips.get(&executor.next_ns()) {
            executor.repeat(skip);
        }
        for deviation in self.before.get(&executor.next_ns()).into_iter().flatten() {
            executor.repeat(deviation);
        }
    }
}
