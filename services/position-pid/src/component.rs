//! The position PID as a process: reference and state estimate in, attitude set point out.

use crate::law::{Input, Memory, Output, PositionPidConfig, PositionPidLaw};
use controller::OutOfRange;
use controller::position::{Inputs, Outputs, Tracked};
use controller::preview::{Landing, target};
use controller::sampling::{age_s, gamma_rad, period_ns};
use runtime::{Link, Service};
use shared_types::PositionReport;
use vehicle::VehicleParameters;

shared_types::memory! {
    /// Everything that evolves.
    pub struct ComponentMemory {
        /// The control law's memory.
        pub law: Memory,
        /// Set point that the attitude slot's owner tracks: φ, θ, ψ \[rad\] and T \[N\].
        pub applied: [f64; 4],
        /// Whether there is one.
        pub has_applied: bool,
    }
}

/// The position PID between its ports.
#[derive(Debug)]
pub struct PositionPid {
    law: PositionPidLaw,
    tracked: Tracked,
    lead_s: f64,
    period_ns: u64,
    landing: Landing,
}

impl PositionPid {
    /// A controller at trim.
    ///
    /// # Errors
    /// The configuration is impossible.
    pub fn new(
        config: PositionPidConfig,
        vehicle: &VehicleParameters,
        landing: Landing,
    ) -> Result<Self, OutOfRange> {
        let law = PositionPidLaw::new(config, vehicle)?;
        let period_ns = period_ns(config.rate_hz);
        Ok(Self { law, tracked: Tracked::default(), lead_s: config.lead_s, period_ns, landing })
    }

    fn report(&self, output: &Output) -> PositionReport {
        let solve = output.command.solve(output.is_new, self.law.memory().refused);
        PositionReport { solve, ..output.command.bounded().into() }
    }
}

impl Service for PositionPid {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = ComponentMemory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.tracked.take(inputs, self.law.has_paused());
        let estimate = inputs.state_estimate.link(now_ns, 2 * self.period_ns);
        let (Link::Fresh(estimate), Some(reference)) = (estimate, inputs.reference.latest()) else {
            // The attitude loop holds the last set point, and flies by itself if none follows.
            self.law.miss();
            return;
        };
        let output = self.law.step(&Input {
            position_w_m: estimate.position_w_m.into(),
            velocity_w_m_s: estimate.velocity_w_m_s.into(),
            gamma_rad: gamma_rad(estimate),
            age_s: age_s(estimate, now_ns),
            target: target(reference, now_ns, self.lead_s, &self.landing),
            applied: self.tracked.setpoint,
        });
        outputs.attitude_setpoint.write(output.setpoint.sample());
        outputs.position_report.write(self.report(&output));
    }

    fn track(&mut self, _now_ns: u64, inputs: &Inputs) {
        self.tracked.take_shadowing(inputs);
        if self.tracked.setpoint.is_some() {
            self.law.track();
        }
    }

    fn skip(&mut self, _left_out: u64) {
        // What was wished for before is not what has been applied since.
        self.law.miss();
    }

    fn memory(&self) -> ComponentMemory {
        let (applied, has_applied) = self.tracked.packed();
        ComponentMemory { law: *self.law.memory(), applied, has_applied }
    }

    fn restore(&mut self, memory: &ComponentMemory) -> Result<(), String> {
        self.law.restore(&memory.law)?;
        // Nothing in this law depends on when it was reported.
        self.tracked = Tracked::unpacked(memory.applied, memory.has_applied, 0);
        Ok(())
    }
}
