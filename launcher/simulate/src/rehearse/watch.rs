//! Takes the snapshot of a flight that is flown in this process.

use crate::in_process::{InProcess, InProcessError, StateSource};
use observe::Observer;
use rehearsal::{Snapshot, Watcher};
use scenario::Scenario;
use shared_types::{Sample, Topic};

/// Passes every published sample to a watcher.
#[derive(Debug, Default)]
struct Watching(Option<Watcher>);

impl Observer for Watching {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        if let Some(watcher) = &mut self.0 {
            watcher.observe_any(sample);
        }
    }
}

/// Flies `scenario` to the instant `at_ns` \[ns\] and returns the snapshot there; `None` if there is no
/// estimate or command yet.
///
/// # Errors
/// If the scenario cannot be flown that far.
pub fn snapshot_of(scenario: &Scenario, at_ns: u64) -> Result<Option<Snapshot>, InProcessError> {
    let watching = Watching(Some(Watcher::new(&scenario.modelled_vehicle())));
    let mut flight = InProcess::new(scenario, StateSource::Estimator, watching)?;
    flight.fly_until(at_ns.saturating_add(1))?;
    Ok(flight.seen(|watching| watching.0.as_ref()?.snapshot(at_ns)))
}
