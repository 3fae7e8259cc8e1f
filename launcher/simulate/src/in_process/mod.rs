//! A whole flight in one thread: the components of the processes, behind queues instead of shared
//! memory, with the same executor, the same graph and the same bytes.
//!
//! [`InProcess`] is behind `run --in-process`, campaigns, branches and studies; nothing in it touches
//! the machine but processes of [`Outside`], each in a run namespace of its own, so flights may fly side by
//! side on threads. Open `wires.rs` for the queues, `resume.rs`
//! for a flight taken up in the middle and `perfect_state.rs` for the only component that a real run
//! does not have.

mod checkpoint;
mod compare;
mod director;
mod error;
mod kernel;
mod loops;
mod marks;
mod observer;
mod outside;
mod perfect_state;
mod posts;
mod resume;
mod stepper;
mod tape;
mod timed;
mod wires;

pub use checkpoint::Checkpoint;
pub use compare::{Compare, Difference, Likeness};
pub use error::InProcessError;
pub use kernel::Kernel;
use observe::Observer;
use observer::{SampleTaps, SharedObserver};
pub(crate) use outside::joins_executable;
pub use outside::{ExitReport, Outside};
pub use perfect_state::PerfectState;
pub use tape::Tape;

use core::ops::{Deref, DerefMut};
use scenario::Scenario;
use scenario::orders::OrderReport;
use std::rc::Rc;
use swap::SwapReport;

/// What informs the controllers where the vehicle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StateSource {
    /// The estimator, as in a run.
    Estimator,
    /// The plant itself: what the control loops do without estimation errors. For rigs and studies.
    Truth,
}

/// What is reported at the end of a flight whose slots have changed hands.
#[derive(Debug, Clone, Default)]
pub struct Conclusion {
    /// Every swap.
    pub swaps: Vec<SwapReport>,
    /// Every order to pilot and injector.
    pub orders: Vec<OrderReport>,
    /// What did not go as asked for.
    pub notices: Vec<String>,
    /// Controllers that had to be started again.
    pub recovered: u64,
    /// Processes of controllers that failed.
    pub exits: Vec<ExitReport>,
}

impl Conclusion {
    /// Swaps of the flight's script that were refused or taken back.
    #[must_use]
    pub fn failed_swaps(&self) -> usize {
        self.swaps.iter().filter(|swap| swap.has_failed()).count()
    }
}

/// A flight in progress. What it does is the [`Kernel`]'s, which it dereferences to.
#[derive(Debug)]
pub struct InProcess<O> {
    kernel: Kernel,
    observer: Rc<SharedObserver<O>>,
}

impl<O> Deref for InProcess<O> {
    type Target = Kernel;
    fn deref(&self) -> &Kernel {
        &self.kernel
    }
}

impl<O> DerefMut for InProcess<O> {
    fn deref_mut(&mut self) -> &mut Kernel {
        &mut self.kernel
    }
}

impl<O: Observer> InProcess<O> {
    /// A flight of `scenario` before its first step.
    ///
    /// # Errors
    /// A component that refuses its part of the scenario, or loops that cannot be wired.
    pub fn new(
        scenario: &Scenario,
        state: StateSource,
        observer: O,
    ) -> Result<Self, InProcessError> {
        Self::with_processes(scenario, state, observer, &Outside::of(scenario.settings()))
    }

    /// As [`new`](Self::new), where those that join in flight as processes are started as `outside` sets.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_processes(
        scenario: &Scenario,
        state: StateSource,
        observer: O,
        outside: &Outside,
    ) -> Result<Self, InProcessError> {
        let observer = Rc::new(SharedObserver::new(observer));
        let kernel = Kernel::build(scenario, state, SampleTaps::of(&observer), (None, outside))?;
        Ok(Self { kernel, observer })
    }

    /// A flight of `scenario` that goes on from a checkpoint. The observer sees what is published
    /// from there on.
    ///
    /// # Errors
    /// As [`new`](Self::new), and a component that refuses its state.
    pub fn resume(
        scenario: &Scenario,
        observer: O,
        checkpoint: &Checkpoint,
    ) -> Result<Self, InProcessError> {
        let observer = Rc::new(SharedObserver::new(observer));
        let kernel = Kernel::resume(scenario, SampleTaps::of(&observer), checkpoint)?;
        Ok(Self { kernel, observer })
    }

    /// Shows the observer nothing from now on, or everything again.
    pub fn look_away(&self, looks_away: bool) {
        self.observer.look_away(looks_away);
    }

    /// What the observer has seen so far.
    pub fn seen<R>(&self, look: impl FnOnce(&mut O) -> R) -> R {
        self.observer.with(look)
    }
}

/// Flies a scenario to its end and gives what `observer` made of it.
///
/// # Errors
/// See [`InProcess::new`] and [`Kernel::fly_until`].
pub fn fly<O: Observer + Default>(
    scenario: &Scenario,
    state: StateSource,
    observer: O,
) -> Result<O, InProcessError> {
    let mut flight = InProcess::new(scenario, state, observer)?;
    flight.fly_until(u64::MAX)?;
    Ok(flight.seen(core::mem::take))
}
