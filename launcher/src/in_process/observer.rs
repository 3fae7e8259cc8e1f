//! Who looks on while a flight is flown.

use crate::run::{FlightHash, LogHash, Metrics};
use shared_types::{Header, Role, Sample, Topic};

/// Sees every sample of a flight, in the order published.
pub trait Observer: 'static {
    /// Called once per sample. Allocations made here are the observer's own.
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T);
    /// False if nobody wants states, which then are not published; asked once, at the start.
    fn wants_states(&self) -> bool {
        false
    }
    /// Called once per published state, after the samples of its step.
    fn observe_state(&mut self, _role: Role, _header: &Header, _state: &[u8]) {}
}

impl Observer for () {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, _sample: &T) {}
}

impl Observer for FlightHash {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.add(&topic.info, sample);
    }
}

impl Observer for LogHash {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.add(&topic.info, sample);
    }
}

impl Observer for Metrics {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        Self::observe(self, topic, sample);
    }
}

impl<A: Observer, B: Observer> Observer for (A, B) {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.0.observe(topic, sample);
        self.1.observe(topic, sample);
    }
    fn wants_states(&self) -> bool {
        self.0.wants_states() || self.1.wants_states()
    }
    fn observe_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        self.0.observe_state(role, header, state);
        self.1.observe_state(role, header, state);
    }
}
