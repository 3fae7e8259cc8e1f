//! The estimator as a process: IMU, pose fixes, morph angle and heights in, state estimate out.

use crate::filter::{
    ConfigError, Estimate, Filter, FilterConfig, FilterMemory, ImuSample, InitialState,
    MorphAngleSample, PoseFixSample, Scalar, VerdictCounts,
};
use runtime::{Service, inputs, outputs};
use shared_types::{
    Barometer, Flag, Imu, MorphAngle, PoseFix, Quaternion, RangeFinder, StateEstimate, topics,
};
use vehicle::{components, rotation};

inputs! {
    /// What the estimator reads; its estimates descend from the IMU.
    pub struct Inputs {
        /// Rates and specific forces.
        imu: Imu = topics::IMU,
        /// Delayed poses.
        pose_fix: PoseFix = topics::POSE_FIX,
        /// Encoder of the deployable angle.
        morph_angle: MorphAngle = topics::MORPH_ANGLE,
        /// Height by air pressure.
        barometer: Barometer = topics::BAROMETER,
        /// Distance to the ground below.
        range_finder: RangeFinder = topics::RANGE_FINDER,
    }
}

outputs! {
    /// What the estimator writes.
    pub struct Outputs {
        /// Believed state.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
    }
}

/// The error-state filter between its ports.
#[derive(Debug)]
pub struct Estimator {
    filter: Filter,
}

impl Estimator {
    /// An estimator with a belief about the start.
    ///
    /// # Errors
    /// The configuration is impossible.
    pub fn new(config: FilterConfig, initial: &InitialState) -> Result<Self, ConfigError> {
        Ok(Self { filter: Filter::new(config, initial)? })
    }

    /// Samples of one step by topic: the IMU carries the belief to an instant before a measurement of that instant
    /// corrects it, and readings come before a fix that would leave them behind.
    fn take(&mut self, inputs: &Inputs) {
        for sample in inputs.imu.fresh() {
            self.filter.on_imu(&ImuSample {
                time_ns: sample.header.valid_ns,
                gyro_rad_s: sample.gyro_b_rad_s.into(),
                accel_m_s2: sample.specific_force_b_m_s2.into(),
            });
        }
        for sample in inputs.barometer.fresh() {
            let (time_ns, height_w_m) = (sample.header.valid_ns, sample.height_w_m);
            self.filter.on_scalar(Scalar::Barometer, time_ns, height_w_m);
        }
        for sample in inputs.range_finder.fresh() {
            let (time_ns, range_m) = (sample.header.valid_ns, sample.range_m);
            self.filter.on_scalar(Scalar::RangeFinder, time_ns, range_m);
        }
        for sample in inputs.pose_fix.fresh() {
            self.filter.on_pose_fix(&PoseFixSample {
                captured_ns: sample.captured_ns,
                position_w: sample.position_w_m.into(),
                q_wb: rotation(sample.q_wb.to_array()),
            });
        }
        for sample in inputs.morph_angle.fresh() {
            self.filter.on_morph_angle(&MorphAngleSample {
                time_ns: sample.header.valid_ns,
                angle_rad: sample.angle_rad,
            });
        }
    }
}

fn wire(estimate: &Estimate) -> StateEstimate {
    let refused = &estimate.counters;
    let (sigma, _) = estimate.sigmas.as_chunks::<3>();
    StateEstimate {
        described_ns: estimate.time_ns,
        position_w_m: estimate.position_w.into(),
        velocity_w_m_s: estimate.velocity_w.into(),
        q_wb: Quaternion::from_array(components(estimate.q_wb)),
        body_rate_b_rad_s: estimate.body_rate_b.into(),
        specific_force_b_m_s2: estimate.specific_force_b.into(),
        gyro_bias_b_rad_s: estimate.gyro_bias_b.into(),
        accelerometer_bias_b_m_s2: estimate.accel_bias_b.into(),
        morph_angle_rad: estimate.beta_rad,
        morph_rate_rad_s: estimate.beta_rate_rad_s,
        position_sigma_w_m: sigma[0],
        velocity_sigma_w_m_s: sigma[1],
        attitude_sigma_b_rad: sigma[2],
        gyro_bias_sigma_b_rad_s: sigma[3],
        accelerometer_bias_sigma_b_m_s2: sigma[4],
        pose_fix_nis: estimate.nis,
        pose_fixes_gated: refused.pose_fix.gated,
        covariance_reopened: refused.reopened,
        imu_gaps: refused.imu_gaps,
        samples_refused: refused.imu.refused()
            + refused.pose_fix.refused()
            + refused.morph_angle.refused()
            + refused.scalars.iter().map(VerdictCounts::refused).sum::<u64>(),
        nis_alarm: Flag::from(estimate.alarms.nis),
        imu_overdue: Flag::from(estimate.alarms.imu_overdue),
        fix_overdue: Flag::from(estimate.alarms.fix_overdue),
        ..StateEstimate::default()
    }
}

impl Service for Estimator {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = FilterMemory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take(inputs);
        outputs.state_estimate.write(wire(&self.filter.estimate_at(now_ns)));
    }

    fn memory(&self) -> FilterMemory {
        self.filter.memory()
    }

    fn restore(&mut self, memory: &FilterMemory) -> Result<(), String> {
        self.filter.restore(memory).map_err(|error| error.to_string())
    }
}
