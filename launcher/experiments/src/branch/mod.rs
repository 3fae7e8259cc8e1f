//! `morphquad replay FILE --branch @TICK`: a recorded flight taken up in the middle, as it was or with
//! something changed, once or many times over.
//!
//! [`Branch::prepare`] restores every component from the last recorded states, flies on to the tick
//! and compares what it repeats with the recording; from there [`Branch::resume`] goes on. [`At`] is
//! the tick, `change` what may be changed in flight, [`sweep`] the many.

mod at;
mod change;
mod deviations;
mod fly;
pub mod sweep;

pub use at::At;
pub use change::{Change, ChangeError};
pub use fly::{FlownBranch, run_branch};

use deviations::Deviations;
use miette::Diagnostic;
use observe::Observer;
use runtime::graph::CREDIT_NS;
use scenario::Scenario;
use shared_types::{ClockMode, Role, topics};
use simulate::in_process::{
    Checkpoint, Compare, Difference, InProcess, InProcessError, Likeness, StateSource, Tape,
};
use std::sync::Arc;
use thiserror::Error;

/// A recorded flight, ready to go on from one instant.
#[derive(Debug)]
pub struct Branch {
    scenario: Scenario,
    from: From,
    recorded_ns: u64,
}

/// What a branch goes on from.
#[derive(Debug)]
enum From {
    /// The states of all services.
    States(Box<Checkpoint>),
    /// The beginning: slots change hands in the flight, or its loops take time. Which process sits where, waits or
    /// shadows, and which samples are on the way, then follows from its script alone. It is flown again up to the
    /// instant, which has been compared.
    Script {
        /// What was recorded.
        tape: Arc<Tape>,
        /// What was published before the instant.
        before: Arc<Tape>,
        /// The instant \[ns\].
        at_ns: u64,
    },
}

/// Why a flight cannot be taken up.
#[derive(Debug, Error, Diagnostic)]
pub enum BranchError {
    /// The instant is not in the flight.
    #[error(
        "the flight is completely recorded up to {recorded_s} s, and the branch is to begin at {at_s} s"
    )]
    #[diagnostic(help(
        "name an instant before its end: --branch @12.5s, or @1234 for a plant tick"
    ))]
    Beyond {
        /// Asked for \[s\].
        at_s: f64,
        /// End of the recording \[s\].
        recorded_s: f64,
    },
    /// Not the flight that was recorded.
    #[error(
        "flown again from the states before the branch, the flight is another one: {difference}"
    )]
    #[diagnostic(help("{remedy}"))]
    NotRepeated {
        /// Where it departs first.
        difference: Difference,
        /// What to do.
        remedy: &'static str,
    },
    /// Slots changed hands by orders, or in time with the wall.
    #[error("slots change hands in this flight, and not by a script in lockstep alone")]
    #[diagnostic(help(
        "fly it again with --swap and --fault at the instants in its summary, with --clock \
         lockstep, and branch from that recording"
    ))]
    NoScript,
    /// A change that cannot be made.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Change(#[from] ChangeError),
    /// A component refuses, or fails.
    #[error(transparent)]
    #[diagnostic(help(
        "what a component remembers must fit its settings: leave this change away, or fly it from \
         the start with `morphquad run --set`"
    ))]
    Flight(#[from] InProcessError),
}

/// Why a realtime flight may not be repeated.
const REALTIME: &str = "a realtime flight with misses cannot be repeated in lockstep there: branch at \
                        another instant, or from a lockstep recording";
/// Why any other may not.
const OTHER_BUILD: &str = "the recording was changed or is of a build that flies otherwise: \
                           `morphquad replay FILE --verify` shows where";

impl Branch {
    /// Takes a flight up at `at`; not `complete` if its recording ends early.
    ///
    /// # Errors
    /// [`BranchError`].
    pub fn prepare(
        scenario: Scenario,
        tape: Arc<Tape>,
        complete: bool,
        at: At,
    ) -> Result<Self, BranchError> {
        let graph = scenario.graph().map_err(InProcessError::from)?;
        let at_ns = at.instant_ns(graph.node(Role::Plant).map(|plant| plant.rate));
        let last = tape.samples(&topics::TRUTH).last();
        let end_ns = last.map_or(0, |truth| truth.header.release_ns.saturating_add(1));
        // The recorder takes the topics in turn: at a cut, one may be this far behind another.
        let recorded_ns = if complete { end_ns } else { end_ns.saturating_sub(CREDIT_NS + 1) };
        if at_ns >= recorded_ns {
            let (at_s, recorded_s) = (at_ns as f64 / 1e9, recorded_ns as f64 / 1e9);
            return Err(BranchError::Beyond { at_s, recorded_s });
        }
        let realtime = ClockMode::from(scenario.settings().scenario.clock) == ClockMode::Realtime;
        let scripted = scenario.settings().is_more_than_states();
        if realtime && scripted
            || !scripted && tape.samples(&topics::SEATING).iter().any(|s| s.seat > 0)
        {
            return Err(BranchError::NoScript);
        }
        let remedy = if realtime { REALTIME } else { OTHER_BUILD };
        if scripted {
            let before = fly_script(&scenario, &tape, recorded_ns, at_ns)?;
            let difference = before.0.first;
            if let Some(difference) = difference {
                return Err(BranchError::NotRepeated { difference, remedy });
            }
            let from = From::Script { tape, before: Arc::new(before.1), at_ns };
            return Ok(Self { scenario, from, recorded_ns });
        }
        let compare = Compare::with(Arc::clone(&tape), recorded_ns);
        let before = Checkpoint::before(Arc::clone(&tape), at_ns);
        let seen = (compare, Deviations::default());
        let mut flight = InProcess::resume(&scenario, seen, &before)?;
        let begun = flight.marks_ns();
        flight.repeat(&tape, at_ns);
        flight.fly_until(at_ns)?;
        let difference_of = |(role, from_ns): (Role, u64)| {
            flight.seen(|(_, deviations)| deviations.difference(&tape, role, (from_ns, at_ns)))
        };
        let difference = flight.seen(|(compare, _)| compare.verdict(at_ns).first);
        if let Some(difference) = difference.or_else(|| begun.into_iter().find_map(difference_of)) {
            return Err(BranchError::NotRepeated { difference, remedy });
        }
        let from = From::States(Box::new(flight.checkpoint(tape, at_ns)));
        Ok(Self { scenario, from, recorded_ns })
    }

    /// Where it begins \[ns\].
    #[must_use]
    pub fn at_ns(&self) -> u64 {
        match &self.from {
            From::States(checkpoint) => checkpoint.at_ns(),
            From::Script { at_ns, .. } => *at_ns,
        }
    }

    /// As it was recorded.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// What was recorded.
    #[must_use]
    pub fn tape(&self) -> &Arc<Tape> {
        match &self.from {
            From::States(checkpoint) => checkpoint.tape(),
            From::Script { tape, .. } => tape,
        }
    }

    /// Shows an observer what was published before the branch.
    pub fn show_before<O: Observer>(&self, observer: &mut O) {
        match &self.from {
            From::States(checkpoint) => checkpoint.tape().show_before(self.at_ns(), observer),
            From::Script { before, .. } => before.show_all(observer),
        }
    }

    /// Everything released before is on the tape \[ns\].
    #[must_use]
    pub fn recorded_ns(&self) -> u64 {
        self.recorded_ns
    }

    /// True if the changed scenario is that of the whole flight: a swap is one more line of its script.
    #[must_use]
    pub fn is_whole(&self, change: &Change) -> bool {
        matches!(self.from, From::Script { .. }) && change.seed.is_none()
    }

    /// A flight that goes on with a change; what `observer` has not seen of it lies before.
    ///
    /// # Errors
    /// [`BranchError`]: the change cannot be made in flight, or a component refuses its state.
    pub fn resume<O: Observer>(
        &self,
        changed: &Changed,
        observer: O,
    ) -> Result<InProcess<O>, BranchError> {
        let mut flight = match &self.from {
            From::States(checkpoint) => InProcess::resume(&changed.scenario, observer, checkpoint)?,
            From::Script { at_ns, .. } => {
                let flight = InProcess::new(&changed.scenario, StateSource::Estimator, observer);
                let mut flight = flight?;
                flight.look_away(true);
                flight.fly_until(*at_ns)?;
                flight.look_away(false);
                flight
            }
        };
        if let Some(seed) = changed.seed {
            flight.reseed(seed);
        }
        Ok(flight)
    }

    /// The scenario with a change made at the branch.
    ///
    /// # Errors
    /// [`ChangeError`].
    pub fn change(&self, change: &Change) -> Result<Changed, ChangeError> {
        let scenario = change.apply(&self.scenario, self.at_ns())?;
        Ok(Changed { scenario, seed: change.seed })
    }
}

/// Flies a scripted flight up to an instant: how it compares with the recording, and all of it.
fn fly_script(
    scenario: &Scenario,
    tape: &Arc<Tape>,
    recorded_ns: u64,
    at_ns: u64,
) -> Result<(Likeness, Tape), BranchError> {
    let seen = (Compare::with(Arc::clone(tape), recorded_ns), Tape::default());
    let mut flight = InProcess::new(scenario, StateSource::Estimator, seen)?;
    flight.fly_until(at_ns)?;
    // What is late has not been published by then.
    let flown_ns = flight.flown_ns().min(at_ns);
    let (compare, before) = flight.seen(core::mem::take);
    Ok((compare.verdict(flown_ns), before))
}

/// What is flown from the branch on.
#[derive(Debug, Clone)]
pub struct Changed {
    /// With everything that was changed.
    pub scenario: Scenario,
    seed: Option<u64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::time::Duration;
    use observe::FlightHash;
    use scenario::Override;
    use scenario::services::names_for;
    use shared_types::Slot;
    use simulate::in_process::StateSource;

    fn record(name: &str, duration: Duration) -> (Scenario, String, Arc<Tape>) {
        let scenario = Scenario::load(name, &[Override::duration(duration)]).unwrap();
        let seen = (FlightHash::default(), Tape::default());
        let mut flight = InProcess::new(&scenario, StateSource::Estimator, seen).unwrap();
        flight.fly_until(u64::MAX).unwrap();
        let (hash, tape) = flight.seen(core::mem::take);
        (scenario, hash.hex(), Arc::new(tape))
    }

    /// Hash of the whole flight and where it departs from the tape.
    fn fly(branch: &Branch, change: &Change) -> (String, Option<Difference>) {
        let mut hash = FlightHash::default();
        branch.show_before(&mut hash);
        let compare = Compare::with(Arc::clone(branch.tape()), branch.recorded_ns());
        let changed = branch.change(change).unwrap();
        let mut flight = branch.resume(&changed, (hash, compare)).unwrap();
        flight.fly_until(u64::MAX).unwrap();
        let flown_ns = flight.flown_ns();
        let (hash, compare) = flight.seen(core::mem::take);
        (hash.hex(), compare.verdict(flown_ns).first)
    }

    #[test]
    fn taken_up_between_any_two_steps_it_is_the_same_flight() {
        let (scenario, hash, tape) = record("figure8-morph", Duration::from_millis(1500));
        for at_ns in [0, 1, 1_000_000, 333_333_333, 500_000_000, 789_012_345, 1_498_999_999] {
            let branch =
                Branch::prepare(scenario.clone(), Arc::clone(&tape), true, At::Time(at_ns));
            let branch = branch.unwrap();
            assert_eq!(fly(&branch, &Change::default()), (hash.clone(), None), "{at_ns}");
        }
        let beyond = Branch::prepare(scenario, tape, true, At::Time(1_500_000_000)).unwrap_err();
        assert!(matches!(beyond, BranchError::Beyond { .. }));
    }

    #[test]
    fn a_slot_given_to_another_kind_flies_on_from_what_was_applied() {
        let (scenario, hash, tape) = record("figure8-morph", Duration::from_secs(3));
        let branch = Branch::prepare(scenario, tape, true, At::Time(1_500_000_000)).unwrap();
        let others = |slot: Slot| {
            let names = names_for(slot.role()).skip(1);
            names.map(move |name| format!("{}={name}", slot.label()))
        };
        for swap in Slot::ALL.into_iter().flat_map(others) {
            let change = Change { swap: vec![swap.clone()], ..Change::default() };
            let (other, first) = fly(&branch, &change);
            assert_ne!(other, hash, "{swap}");
            assert!(first.unwrap().release_ns >= 1_500_000_000, "{swap}");
            let seen = (observe::Metrics::default(), Tape::default());
            let changed = branch.change(&change).unwrap();
            let mut flight = branch.resume(&changed, seen).unwrap();
            flight.fly_until(u64::MAX).unwrap();
            let (metrics, flown) = flight.seen(core::mem::take);
            assert_eq!((metrics.violations(), metrics.gate().refused_wrong_owner), (0, 0));
            let commands = flown.samples(&topics::WRENCH_COMMAND);
            let before = branch.tape().samples(&topics::WRENCH_COMMAND);
            let last = before.iter().rfind(|c| c.header.release_ns < 1_500_000_000).unwrap();
            // The sequence goes on, and so does the torque: within a fifth of roll's bound of 0.056 N m.
            assert_eq!(commands[0].header.sequence, last.header.sequence + 1, "{swap}");
            let jump = (commands[0].torque_b_nm[0] - last.torque_b_nm[0]).abs();
            assert!(jump <= 0.011, "{swap}: {jump} N m");
        }
        let of_another_slot =
            Change { swap: vec!["attitude=position-pid".to_owned()], ..Change::default() };
        let refusal = branch.change(&of_another_slot).unwrap_err();
        assert!(matches!(refusal, ChangeError::Swap { .. }));
    }

    #[test]
    fn a_change_departs_from_the_tape_at_the_branch_and_not_before() {
        let (scenario, hash, tape) = record("hover", Duration::from_secs(1));
        let branch = Branch::prepare(scenario, tape, true, At::Tick(612)).unwrap();
        let set = vec!["plant.mismatch.mass_scale=1.2".to_owned()];
        let (other, first) = fly(&branch, &Change { set, ..Change::default() });
        assert_ne!(other, hash);
        assert!((612_000_000..615_000_000).contains(&first.unwrap().release_ns));
    }
}
