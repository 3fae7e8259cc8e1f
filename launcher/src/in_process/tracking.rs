//! A controller that takes over from one of another kind.

use runtime::Service;

/// A service whose first step continues from what the slot last applied.
#[derive(Debug)]
pub(super) struct Tracking<S> {
    inner: S,
    /// No step has run yet.
    first: bool,
}

impl<S> Tracking<S> {
    pub(super) fn first(inner: S) -> Self {
        Self { inner, first: true }
    }
}

impl<S: Service> Service for Tracking<S> {
    type Inputs = S::Inputs;
    type Outputs = S::Outputs;
    type Memory = S::Memory;

    fn step(&mut self, now_ns: u64, inputs: &S::Inputs, outputs: &mut S::Outputs) {
        if core::mem::take(&mut self.first) {
            self.inner.track(now_ns, inputs);
        }
        self.inner.step(now_ns, inputs, outputs);
    }

    fn memory(&self) -> S::Memory {
        self.inner.memory()
    }

    fn restore(&mut self, memory: &S::Memory) -> Result<(), String> {
        self.inner.restore(memory)
    }

    fn track(&mut self, now_ns: u64, inputs: &S::Inputs) {
        self.inner.track(now_ns, inputs);
    }

    fn reseed(&mut self, seed: u64) {
        self.inner.reseed(seed);
    }

    fn cause_sequence(&self, inputs: &S::Inputs) -> u64 {
        self.inner.cause_sequence(inputs)
    }
}
