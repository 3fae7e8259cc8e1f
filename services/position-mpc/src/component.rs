//! The position MPC as a process: reference and state estimate in, attitude set point out.

use crate::law::{Input, LawStatus, Output, PositionLaw};
use crate::memory::Memory;
use crate::thrust_vector::lift;
use crate::{ConfigError, PositionLawConfig};
use controller::position::{Inputs, Outputs, Tracked};
use controller::preview::{Landing, preview};
use controller::sampling::{age_s, fallback_status, gamma_rad, period_ns};
use nalgebra::Vector3;
use runtime::{Link, Service};
use shared_types::time::ns_from_s;
use shared_types::{BoundedInput, PositionReport, SolveReport, SolveStatus};
use vehicle::VehicleParameters;

shared_types::memory! {
    /// Everything that evolves.
    pub struct ComponentMemory {
        /// The control law's memory.
        pub law: Memory,
        /// Set point that the attitude slot's owner tracks: φ, θ, ψ [rad] and T [N].
        pub applied: [f64; 4],
        /// Whether there is one.
        pub has_applied: bool,
        /// Release of the step that reported it \[ns\].
        pub applied_release_ns: u64,
    }
}

/// The position MPC between its ports.
#[derive(Debug)]
pub struct PositionMpc {
    law: PositionLaw,
    period_s: f64,
    period_ns: u64,
    latency_ns: u64,
    landing: Landing,
    /// Reference over the horizon, reused every step.
    points: Vec<Vector3<f64>>,
    tracked: Tracked,
}

impl PositionMpc {
    /// A controller at trim.
    ///
    /// # Errors
    /// The configuration is impossible.
    pub fn new(
        config: PositionLawConfig,
        vehicle: &VehicleParameters,
        landing: Landing,
    ) -> Result<Self, ConfigError> {
        let period_s = 1.0 / config.rate_hz;
        let period_ns = period_ns(config.rate_hz);
        let latency_ns = ns_from_s(config.setpoint_latency_s);
        let law = PositionLaw::new(config, vehicle)?;
        let points = vec![Vector3::zeros(); law.look_ahead()];
        let tracked = Tracked::default();
        Ok(Self { law, period_s, period_ns, latency_ns, landing, points, tracked })
    }

    fn report(&self, output: &Output) -> PositionReport {
        let memory = self.law.memory();
        let solve = SolveReport {
            fallbacks: memory.counters.fallbacks,
            refused: memory.counters.refused,
            iterations: u64::from(output.iterations),
            active_constraints: u64::from(output.active),
            status: solve_status(output.status),
            yielded: output.yielded,
        };
        let gamma = &output.setpoint.gamma_rad;
        let lift = lift(gamma.x, gamma.y);
        // Tangents of angles and what carries become angles and thrust; a tangent moves by at least what its angle does.
        let angle = |tangent: f64| if tangent.is_finite() { libm::atan(tangent) } else { tangent };
        let flown = |u: Vector3<f64>| [angle(u.x), angle(u.y), u.z / lift];
        let by = |change: Vector3<f64>| [change.x, change.y, change.z / lift];
        let previous = &memory.state[9..];
        let bounded = BoundedInput {
            input: flown(output.command),
            previous: flown(Vector3::new(previous[0], previous[1], previous[2])),
            min: flown(output.command_min),
            max: flown(output.command_max),
            increment_max: by(output.increment_bound),
            relaxation: by(output.relaxation),
        };
        let is_refused = solve.status == SolveStatus::Refused;
        PositionReport { solve, ..if is_refused { bounded.held() } else { bounded }.into() }
    }
}

fn solve_status(status: LawStatus) -> SolveStatus {
    match status {
        LawStatus::Solved => SolveStatus::Solved,
        LawStatus::Fallback(status) => fallback_status(status),
        LawStatus::Refused(_) => SolveStatus::Refused,
    }
}

impl Service for PositionMpc {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = ComponentMemory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.tracked.take(inputs, self.law.has_paused());
        let estimate = inputs.state_estimate.link(now_ns, 2 * self.period_ns);
        let (Link::Fresh(estimate), Some(reference)) = (estimate, inputs.reference.latest()) else {
            // The attitude loop holds the last set point, and flies by itself if none follows.
            self.law.leave_out(1);
            return;
        };
        let yaw_rad = preview(reference, now_ns, self.period_s, &self.landing, &mut self.points);
        let output = self.law.step(&Input {
            position_w_m: estimate.position_w_m.into(),
            velocity_w_m_s: estimate.velocity_w_m_s.into(),
            gamma_rad: gamma_rad(estimate),
            age_s: age_s(estimate, now_ns),
            reference_w_m: &self.points,
            reference_yaw_rad: yaw_rad,
            applied: self.tracked.setpoint,
        });
        outputs.attitude_setpoint.write(output.setpoint.sample());
        outputs.position_report.write(self.report(&output));
    }

    fn track(&mut self, now_ns: u64, inputs: &Inputs) {
        self.tracked.take_shadowing(inputs);
        if let Some(setpoint) = self.tracked.setpoint {
            // That step had received the set points that were one latency old.
            let since_ns = now_ns.saturating_sub(self.tracked.release_ns) + self.latency_ns;
            let periods = since_ns.div_ceil(self.period_ns).saturating_sub(1);
            self.law.track(&setpoint, usize::try_from(periods).unwrap_or(usize::MAX));
        }
    }

    fn skip(&mut self, left_out: u64) {
        self.law.leave_out(left_out);
    }

    fn memory(&self) -> ComponentMemory {
        let (applied, has_applied) = self.tracked.packed();
        let applied_release_ns = self.tracked.release_ns;
        ComponentMemory { law: *self.law.memory(), applied, has_applied, applied_release_ns }
    }

    fn restore(&mut self, memory: &ComponentMemory) -> Result<(), String> {
        self.law.restore(&memory.law).map_err(|error| error.to_string())?;
        let ComponentMemory { applied, has_applied, applied_release_ns, .. } = *memory;
        self.tracked = Tracked::unpacked(applied, has_applied, applied_release_ns);
        Ok(())
    }
}
