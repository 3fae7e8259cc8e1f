//! A loop of a flight in one process with its type forgotten: an executor, or a process of its own.

use super::ExitReport;
use super::checkpoint::Feed;
use replay::Repeats;
use runtime::executor::StepStamps;
use runtime::{Executor, RestoreError};
use shared_types::{Handover, Seat};

/// What a loop is given about the flight when it is to step.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepContext<'a> {
    /// Reads the host clock.
    pub(super) now_mono_ns: fn() -> u64,
    /// Steps from here on may not run yet, whatever the marks are \[ns\].
    pub(super) allowed_ns: u64,
    /// How far all others have got; empty unless [`Stepper::is_outside`].
    pub(super) instances: &'a [InstanceMark],
}

/// How far one loop has got.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct InstanceMark {
    pub(super) place: Seat,
    pub(super) generation: u32,
    pub(super) period_ns: u64,
    pub(super) mark_ns: u64,
}

/// A loop with its type forgotten: an executor, or a process of its own.
pub(super) trait Stepper: Repeats {
    /// True if the loop is a process, which needs to be informed of all others.
    fn is_outside(&self) -> bool {
        false
    }
    /// What runs its releases, if the loop is no process.
    fn executor(&mut self) -> Option<&mut Executor> {
        None
    }
    /// True if the process of the loop has failed.
    fn has_failed(&self) -> bool {
        false
    }
    /// What has become of it then; reported once.
    fn take_failure(&mut self) -> Option<ExitReport> {
        None
    }
    /// Begins where a hand-over states, in a flight whose loops have got so far.
    fn begin(
        &mut self,
        order: &Handover,
        state: &[u8],
        instances: &[InstanceMark],
    ) -> Result<(), RestoreError>;
    fn layout(&self) -> u64;
    /// Runs the next release; false if the loop has failed, and has not.
    fn step(&mut self, context: &StepContext<'_>) -> bool;
    fn finish(&mut self);
    fn state(&mut self) -> Option<Vec<u8>>;
    fn ports(&self) -> u64;
    fn reseed(&mut self, seed: u64);
    fn feed(&mut self, feed: &mut Feed<'_>);
}

impl Stepper for Executor {
    fn executor(&mut self) -> Option<&mut Executor> {
        Some(self)
    }
    fn begin(
        &mut self,
        order: &Handover,
        state: &[u8],
        _instances: &[InstanceMark],
    ) -> Result<(), RestoreError> {
        Self::begin(self, order, state)
    }
    fn layout(&self) -> u64 {
        self.component.layout().hash()
    }
    fn step(&mut self, context: &StepContext<'_>) -> bool {
        self.component.receive();
        self.run_step(StepStamps::at_once(context.now_mono_ns));
        true
    }
    fn finish(&mut self) {
        // One that was stopped all the time has nothing to report.
        if self.steps() > 0 {
            Self::finish(self);
        }
    }
    fn state(&mut self) -> Option<Vec<u8>> {
        Self::state(self).map(<[u8]>::to_vec)
    }
    fn ports(&self) -> u64 {
        self.component.layout().ports_hash()
    }
    fn reseed(&mut self, seed: u64) {
        Self::reseed(self, seed);
    }
    fn feed(&mut self, feed: &mut Feed<'_>) {
        let Ok(()) = self.component.visit_inputs(feed);
    }
}
