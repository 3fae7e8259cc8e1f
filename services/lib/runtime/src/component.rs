//! A service with its ports and without its type, so that what runs and connects services is compiled once.

use crate::deviations::{ReportEnd, ReportInputs};
use crate::graph::Roles;
use crate::input::{Input, InputCounts, InputSet as _, InputVisitor, Origin};
use crate::output::{Output, OutputSet as _, OutputVisitor};
use crate::service::{Layout, RestoreError, Service, pack_state, unpack_state};
use crate::state_header::StateHeader;
use core::any::Any;
use shared_types::wire::Value as _;
use shared_types::{Header, Sample, Seat, Topic, TopicVisitor};

/// A service with its ports.
pub struct Component {
    parts: Box<dyn Parts>,
    layout: Layout,
    /// Steps from one published state to the next.
    state_every: u64,
}

impl core::fmt::Debug for Component {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Component").field("layout", &self.layout).finish_non_exhaustive()
    }
}

impl Component {
    /// A service whose state is published every `state_every` steps, with ports that lead nowhere yet.
    #[must_use]
    pub fn new<S: Service + 'static>(service: S, state_every: u64) -> Self {
        let (inputs, outputs) = (S::Inputs::default(), S::Outputs::default());
        let parts = Box::new(Typed { service, inputs, outputs });
        Self { parts, layout: Layout::of::<S>(), state_every: state_every.max(1) }
    }

    /// What it reads, writes and remembers.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Its input of a topic, if it reads that.
    pub fn input<T: Sample>(&mut self, topic: &Topic<T>) -> Option<&mut Input<T>> {
        self.parts.input(topic.info.name)?.downcast_mut()
    }

    /// Its output of a topic, if it writes that.
    pub fn output<T: Sample>(&mut self, topic: &Topic<T>) -> Option<&mut Output<T>> {
        self.parts.output(topic.info.name)?.downcast_mut()
    }

    /// Walks the inputs in declaration order.
    ///
    /// # Errors
    /// The visitor's first error.
    pub fn visit_inputs<V: InputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
        let mut each = EachInput { component: self, visitor };
        Layout::visit_topics(each.component.layout.reads(), &mut each)
    }

    /// Walks the outputs in declaration order.
    ///
    /// # Errors
    /// The visitor's first error.
    pub fn visit_outputs<V: OutputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
        let mut each = EachOutput { component: self, visitor };
        Layout::visit_topics(each.component.layout.writes(), &mut each)
    }

    /// Takes what has arrived on every input.
    pub fn receive(&mut self) {
        self.parts.receive();
    }

    /// Sum of all inputs' counters.
    #[must_use]
    pub fn counts(&self) -> InputCounts {
        self.parts.counts()
    }

    /// The state of a predecessor with the same [ports](Layout::ports_hash) and this service's memory in place
    /// of its own: where in the flight it was, what it had latched and sent last. `None` if it is too short.
    #[must_use]
    pub fn succeeding(&self, state: &[u8]) -> Option<Vec<u8>> {
        let ports = self.layout.state_size() - self.layout.memory_size;
        let mut taken = state.get(..ports)?.to_vec();
        let header = StateHeader::unpack(&taken[..StateHeader::PACKED_SIZE]);
        let header = StateHeader { layout_hash: self.layout.hash(), ..header };
        header.pack(&mut taken[..StateHeader::PACKED_SIZE]);
        taken.resize(self.layout.state_size(), 0);
        self.parts.pack_memory(&mut taken[ports..]);
        Some(taken)
    }

    pub(crate) fn state_every(&self) -> u64 {
        self.state_every
    }

    pub(crate) fn parts(&mut self) -> &mut dyn Parts {
        &mut *self.parts
    }

    /// See [`Service::quiet_until_ns`].
    pub(crate) fn quiet_until_ns(&self, from_ns: u64, known_ns: u64) -> u64 {
        self.parts.quiet_until_ns(from_ns, known_ns)
    }

    /// Writes the whole evolving state; `out` holds [`Layout::state_size`] bytes.
    pub fn pack(&self, header: &StateHeader, out: &mut [u8]) {
        self.parts.pack(header, out);
    }
}

/// What is done with a service and its ports, whatever their types.
pub(crate) trait Parts {
    fn input(&mut self, topic: &str) -> Option<&mut dyn Any>;
    fn output(&mut self, topic: &str) -> Option<&mut dyn Any>;
    fn receive(&mut self);
    fn receive_if_moved(&mut self, moved: Roles);
    fn skip_until(&mut self, t_ns: u64);
    fn knows_until(&mut self, t_ns: u64);
    fn take_from(&mut self, first_generations: &[u32; Seat::COUNT]);
    /// See [`Service::skip`].
    fn skip(&mut self, left_out: u64);
    /// See [`Service::quiet_until_ns`].
    fn quiet_until_ns(&self, from_ns: u64, known_ns: u64) -> u64;
    /// Puts into effect what is due and runs the step; gives the origin and the cause of what it has written.
    fn step(&mut self, now_ns: u64, previous_ns: Option<u64>, tracks: bool) -> (Origin, u64);
    /// Stamps and sends what the step has written.
    fn flush(&mut self, header: &Header);
    fn counts(&self) -> InputCounts;
    fn report(&mut self, report: &mut ReportInputs<'_>);
    fn report_end(&mut self, report: &mut ReportEnd<'_>);
    fn serve_late_joiners(&mut self);
    fn reseed(&mut self, seed: u64);
    fn pack(&self, header: &StateHeader, out: &mut [u8]);
    fn unpack(&mut self, from: &[u8]) -> Result<StateHeader, RestoreError>;
    fn pack_memory(&self, out: &mut [u8]);
}

struct Typed<S: Service> {
    service: S,
    inputs: S::Inputs,
    outputs: S::Outputs,
}

impl<S: Service> Parts for Typed<S> {
    fn input(&mut self, topic: &str) -> Option<&mut dyn Any> {
        self.inputs.by_topic(topic)
    }
    fn output(&mut self, topic: &str) -> Option<&mut dyn Any> {
        self.outputs.by_topic(topic)
    }
    fn receive(&mut self) {
        self.inputs.receive();
    }
    fn receive_if_moved(&mut self, moved: Roles) {
        self.inputs.receive_if_moved(moved);
    }
    fn skip_until(&mut self, t_ns: u64) {
        self.inputs.skip_until(t_ns);
    }
    fn knows_until(&mut self, t_ns: u64) {
        self.inputs.knows_until(t_ns);
    }
    fn take_from(&mut self, first_generations: &[u32; Seat::COUNT]) {
        self.inputs.take_from(first_generations);
    }
    fn skip(&mut self, left_out: u64) {
        self.service.skip(left_out);
    }
    fn quiet_until_ns(&self, from_ns: u64, known_ns: u64) -> u64 {
        self.service.quiet_until_ns(from_ns, known_ns, &self.inputs)
    }
    fn step(&mut self, now_ns: u64, previous_ns: Option<u64>, tracks: bool) -> (Origin, u64) {
        let Self { service, inputs, outputs } = self;
        inputs.accept(now_ns, previous_ns);
        if tracks || service.is_displaced(inputs) {
            service.track(now_ns, inputs);
        }
        service.step(now_ns, inputs, outputs);
        (inputs.origin(), service.cause_sequence(inputs))
    }
    fn flush(&mut self, header: &Header) {
        self.outputs.flush(header);
    }
    fn counts(&self) -> InputCounts {
        self.inputs.counts()
    }
    fn report(&mut self, report: &mut ReportInputs<'_>) {
        let Ok(()) = self.inputs.visit(report);
    }
    fn report_end(&mut self, report: &mut ReportEnd<'_>) {
        let Ok(()) = self.inputs.visit(report);
    }
    fn serve_late_joiners(&mut self) {
        self.outputs.serve_late_joiners();
    }
    fn reseed(&mut self, seed: u64) {
        self.service.reseed(seed);
    }
    fn pack(&self, header: &StateHeader, out: &mut [u8]) {
        pack_state(&self.service, header, &self.inputs, &self.outputs, out);
    }
    fn unpack(&mut self, from: &[u8]) -> Result<StateHeader, RestoreError> {
        unpack_state(&mut self.service, &mut self.inputs, &mut self.outputs, from)
    }
    fn pack_memory(&self, out: &mut [u8]) {
        self.service.memory().pack(out);
    }
}

/// Shows the input of each topic to a visitor.
struct EachInput<'a, V> {
    component: &'a mut Component,
    visitor: &'a mut V,
}

impl<V: InputVisitor> TopicVisitor for EachInput<'_, V> {
    type Error = V::Error;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), V::Error> {
        self.component.input(topic).map_or(Ok(()), |input| self.visitor.visit(topic, input))
    }
}

/// Shows the output of each topic to a visitor.
struct EachOutput<'a, V> {
    component: &'a mut Component,
    visitor: &'a mut V,
}

impl<V: OutputVisitor> TopicVisitor for EachOutput<'_, V> {
    type Error = V::Error;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), V::Error> {
        self.component.output(topic).map_or(Ok(()), |output| self.visitor.visit(topic, output))
    }
}
