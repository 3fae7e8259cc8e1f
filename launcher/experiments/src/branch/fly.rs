//! A branch that is flown as `run` flies: with a summary and a recording.

use super::{Branch, Changed};
use crate::campaign::Outcome;
use simulate::in_process::{Compare, Difference, Likeness};
use simulate::{FlownAlone, RunError, RunOptions, Sinks, Summary, fly_alone};
use std::sync::Arc;

/// A branch that has been flown.
#[derive(Debug)]
pub struct FlownBranch {
    /// Of the whole flight, what was recorded before the branch included.
    pub summary: Summary,
    /// What was flown since the branch, as a sweep reports it.
    pub since: Outcome,
    /// Samples since the branch that are as recorded.
    pub same: u64,
    /// The first that is not.
    pub first: Option<Difference>,
}

/// Flies a branch of a recorded flight to its end. `origin` states in the recording what it is, and
/// `branched` from where on its scenario holds.
///
/// # Errors
/// [`RunError`] if the flight never started; what happens in flight is in the summary.
pub fn run_branch(
    branch: &Branch,
    changed: &Changed,
    options: &RunOptions,
    origin: &str,
    branched: Option<record::Branched>,
) -> Result<FlownBranch, RunError> {
    let begin = |mut sinks: Sinks| {
        sinks.inform(branch.at_ns(), origin);
        branch.show_before(&mut sinks);
        let mut since = sinks.metrics.clone();
        since.judge_from_here();
        let compare = Compare::with(Arc::clone(branch.tape()), branch.recorded_ns());
        branch
            .resume(changed, (sinks, (compare, since)))
            .map_err(|error| RunError::NotReady(error.to_string()))
    };
    let flown = fly_alone(options, branched, branch.at_ns(), begin)?;
    let FlownAlone { summary, observer: (compare, mut since), hash, error } = flown;
    let Likeness { same, first } = compare.verdict(summary.flown_ns);
    let (flown_ns, failed_swaps) = (summary.flown_ns, summary.failed_swaps());
    let since = Outcome::of_flight(&mut since, &hash, flown_ns, error.as_ref(), failed_swaps);
    Ok(FlownBranch { summary, since, same, first })
}
