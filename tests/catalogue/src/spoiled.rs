//! A service that wraps a shipped controller and applies a fault to its commands.

use crate::altering::{spoil_setpoint, spoil_wrench};
use crate::received::pass_on;
use crate::{Entry, Fault, Seen, Spoiler};
use components::ServiceVisitor;
use controller::attitude::Inputs as AttitudeInputs;
use core::convert::Infallible;
use host::{HostError, Joined};
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::{Component, Ending, Output, OutputSet as _, OutputVisitor, Service};
use shared_types::{AppliedSetpoint, AttitudeSetpoint, Sample, Topic, WrenchCommand};
use std::any::Any;

/// A service that passes its outputs through a [`Spoiler`].
#[derive(Debug)]
pub struct Spoiled<S: Service> {
    inner: S,
    spoiler: Spoiler,
    period_ns: u64,
    /// Monotonic wall-clock instant of the first command, for [`Fault::LateStart`] \[ns\].
    first_command_mono_ns: Option<u64>,
    /// What the controller receives, where its fault lies in that.
    received: S::Inputs,
}

impl<S: Service> Spoiled<S> {
    /// Wraps a controller with the period `period_ns` \[ns\].
    pub fn new(inner: S, spoiler: Spoiler, period_ns: u64) -> Self {
        let received = S::Inputs::default();
        Self { inner, spoiler, period_ns, first_command_mono_ns: None, received }
    }

    /// Sleeps as the timing faults require.
    fn dawdle(&mut self) {
        let Entry { fault, amount, .. } = *self.spoiler.entry();
        let now_ns = mono_now_ns();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let ns = |value: f64| value as u64;
        match fault {
            Fault::Slow => {
                sleep_until(now_ns + ns(amount * self.period_ns as f64));
            }
            Fault::LateStart => {
                let first_command_ns =
                    *self.first_command_mono_ns.get_or_insert(now_ns + ns(amount * 1e9));
                sleep_until(first_command_ns);
            }
            _ => {}
        }
    }
}

/// Applies the fault to the outputs of a step.
struct Spoil<'a> {
    spoiler: &'a mut Spoiler,
    now_ns: u64,
    seen: Seen,
}

impl OutputVisitor for Spoil<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        _topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        let Some(mut sample) = output.written().copied() else { return Ok(()) };
        let any: &mut dyn Any = &mut sample;
        if let Some(command) = any.downcast_mut::<WrenchCommand>() {
            spoil_wrench(self.spoiler, self.now_ns, command, self.seen);
        } else if let Some(command) = any.downcast_mut::<AttitudeSetpoint>() {
            spoil_setpoint(self.spoiler, self.now_ns, command, self.seen);
        } else if let Some(report) = any.downcast_mut::<AppliedSetpoint>() {
            *report = self.spoiler.report(self.now_ns, *report);
        } else {
            return Ok(());
        }
        output.write(sample);
        Ok(())
    }
}

impl<S: Service + 'static> Service for Spoiled<S> {
    type Inputs = S::Inputs;
    type Outputs = S::Outputs;
    type Memory = S::Memory;

    fn step(&mut self, now_ns: u64, inputs: &S::Inputs, outputs: &mut S::Outputs) {
        self.dawdle();
        if self.spoiler.ends(now_ns) {
            std::process::exit(0);
        }
        if self.spoiler.is_silent(now_ns) {
            return self.inner.step(now_ns, inputs, &mut S::Outputs::default());
        }
        if let Some(received) = self.spoiler.receives(now_ns) {
            pass_on(now_ns, received, inputs, &mut self.received);
            self.inner.step(now_ns, &self.received, outputs);
        } else {
            self.inner.step(now_ns, inputs, outputs);
        }
        let seen = seen(inputs);
        let Ok(()) = outputs.visit(&mut Spoil { spoiler: &mut self.spoiler, now_ns, seen });
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
}

/// Tilt and morph rate of the latest estimate; zero before the first one.
fn seen(inputs: &dyn Any) -> Seen {
    let attitude = inputs.downcast_ref::<AttitudeInputs>();
    let attitude = attitude.and_then(|inputs| inputs.state_estimate.latest());
    let position = inputs.downcast_ref::<controller::position::Inputs>();
    let position = position.and_then(|inputs| inputs.state_estimate.latest());
    attitude.or(position).map(Seen::from).unwrap_or_default()
}

/// Wraps a shipped controller in a [`Spoiled`] service and runs it.
#[derive(Debug)]
pub struct Builder {
    /// A process that has joined its run.
    pub joined: Joined,
    /// Fault to apply.
    pub entry: Entry,
    /// Largest command of the slot: the weight \[N\], then torques \[N m\] or angles \[rad\].
    pub largest: [f64; 4],
    /// Period of the slot's loop \[ns\].
    pub period_ns: u64,
}

impl ServiceVisitor for Builder {
    type Output = Result<Ending, HostError>;
    fn visit<S: Service + 'static>(self, service: S, state_every: u64) -> Self::Output {
        let spoiler = Spoiler::new(self.entry, self.largest);
        let service = Spoiled::new(service, spoiler, self.period_ns);
        self.joined.fly(Component::new(service, state_every))
    }
}
