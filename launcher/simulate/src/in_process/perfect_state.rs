//! The truth in the estimator's place, for rigs and studies.

use runtime::{Component, Service, inputs, outputs};
use shared_types::{Imu, StateEstimate, Truth, topics};

inputs! {
    /// The plant publishes the truth together with its inertial sample, which is the input that
    /// this loop waits for and that its output descends from.
    pub struct Inputs {
        /// Paces the loop.
        imu: Imu = topics::IMU,
        /// What is passed on.
        truth: Truth = topics::TRUTH,
    }
}

outputs! {
    /// What an estimator writes.
    pub struct Outputs {
        /// The truth, with no error.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
    }
}

shared_types::memory! {
    /// Nothing evolves but a counter.
    pub struct Memory {
        /// Steps run so far.
        pub steps: u64,
    }
}

/// Publishes the vehicle's true state as the estimate: no noise, no bias, no delay.
#[derive(Debug, Clone, Copy, Default)]
pub struct PerfectState {
    steps: u64,
}

impl PerfectState {
    pub(super) fn component() -> Component {
        Component::new(Self::default(), 10)
    }
}

impl Service for PerfectState {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = Memory;

    fn step(&mut self, _now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.steps += 1;
        let (Some(imu), Some(truth)) = (inputs.imu.latest(), inputs.truth.latest()) else { return };
        let bias = truth.accelerometer_bias_b_m_s2;
        outputs.state_estimate.write(StateEstimate {
            described_ns: truth.header.valid_ns,
            position_w_m: truth.position_w_m,
            velocity_w_m_s: truth.velocity_w_m_s,
            q_wb: truth.q_wb,
            body_rate_b_rad_s: truth.body_rate_b_rad_s,
            // The truth has no accelerations: as measured, without the bias.
            specific_force_b_m_s2: core::array::from_fn(|i| imu.specific_force_b_m_s2[i] - bias[i]),
            gyro_bias_b_rad_s: truth.gyro_bias_b_rad_s,
            accelerometer_bias_b_m_s2: bias,
            morph_angle_rad: truth.morph_angle_rad,
            morph_rate_rad_s: truth.morph_rate_rad_s,
            ..StateEstimate::default()
        });
    }

    fn memory(&self) -> Memory {
        Memory { steps: self.steps }
    }

    fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        self.steps = memory.steps;
        Ok(())
    }
}
