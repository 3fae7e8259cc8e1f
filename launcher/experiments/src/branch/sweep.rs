//! Many branches of one flight, on all cores.

use super::{Branch, BranchError, Change};
use crate::campaign::{Axis, Case, Outcome, fly_on};
use observe::{FlightHash, Metrics};
use simulate::fan_out::fan_out;

/// A branch for each case: `change` in all of them, the values of `axes` and perhaps a seed in each.
#[derive(Debug)]
pub struct Sweep<'b> {
    /// Where they begin.
    pub branch: &'b Branch,
    /// Made in every branch.
    pub change: &'b Change,
    /// What varies.
    pub axes: &'b [Axis],
    /// Draw from the streams of each case's seed; otherwise everything random goes on as recorded.
    pub reseed: bool,
}

/// The user ended the sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interrupted;

impl Sweep<'_> {
    /// The change of a case.
    #[must_use]
    pub fn change(&self, case: &Case) -> Change {
        let set = self.change.set.iter().cloned().chain(case.settings(self.axes)).collect();
        let seed = self.reseed.then_some(case.seed);
        Change { set, seed, ..self.change.clone() }
    }

    /// Flies every case; `progress` is called after each. Figures are of what is flown from the branch on,
    /// the hash is that of the whole flight. A case that cannot be flown is an outcome.
    ///
    /// # Errors
    /// [`Interrupted`] once `stop` returns true.
    pub fn fly(
        &self,
        cases: &[Case],
        stop: &(dyn Fn() -> bool + Sync),
        progress: &(dyn Fn() + Sync),
    ) -> Result<Vec<Outcome>, Interrupted> {
        let scenario = self.branch.scenario();
        let mut before = (FlightHash::default(), Metrics::of(scenario));
        self.branch.show_before(&mut before);
        before.1.judge_from_here();
        let fly_one = |case: &Case| {
            let seen = before.clone();
            let flown = self
                .begin(case, seen)
                .map(|(mut flight, end_ns)| fly_on(&mut flight, self.branch.at_ns(), end_ns, stop));
            match flown {
                Ok(outcome) => outcome.ok_or(Interrupted),
                Err(error) => Ok(Outcome::refused(&error)),
            }
        };
        fan_out(cases, progress, fly_one)
    }

    fn begin(
        &self,
        case: &Case,
        mut seen: (FlightHash, Metrics),
    ) -> Result<(simulate::in_process::InProcess<(FlightHash, Metrics)>, u64), BranchError> {
        let changed = self.branch.change(&self.change(case))?;
        seen.1.judge_by(&changed.scenario);
        let flight = self.branch.resume(&changed, seen)?;
        Ok((flight, changed.scenario.duration_ns()))
    }
}
