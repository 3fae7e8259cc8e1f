//! The pipeline: inertial samples push the head forward, fixes correct the past and are replayed.
//!
//! ```text
//! base ──history──▶ head ──▶ estimate
//!  ▲ a fix corrects here, at its capture; then the history is replayed into a new head
//! ```
//! The base is the belief at the capture of the last fix, or as far back as the history reaches; the
//! history holds the inertial samples from there to the head. A fix moves the base to its capture, so
//! what is replayed is exactly what a filter without delay would compute. Readings of one number are kept beside the
//! inertial samples and replayed with them.

mod barometer;
mod belief;
mod bias;
mod config;
mod error_state;
mod estimate;
mod history;
mod measurement;
mod memory;
mod monitor;
mod morph_angle;
mod pose_fix;
mod propagate;
mod range_finder;
mod readings;
mod rotation;
mod sample;
mod scalar;

pub use barometer::BarometerModel;
pub use config::{ConfigError, FilterConfig, InitialState, MAX_NIS_WINDOW, ReopenSigmas};
pub use error_state::{Covariance, STATE_DIMENSION};
pub use estimate::{AlarmFlags, Counters, Estimate, VerdictCounts};
pub use memory::{BeliefMemory, FilterMemory, ImuMemory, MemoryError};
pub use range_finder::RangeFinderModel;
pub use sample::{ImuSample, MorphAngleSample, PoseFixSample, Verdict};
pub use scalar::Scalar;

use belief::Belief;
use history::{History, interpolate};
use memory::Evolving;
use monitor::{Advice, Monitor};
use morph_angle::MorphFilter;
use readings::Readings;
use scalar::Reading;

/// Error-state Kalman filter with delayed fixes; the pipeline is drawn in `filter/mod.rs`.
///
/// A call allocates nothing, never panics and replays at most one history.
#[derive(Debug, Clone)]
pub struct Filter {
    config: FilterConfig,
    state: Evolving,
}

impl Filter {
    /// A filter that believes `initial`.
    ///
    /// # Errors
    /// [`ConfigError`] names the parameter that is out of its domain.
    pub fn new(config: FilterConfig, initial: &InitialState) -> Result<Self, ConfigError> {
        config.validate()?;
        initial.validate(&config)?;
        let belief = Belief::new(initial);
        let state = Evolving {
            base: belief,
            head: belief,
            history: History::new(),
            readings: Readings::new(),
            next_reading_ns: [0; bias::SCALARS],
            readings_gated_in_row: [0; bias::SCALARS],
            last_fix_captured_ns: None,
            last_fix_accepted_ns: initial.time_ns,
            monitor: Monitor::new(),
            morph: MorphFilter::new(initial),
            counters: Counters::default(),
        };
        Ok(Self { config, state })
    }

    /// Moves the estimate to the instant of an inertial sample.
    pub fn on_imu(&mut self, sample: &ImuSample) -> Verdict {
        let verdict = self.judge_imu(sample);
        if verdict == Verdict::Accepted {
            self.take_imu(sample);
        }
        self.state.counters.imu.record(verdict)
    }

    /// Corrects the estimate with a fix captured in the past.
    pub fn on_pose_fix(&mut self, fix: &PoseFixSample) -> Verdict {
        let verdict = match self.refuse_fix(fix) {
            Some(refusal) => refusal,
            None => self.take_fix(fix),
        };
        self.state.counters.pose_fix.record(verdict)
    }

    /// Corrects the morph angle with an encoder reading.
    pub fn on_morph_angle(&mut self, sample: &MorphAngleSample) -> Verdict {
        let verdict = self.state.morph.update(sample, &self.config);
        self.state.counters.morph_angle.record(verdict)
    }

    /// Corrects the estimate with a reading of one number, made at `time_ns`. It counts at the instant of an inertial
    /// sample: of the next one, or, if that has not come, of the last, so at most a period of the IMU from its own. While
    /// the IMU is silent for longer than that, readings are refused.
    pub fn on_scalar(&mut self, of: Scalar, time_ns: u64, value: f64) -> Verdict {
        let verdict = match self.refuse_scalar(of, time_ns, value) {
            Some(refusal) => refusal,
            None => self.take_scalar(of, time_ns, value),
        };
        self.state.counters.scalars[of.index()].record(verdict)
    }

    /// What is believed at the last inertial sample.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        self.estimate_at(self.state.head.time_ns)
    }

    /// What is believed at `now_ns`: the state of the last inertial sample, which after more than a period
    /// without another one is worth less and less.
    #[must_use]
    pub fn estimate_at(&self, now_ns: u64) -> Estimate {
        let silent_ns = now_ns.saturating_sub(self.state.head.time_ns);
        if silent_ns <= self.config.imu_period_ns {
            return self.believed(&self.state.head, silent_ns);
        }
        let mut head = self.state.head;
        head.open_over_gap(silent_ns as f64 * 1e-9);
        self.believed(&head, silent_ns)
    }

    fn believed(&self, head: &Belief, silent_ns: u64) -> Estimate {
        let Evolving { monitor, counters, .. } = &self.state;
        let imu_overdue = silent_ns > self.config.max_imu_gap_ns;
        let (gyro, accel) = head.inertial.map_or_else(Default::default, |i| (i.gyro, i.accel));
        let (beta_rad, beta_rate_rad_s) = self.state.morph.at(head.time_ns, &self.config);
        let now_ns = head.time_ns.saturating_add(silent_ns);
        let fix_age_ns = now_ns.saturating_sub(self.state.last_fix_accepted_ns);
        Estimate {
            time_ns: head.time_ns,
            position_w: head.p,
            velocity_w: head.v,
            q_wb: vehicle::canonical(head.q),
            body_rate_b: gyro - head.gyro_bias,
            specific_force_b: accel - head.accel_bias,
            gyro_bias_b: head.gyro_bias,
            accel_bias_b: head.accel_bias,
            beta_rad,
            beta_rate_rad_s,
            sigmas: std::array::from_fn(|i| f64::sqrt(head.covariance[(i, i)].max(0.0))),
            nis: monitor.last_nis,
            alarms: AlarmFlags {
                nis: monitor.alarm,
                fix_gated: monitor.last_nis > self.config.fix_gate,
                fix_overdue: fix_age_ns > self.config.fix_timeout_ns,
                imu_overdue,
            },
            // A gap counts from its beginning on; the sample that ends it counts it for good.
            counters: Counters {
                imu_gaps: counters.imu_gaps + u64::from(imu_overdue),
                ..*counters
            },
        }
    }

    /// Error covariance that belongs to [`estimate`](Self::estimate).
    #[must_use]
    pub fn covariance(&self) -> &Covariance {
        &self.state.head.covariance
    }

    /// The whole evolving state.
    #[must_use]
    pub fn memory(&self) -> FilterMemory {
        self.state.memory()
    }

    /// Continues from a memory, bit for bit if it was written under the same configuration.
    ///
    /// # Errors
    /// [`MemoryError`] if no filter can have written it; the filter is then unchanged.
    pub fn restore(&mut self, memory: &FilterMemory) -> Result<(), MemoryError> {
        self.state = memory.evolving(self.config.nis_window)?;
        Ok(())
    }

    fn judge_imu(&self, sample: &ImuSample) -> Verdict {
        let (gyro, accel) = (&sample.gyro_rad_s, &sample.accel_m_s2);
        if !gyro.iter().chain(accel).all(|x| x.is_finite()) {
            return Verdict::NotFinite;
        }
        let inside = gyro.iter().all(|x| x.abs() <= self.config.gyro_range_rad_s)
            && accel.iter().all(|x| x.abs() <= self.config.accel_range_m_s2);
        if !inside {
            return Verdict::OutOfRange;
        }
        let head = &self.state.head;
        let repeated = head.inertial.is_some() && sample.time_ns == head.time_ns;
        if sample.time_ns < head.time_ns || repeated {
            return Verdict::OutOfOrder;
        }
        Verdict::Accepted
    }

    fn take_imu(&mut self, sample: &ImuSample) {
        let state = &mut self.state;
        if sample.time_ns - state.head.time_ns > self.config.max_imu_gap_ns {
            state.counters.imu_gaps += 1;
        }
        if state.history.is_full() {
            state.pass_oldest(&self.config);
        }
        state.history.push(*sample);
        state.head.propagate(sample, &self.config);
    }

    fn refuse_fix(&self, fix: &PoseFixSample) -> Option<Verdict> {
        let state = &self.state;
        if let Some(refusal) = pose_fix::refusal(fix, &self.config) {
            return Some(refusal);
        }
        if state.last_fix_captured_ns.is_some_and(|last| fix.captured_ns <= last) {
            return Some(Verdict::OutOfOrder);
        }
        if fix.captured_ns < state.base.time_ns {
            return Some(Verdict::TooOld);
        }
        (fix.captured_ns > state.head.time_ns).then_some(Verdict::Ahead)
    }

    /// Base to the capture, correct there, replay to the head.
    fn take_fix(&mut self, fix: &PoseFixSample) -> Verdict {
        self.move_base(fix.captured_ns);
        let state = &mut self.state;
        state.last_fix_captured_ns = Some(fix.captured_ns);
        let innovation =
            pose_fix::innovation(&state.base, fix, &self.config, state.monitor.noise_scale);
        let verdict = if let Some(innovation) = innovation {
            self.correct(&innovation)
        } else {
            self.reopen(0);
            Verdict::Numerical
        };
        if verdict == Verdict::Accepted {
            self.state.last_fix_accepted_ns = fix.captured_ns;
        }
        let _verdict = self.state.replay(None, &self.config);
        verdict
    }

    fn refuse_scalar(&self, of: Scalar, time_ns: u64, value: f64) -> Option<Verdict> {
        let state = &self.state;
        if !value.is_finite() {
            return Some(Verdict::NotFinite);
        }
        if !of.model(&self.config).range().contains(&value) {
            return Some(Verdict::OutOfRange);
        }
        if time_ns < state.next_reading_ns[of.index()] {
            return Some(Verdict::OutOfOrder);
        }
        if time_ns < state.base.time_ns {
            return Some(Verdict::TooOld);
        }
        let newest_ns = state.head.time_ns.saturating_add(self.config.imu_period_ns);
        (time_ns > newest_ns).then_some(Verdict::Ahead)
    }

    /// Corrects the head, or, if the reading is older, the past; and keeps it for the replay after the next fix.
    fn take_scalar(&mut self, of: Scalar, time_ns: u64, value: f64) -> Verdict {
        let (state, config) = (&mut self.state, &self.config);
        state.next_reading_ns[of.index()] = time_ns.saturating_add(1);
        let reading = Reading { time_ns: time_ns.min(state.head.time_ns), of, value };
        let place = state.readings.insert(reading);
        let verdict = if reading.time_ns == state.head.time_ns {
            scalar::correct(&mut state.head, &reading, config)
        } else {
            state.replay(Some(place), config)
        };
        let gated = &mut state.readings_gated_in_row[of.index()];
        *gated = if verdict == Verdict::Gated { gated.saturating_add(1) } else { 0 };
        if *gated >= config.reopen_after_rejections
            && let Some(model) = of.model(config).bias()
        {
            *gated = 0;
            for belief in [&mut state.base, &mut state.head] {
                belief.biases[of.index()].reopen(model.initial_sigma);
            }
        }
        verdict
    }

    /// Advances the base to `time_ns`, which lies between base and head.
    fn move_base(&mut self, time_ns: u64) {
        let is_before = |sample: &ImuSample| sample.time_ns <= time_ns;
        while self.state.history.oldest().is_some_and(is_before)
            && self.state.pass_oldest(&self.config)
        {}
        let Evolving { base, history, .. } = &mut self.state;
        if base.time_ns == time_ns {
            return;
        }
        if let Some(after) = history.oldest() {
            let reading = base.inertial.map_or(*after, |inertial| ImuSample {
                time_ns: base.time_ns,
                gyro_rad_s: inertial.gyro,
                accel_m_s2: inertial.accel,
            });
            base.propagate(&interpolate(&reading, after, time_ns), &self.config);
        }
    }

    /// Gates the innovation, applies it to the base and follows the monitor's advice.
    fn correct(&mut self, innovation: &pose_fix::Innovation) -> Verdict {
        let gated = innovation.whitened.norm_squared() > self.config.fix_gate;
        if !gated {
            innovation.apply(&mut self.state.base);
        }
        match self.state.monitor.observe(&innovation.whitened, &self.config) {
            Advice::Keep => {}
            Advice::ReopenGate { level } => self.reopen(level),
            Advice::ReopenBiased => {
                self.state.counters.nis_alarms += 1;
                self.reopen(0);
            }
            Advice::Noisier => self.state.counters.nis_alarms += 1,
        }
        if gated { Verdict::Gated } else { Verdict::Accepted }
    }

    fn reopen(&mut self, level: u32) {
        self.state.base.reopen(&self.config, level);
        self.state.counters.reopened += 1;
    }
}
