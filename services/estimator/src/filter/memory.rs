//! The filter's whole evolving state as one plain struct, and back.

use nalgebra::{ArrayStorage, Const};
use nalgebra::{Matrix, Quaternion, UnitQuaternion, Vector3, Vector6};
use thiserror::Error;

use super::belief::{Belief, Inertial};
use super::bias::{Bias, SCALARS};
use super::config::{FilterConfig, MAX_NIS_WINDOW};
use super::error_state::STATE_DIMENSION;
use super::estimate::Counters;
use super::history::{HISTORY_CAPACITY, History};
use super::monitor::Monitor;
use super::morph_angle::MorphFilter;
use super::readings::{READINGS_CAPACITY, Readings};
use super::sample::{ImuSample, Verdict};
use super::scalar::{self, Reading, Scalar};

shared_types::memory! {
    /// One belief, laid out flat. Quaternion in the order w, x, y, z; covariance by columns.
    #[derive(PartialEq)]
    pub struct BeliefMemory {
        time_ns: u64,
        has_inertial: u64,
        position_w: [f64; 3],
        velocity_w: [f64; 3],
        q_wb: [f64; 4],
        gyro_bias: [f64; 3],
        accel_bias: [f64; 3],
        gyro: [f64; 3],
        accel: [f64; 3],
        covariance: [[f64; STATE_DIMENSION]; STATE_DIMENSION],
        biases: [BiasMemory; SCALARS],
    }
}

shared_types::memory! {
    /// Bias of a sensor of one number, laid out flat.
    #[derive(PartialEq)]
    pub struct BiasMemory {
        is_known: u64,
        value: f64,
        variance: f64,
        cross: [f64; STATE_DIMENSION],
    }
}

shared_types::memory! {
    /// One reading of a sensor of one number, laid out flat.
    #[derive(PartialEq)]
    pub struct ReadingMemory {
        time_ns: u64,
        of: u64,
        value: f64,
    }
}

shared_types::memory! {
    /// One inertial sample, laid out flat.
    #[derive(PartialEq)]
    pub struct ImuMemory {
        time_ns: u64,
        gyro: [f64; 3],
        accel: [f64; 3],
    }
}

shared_types::memory! {
    /// Everything that [`Filter::restore`](super::Filter::restore) needs to continue bit for bit under
    /// the same configuration. Fixed layout, 8-byte fields only, about 11 kB.
    #[derive(PartialEq)]
    pub struct FilterMemory {
        base: BeliefMemory,
        head: BeliefMemory,
        history: [ImuMemory; HISTORY_CAPACITY],
        history_length: u64,
        readings: [ReadingMemory; READINGS_CAPACITY],
        readings_length: u64,
        next_reading_ns: [u64; SCALARS],
        readings_gated_in_row: [u64; SCALARS],
        last_fix_captured_ns: u64,
        has_fix: u64,
        last_fix_accepted_ns: u64,
        nis_window: [[f64; 6]; MAX_NIS_WINDOW],
        nis_next: u64,
        nis_filled: u64,
        rejections_in_row: u64,
        reopen_level: u64,
        nis_alarm: u64,
        last_nis: f64,
        fix_noise_scale: f64,
        morph_time_ns: u64,
        morph_started: u64,
        morph_rejections_in_row: u64,
        morph_state: [f64; 2],
        morph_covariance: [f64; 3],
        counters: Counters,
    }
}

/// A memory that no filter can have written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum MemoryError {
    /// A component is NaN or infinite.
    #[error("the memory's {0} is not finite: take an older keyframe")]
    NotFinite(&'static str),
    /// A length or index is larger than its buffer.
    #[error("the memory's {0} is out of range: it was written under another configuration")]
    OutOfRange(&'static str),
}

/// The parts of a filter that evolve.
#[derive(Debug, Clone)]
pub(super) struct Evolving {
    /// At the capture of the last fix, or as far back as the history reaches.
    pub(super) base: Belief,
    /// At the last inertial sample.
    pub(super) head: Belief,
    /// From just after `base` up to `head`.
    pub(super) history: History,
    /// Readings of one number that count after `base`.
    pub(super) readings: Readings,
    /// Of each sensor of one number: no reading may be older \[ns\].
    pub(super) next_reading_ns: [u64; SCALARS],
    /// Of each of them: readings refused by the gate in a row.
    pub(super) readings_gated_in_row: [u64; SCALARS],
    /// Capture of the last fix that was compared.
    pub(super) last_fix_captured_ns: Option<u64>,
    /// Capture of the last fix that was accepted; the start before the first.
    pub(super) last_fix_accepted_ns: u64,
    pub(super) monitor: Monitor,
    pub(super) morph: MorphFilter,
    pub(super) counters: Counters,
}

impl From<&Belief> for BeliefMemory {
    fn from(belief: &Belief) -> Self {
        let inertial =
            belief.inertial.unwrap_or(Inertial { gyro: Vector3::zeros(), accel: Vector3::zeros() });
        Self {
            time_ns: belief.time_ns,
            has_inertial: u64::from(belief.inertial.is_some()),
            position_w: belief.p.into(),
            velocity_w: belief.v.into(),
            q_wb: [belief.q.w, belief.q.i, belief.q.j, belief.q.k],
            gyro_bias: belief.gyro_bias.into(),
            accel_bias: belief.accel_bias.into(),
            gyro: inertial.gyro.into(),
            accel: inertial.accel.into(),
            covariance: belief.covariance.data.0,
            biases: belief.biases.map(|Bias { is_known, value, variance, cross }| BiasMemory {
                is_known: is_known.into(),
                value,
                variance,
                cross: cross.into(),
            }),
        }
    }
}

impl BeliefMemory {
    fn belief(&self) -> Result<Belief, MemoryError> {
        let vectors = [
            self.position_w,
            self.velocity_w,
            self.gyro_bias,
            self.accel_bias,
            self.gyro,
            self.accel,
        ];
        finite("nominal state", vectors.as_flattened())?;
        finite("attitude", &self.q_wb)?;
        finite("covariance", self.covariance.as_flattened())?;
        for bias in &self.biases {
            finite("bias", &[bias.value, bias.variance])?;
            finite("bias", &bias.cross)?;
        }
        let [w, x, y, z] = self.q_wb;
        if (Quaternion::new(w, x, y, z).norm() - 1.0).abs() > 1e-6 {
            return Err(MemoryError::OutOfRange("attitude"));
        }
        let inertial = Inertial { gyro: self.gyro.into(), accel: self.accel.into() };
        Ok(Belief {
            time_ns: self.time_ns,
            p: self.position_w.into(),
            v: self.velocity_w.into(),
            q: UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)),
            gyro_bias: self.gyro_bias.into(),
            accel_bias: self.accel_bias.into(),
            covariance:
                Matrix::<_, Const<STATE_DIMENSION>, Const<STATE_DIMENSION>, _>::from_array_storage(
                    ArrayStorage(self.covariance),
                ),
            biases: self.biases.map(|BiasMemory { is_known, value, variance, cross }| Bias {
                is_known: is_known != 0,
                value,
                variance,
                cross: cross.into(),
            }),
            inertial: (self.has_inertial != 0).then_some(inertial),
        })
    }
}

impl Evolving {
    /// Moves the base past the oldest inertial sample and the readings until its instant; false if there is none.
    pub(super) fn pass_oldest(&mut self, config: &FilterConfig) -> bool {
        let Some(oldest) = self.history.pop_oldest() else { return false };
        self.base.propagate(&oldest, config);
        let passed = self.readings.until(oldest.time_ns);
        for reading in &self.readings.all()[..passed] {
            // Its verdict was reported when it came.
            let _verdict = scalar::correct(&mut self.base, reading, config);
        }
        self.readings.forget(passed);
        true
    }

    /// Computes the head anew, from the base; gives the verdict about the reading at a place on the way.
    pub(super) fn replay(&mut self, place: Option<usize>, config: &FilterConfig) -> Verdict {
        let mut verdict = Verdict::Accepted;
        let mut readings = self.readings.all().iter().enumerate().peekable();
        self.head = self.base;
        for sample in self.history.iter() {
            self.head.propagate(sample, config);
            while let Some((at, reading)) =
                readings.next_if(|(_, reading)| reading.time_ns <= sample.time_ns)
            {
                let judged = scalar::correct(&mut self.head, reading, config);
                if place == Some(at) {
                    verdict = judged;
                }
            }
        }
        verdict
    }

    pub(super) fn memory(&self) -> FilterMemory {
        let empty = ImuMemory { time_ns: 0, gyro: [0.0; 3], accel: [0.0; 3] };
        let mut history = [empty; HISTORY_CAPACITY];
        for (slot, sample) in history.iter_mut().zip(self.history.iter()) {
            *slot = ImuMemory {
                time_ns: sample.time_ns,
                gyro: sample.gyro_rad_s.into(),
                accel: sample.accel_m_s2.into(),
            };
        }
        let mut readings = [ReadingMemory { time_ns: 0, of: 0, value: 0.0 }; READINGS_CAPACITY];
        for (slot, reading) in readings.iter_mut().zip(self.readings.all()) {
            let Reading { time_ns, of, value } = *reading;
            *slot = ReadingMemory { time_ns, of: of.index() as u64, value };
        }
        FilterMemory {
            base: (&self.base).into(),
            head: (&self.head).into(),
            history,
            history_length: self.history.iter().count() as u64,
            readings,
            readings_length: self.readings.all().len() as u64,
            next_reading_ns: self.next_reading_ns,
            readings_gated_in_row: self.readings_gated_in_row,
            last_fix_captured_ns: self.last_fix_captured_ns.unwrap_or(0),
            has_fix: u64::from(self.last_fix_captured_ns.is_some()),
            last_fix_accepted_ns: self.last_fix_accepted_ns,
            nis_window: self.monitor.window.map(Into::into),
            nis_next: self.monitor.next as u64,
            nis_filled: self.monitor.filled as u64,
            rejections_in_row: self.monitor.rejections_in_row,
            reopen_level: u64::from(self.monitor.reopen_level),
            nis_alarm: u64::from(self.monitor.alarm),
            last_nis: self.monitor.last_nis,
            fix_noise_scale: self.monitor.noise_scale,
            morph_time_ns: self.morph.time_ns,
            morph_started: u64::from(self.morph.started),
            morph_rejections_in_row: self.morph.rejections_in_row,
            morph_state: [self.morph.angle, self.morph.rate],
            morph_covariance: self.morph.covariance,
            counters: self.counters,
        }
    }
}

impl FilterMemory {
    /// The filter parts written into this memory, for a monitor window of `nis_window` fixes.
    pub(super) fn evolving(&self, nis_window: usize) -> Result<Evolving, MemoryError> {
        Ok(Evolving {
            base: self.base.belief()?,
            head: self.head.belief()?,
            history: self.history()?,
            readings: self.readings()?,
            next_reading_ns: self.next_reading_ns,
            readings_gated_in_row: self.readings_gated_in_row,
            last_fix_captured_ns: (self.has_fix != 0).then_some(self.last_fix_captured_ns),
            last_fix_accepted_ns: self.last_fix_accepted_ns,
            monitor: self.monitor(nis_window)?,
            morph: self.morph()?,
            counters: self.counters,
        })
    }

    fn history(&self) -> Result<History, MemoryError> {
        let length = index("history length", self.history_length, HISTORY_CAPACITY)?;
        let mut history = History::new();
        for sample in &self.history[..length] {
            finite("history", [sample.gyro, sample.accel].as_flattened())?;
            history.push(ImuSample {
                time_ns: sample.time_ns,
                gyro_rad_s: sample.gyro.into(),
                accel_m_s2: sample.accel.into(),
            });
        }
        Ok(history)
    }

    fn readings(&self) -> Result<Readings, MemoryError> {
        let length = index("number of readings", self.readings_length, READINGS_CAPACITY)?;
        let mut readings = Readings::new();
        for ReadingMemory { time_ns, of, value } in &self.readings[..length] {
            finite("readings", &[*value])?;
            let of = usize::try_from(*of).ok().and_then(Scalar::at);
            let of = of.ok_or(MemoryError::OutOfRange("sensor"))?;
            let _place = readings.insert(Reading { time_ns: *time_ns, of, value: *value });
        }
        Ok(readings)
    }

    fn monitor(&self, nis_window: usize) -> Result<Monitor, MemoryError> {
        finite("innovations", self.nis_window.as_flattened())?;
        finite("last NIS", &[self.last_nis])?;
        finite("noise of fixes", &[self.fix_noise_scale])?;
        Ok(Monitor {
            window: self.nis_window.map(Vector6::from),
            next: index("window position", self.nis_next, nis_window - 1)?,
            filled: index("window filling", self.nis_filled, nis_window)?,
            rejections_in_row: self.rejections_in_row,
            reopen_level: u32::try_from(self.reopen_level)
                .map_err(|_| MemoryError::OutOfRange("re-opening level"))?,
            alarm: self.nis_alarm != 0,
            last_nis: self.last_nis,
            noise_scale: self.fix_noise_scale.max(1.0),
        })
    }

    fn morph(&self) -> Result<MorphFilter, MemoryError> {
        finite("morph angle", &self.morph_state)?;
        finite("morph covariance", &self.morph_covariance)?;
        Ok(MorphFilter {
            time_ns: self.morph_time_ns,
            started: self.morph_started != 0,
            angle: self.morph_state[0],
            rate: self.morph_state[1],
            covariance: self.morph_covariance,
            rejections_in_row: self.morph_rejections_in_row,
        })
    }
}

fn finite(name: &'static str, values: &[f64]) -> Result<(), MemoryError> {
    values.iter().all(|x| x.is_finite()).then_some(()).ok_or(MemoryError::NotFinite(name))
}

fn index(name: &'static str, value: u64, largest: usize) -> Result<usize, MemoryError> {
    usize::try_from(value).ok().filter(|v| *v <= largest).ok_or(MemoryError::OutOfRange(name))
}
