//! What sees a flight.

use crate::{FlightHash, LogHash, Metrics};
use shared_types::{Header, Role, Sample, Topic};

/// Sees every sample of a flight, in the order published.
pub trait Observer: 'static {
    /// Called once per sample. Allocations made here are the observer's own.
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T);
    /// False if no observer wants states, which then are not published; asked once, at the start.
    fn wants_states(&self) -> bool {
        false
    }
    /// False if no observer wants the state with this header, which then is not packed.
    fn wants_state(&self, _role: Role, _header: &Header) -> bool {
        true
    }
    /// Called once per published state, after the samples of its step.
    fn observe_state(&mut self, _role: Role, _header: &Header, _state: &[u8]) {}
    /// Called with a state that a process goes on from, or the last of one, which may have been published and not wanted.
    fn keep_state(&mut self, _role: Role, _header: &Header, _state: &[u8]) {}
    /// Called before a sample is published, and may change it: what a spoiled controller would have published.
    fn alter<T: Sample>(&mut self, _topic: &'static Topic<T>, _sample: &mut T) {}
    /// Called for each event of the flight, as text.
    fn note(&mut self, _logical_ns: u64, _warning: bool, _text: &str) {}
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
    fn alter<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &mut T) {
        self.0.alter(topic, sample);
        self.1.alter(topic, sample);
    }
    fn wants_states(&self) -> bool {
        self.0.wants_states() || self.1.wants_states()
    }
    fn wants_state(&self, role: Role, header: &Header) -> bool {
        (self.0.wants_states() && self.0.wants_state(role, header))
            || (self.1.wants_states() && self.1.wants_state(role, header))
    }
    fn observe_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        self.0.observe_state(role, header, state);
        self.1.observe_state(role, header, state);
    }
    fn keep_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        self.0.keep_state(role, header, state);
        self.1.keep_state(role, header, state);
    }
    fn note(&mut self, logical_ns: u64, warning: bool, text: &str) {
        self.0.note(logical_ns, warning, text);
        self.1.note(logical_ns, warning, text);
    }
}
