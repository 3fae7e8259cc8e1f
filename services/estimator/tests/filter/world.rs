//! Known trajectories and the seeded sensors that fly them.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use estimator::{
    Covariance, Filter, FilterConfig, ImuSample, InitialState, PoseFixSample, STATE_DIMENSION,
};
use nalgebra::{Matrix3, Rotation3, SVector, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub(crate) const STEP_NS: u64 = 1_000_000;
pub(crate) const STEPS_PER_FIX: usize = 10;
/// Steps from the capture of a fix to its arrival.
pub(crate) const LATENCY_STEPS: usize = 10;

/// What is true at one instant; rates and forces in body axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Truth {
    pub(crate) p: Vector3<f64>,
    pub(crate) v: Vector3<f64>,
    pub(crate) q: UnitQuaternion<f64>,
    pub(crate) omega: Vector3<f64>,
    pub(crate) force: Vector3<f64>,
    pub(crate) gyro_bias: Vector3<f64>,
    pub(crate) accel_bias: Vector3<f64>,
}

fn figure_eight_position(t: f64) -> [Vector3<f64>; 3] {
    let (s1, c1) = t.sin_cos();
    let (s2, c2) = (2.0 * t).sin_cos();
    let (s3, c3) = (0.7 * t).sin_cos();
    [
        Vector3::new(2.0 * s1, s2, 1.5 + 0.4 * s3),
        Vector3::new(2.0 * c1, 2.0 * c2, 0.28 * c3),
        Vector3::new(-2.0 * s1, -4.0 * s2, -0.196 * s3),
    ]
}

/// Attitude that points the thrust along a + g under a swinging yaw, as a quadrotor must.
fn figure_eight_attitude(t: f64) -> UnitQuaternion<f64> {
    let up = (figure_eight_position(t)[2] + Vector3::new(0.0, 0.0, 9.81)).normalize();
    let yaw = 0.6 * (0.5 * t).sin();
    let side = up.cross(&Vector3::new(yaw.cos(), yaw.sin(), 0.0)).normalize();
    let r = Matrix3::from_columns(&[side.cross(&up), side, up]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r))
}

/// A figure eight, 4 m long, up to 2.8 m/s and 0.4 rad of tilt, at each IMU instant.
pub(crate) fn figure_eight(seconds: usize) -> Vec<Truth> {
    let h = 1e-4;
    (0..=seconds * 1000)
        .map(|k| {
            let t = k as f64 * 1e-3;
            let [p, v, a] = figure_eight_position(t);
            let q = figure_eight_attitude(t);
            let turn = figure_eight_attitude(t - h).inverse() * figure_eight_attitude(t + h);
            Truth {
                p,
                v,
                q,
                omega: turn.scaled_axis() / (2.0 * h),
                force: q.inverse() * (a + Vector3::new(0.0, 0.0, 9.81)),
                gyro_bias: Vector3::zeros(),
                accel_bias: Vector3::zeros(),
            }
        })
        .collect()
}

pub(crate) fn hover(seconds: usize) -> Vec<Truth> {
    let truth = Truth {
        p: Vector3::new(0.0, 0.0, 1.0),
        v: Vector3::zeros(),
        q: UnitQuaternion::from_euler_angles(0.0, 0.0, 0.7),
        omega: Vector3::zeros(),
        force: Vector3::new(0.0, 0.0, 9.81),
        gyro_bias: Vector3::zeros(),
        accel_bias: Vector3::zeros(),
    };
    vec![truth; seconds * 1000 + 1]
}

/// What happens in a flight besides the sensors' noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Script {
    pub(crate) seed: usize,
    /// No fix is captured from the first to before the second step.
    pub(crate) drop_out: (usize, usize),
    /// At this step the gyro bias jumps by this much.
    pub(crate) flip: (usize, Vector3<f64>),
    pub(crate) latency_steps: usize,
    /// Steps per inertial sample; divides the period of the fixes.
    pub(crate) steps_per_imu: usize,
    /// No inertial sample from the first to before the second step.
    pub(crate) imu_gap: (usize, usize),
    /// Noise of the fixes over what the filter is configured for.
    pub(crate) fix_noise: f64,
}

impl Script {
    pub(crate) fn nominal(seed: usize) -> Self {
        Self {
            seed,
            drop_out: (0, 0),
            flip: (usize::MAX, Vector3::zeros()),
            latency_steps: LATENCY_STEPS,
            steps_per_imu: 1,
            imu_gap: (0, 0),
            fix_noise: 1.0,
        }
    }
}

pub(crate) struct Sensors {
    rng: ChaCha8Rng,
    config: FilterConfig,
    imu_period_s: f64,
    fix_noise: f64,
    gyro_bias: Vector3<f64>,
    accel_bias: Vector3<f64>,
}

impl Sensors {
    pub(crate) fn new(seed: usize, initial: &InitialState) -> Self {
        let mut sensors = Self {
            rng: ChaCha8Rng::seed_from_u64(seed as u64),
            config: FilterConfig::default(),
            imu_period_s: STEP_NS as f64 * 1e-9,
            fix_noise: 1.0,
            gyro_bias: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
        };
        sensors.gyro_bias = sensors.normal(initial.gyro_bias_sigma_rad_s);
        sensors.accel_bias = sensors.normal(initial.accel_bias_sigma_m_s2);
        sensors
    }

    pub(crate) fn normal(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| {
            let n: f64 = StandardNormal.sample(&mut self.rng);
            sigma * n
        })
    }

    /// The initial belief: the truth, missed by as much as its covariance implies.
    pub(crate) fn initial(&mut self, truth: &Truth) -> InitialState {
        let believed = InitialState::default();
        InitialState {
            position_w: truth.p + self.normal(believed.position_sigma_m),
            velocity_w: truth.v + self.normal(believed.velocity_sigma_m_s),
            q_wb: truth.q
                * UnitQuaternion::from_scaled_axis(self.normal(believed.attitude_sigma_rad)),
            ..believed
        }
    }

    pub(crate) fn imu(&mut self, step: usize, truth: &Truth) -> ImuSample {
        let dt = self.imu_period_s;
        let c = self.config;
        let gyro_step = self.normal(c.gyro_walk_rad_s2_rthz * dt.sqrt());
        let accel_step = self.normal(c.accel_walk_m_s3_rthz * dt.sqrt());
        self.gyro_bias += gyro_step;
        self.accel_bias += accel_step;
        let gyro_noise = self.normal(c.gyro_noise_rad_s_rthz / dt.sqrt());
        let accel_noise = self.normal(c.accel_noise_m_s2_rthz / dt.sqrt());
        ImuSample {
            time_ns: step as u64 * STEP_NS,
            gyro_rad_s: truth.omega + self.gyro_bias + gyro_noise,
            accel_m_s2: truth.force + self.accel_bias + accel_noise,
        }
    }

    pub(crate) fn fix(&mut self, step: usize, truth: &Truth) -> PoseFixSample {
        let turn = self.normal(self.fix_noise * self.config.fix_attitude_sigma_rad);
        PoseFixSample {
            captured_ns: step as u64 * STEP_NS,
            position_w: truth.p + self.normal(self.fix_noise * self.config.fix_position_sigma_m),
            q_wb: truth.q * UnitQuaternion::from_scaled_axis(turn),
        }
    }
}

/// One instant of a flight, as a test sees it.
pub(crate) struct Instant<'a> {
    pub(crate) step: usize,
    pub(crate) truth: Truth,
    pub(crate) filter: &'a Filter,
    /// A fix arrived at this instant.
    pub(crate) fixed: bool,
}

/// Flies `truth` under `script` and shows each instant.
pub(crate) fn fly(truth: &[Truth], script: &Script, mut see: impl FnMut(&Instant)) -> Filter {
    let mut sensors = Sensors::new(script.seed, &InitialState::default());
    sensors.imu_period_s *= script.steps_per_imu as f64;
    sensors.fix_noise = script.fix_noise;
    let initial = sensors.initial(&truth[0]);
    let mut filter = Filter::new(FilterConfig::default(), &initial).expect("default is valid");
    let mut under_way = std::collections::VecDeque::new();
    for (step, truth) in truth.iter().enumerate() {
        if step == script.flip.0 {
            sensors.gyro_bias += script.flip.1;
        }
        if step % script.steps_per_imu != 0 {
            continue;
        }
        let sample = sensors.imu(step, truth);
        if !(script.imu_gap.0..script.imu_gap.1).contains(&step) {
            filter.on_imu(&sample);
        }
        let dropped = (script.drop_out.0..script.drop_out.1).contains(&step);
        if step % STEPS_PER_FIX == 0 && !dropped {
            under_way.push_back((step + script.latency_steps, sensors.fix(step, truth)));
        }
        let mut fixed = false;
        while under_way.front().is_some_and(|(arrival, _)| *arrival <= step) {
            if let Some((_, fix)) = under_way.pop_front() {
                filter.on_pose_fix(&fix);
                fixed = true;
            }
        }
        let truth =
            Truth { gyro_bias: sensors.gyro_bias, accel_bias: sensors.accel_bias, ..*truth };
        see(&Instant { step, truth, filter: &filter, fixed });
    }
    filter
}

/// Error state, in the order of the covariance.
pub(crate) fn error(instant: &Instant) -> SVector<f64, STATE_DIMENSION> {
    let (estimate, truth) = (instant.filter.estimate(), &instant.truth);
    let mut error: SVector<f64, STATE_DIMENSION> = SVector::zeros();
    let turn = (estimate.q_wb.inverse() * truth.q).scaled_axis();
    error.fixed_rows_mut::<3>(0).copy_from(&(truth.p - estimate.position_w));
    error.fixed_rows_mut::<3>(3).copy_from(&(truth.v - estimate.velocity_w));
    error.fixed_rows_mut::<3>(6).copy_from(&turn);
    error.fixed_rows_mut::<3>(9).copy_from(&(truth.gyro_bias - estimate.gyro_bias_b));
    error.fixed_rows_mut::<3>(12).copy_from(&(truth.accel_bias - estimate.accel_bias_b));
    error
}

/// NEES of all 15 states, then of each block of three.
pub(crate) fn nees(instant: &Instant) -> [f64; 6] {
    let error = error(instant);
    let covariance: &Covariance = instant.filter.covariance();
    let whole = covariance.cholesky().map_or(f64::INFINITY, |c| error.dot(&c.solve(&error)));
    let mut nees = [whole; 6];
    for (i, value) in nees.iter_mut().skip(1).enumerate() {
        let part = error.fixed_rows::<3>(3 * i).into_owned();
        let block: Matrix3<f64> = covariance.fixed_view::<3, 3>(3 * i, 3 * i).into_owned();
        *value = block.cholesky().map_or(f64::INFINITY, |c| part.dot(&c.solve(&part)));
    }
    nees
}
