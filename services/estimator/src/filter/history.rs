//! Inertial samples since the base belief: fixed room, oldest first.

use nalgebra::Vector3;

use super::sample::ImuSample;

/// 64 ms at 1 kHz: six times the latency of a fix, in 3.5 kB.
pub(super) const HISTORY_CAPACITY: usize = 64;

const EMPTY: ImuSample = ImuSample {
    time_ns: 0,
    gyro_rad_s: Vector3::new(0.0, 0.0, 0.0),
    accel_m_s2: Vector3::new(0.0, 0.0, 0.0),
};

#[derive(Debug, Clone)]
pub(super) struct History {
    samples: [ImuSample; HISTORY_CAPACITY],
    first: usize,
    length: usize,
}

impl History {
    pub(super) fn new() -> Self {
        Self { samples: [EMPTY; HISTORY_CAPACITY], first: 0, length: 0 }
    }

    pub(super) fn is_full(&self) -> bool {
        self.length == HISTORY_CAPACITY
    }

    pub(super) fn oldest(&self) -> Option<&ImuSample> {
        self.iter().next()
    }

    pub(super) fn pop_oldest(&mut self) -> Option<ImuSample> {
        let sample = *self.oldest()?;
        self.first = (self.first + 1) % HISTORY_CAPACITY;
        self.length -= 1;
        Some(sample)
    }

    /// Appends; the caller has made room, otherwise the oldest sample is lost.
    pub(super) fn push(&mut self, sample: ImuSample) {
        if self.is_full() {
            self.pop_oldest();
        }
        self.samples[(self.first + self.length) % HISTORY_CAPACITY] = sample;
        self.length += 1;
    }

    /// Oldest first.
    pub(super) fn iter(&self) -> impl Iterator<Item = &ImuSample> {
        (0..self.length).map(|i| &self.samples[(self.first + i) % HISTORY_CAPACITY])
    }
}

/// The reading at `time_ns` on the line between two samples, `time_ns` between theirs.
pub(super) fn interpolate(from: &ImuSample, to: &ImuSample, time_ns: u64) -> ImuSample {
    let span = to.time_ns.saturating_sub(from.time_ns).max(1) as f64;
    let share = time_ns.saturating_sub(from.time_ns) as f64 / span;
    ImuSample {
        time_ns,
        gyro_rad_s: from.gyro_rad_s.lerp(&to.gyro_rad_s, share),
        accel_m_s2: from.accel_m_s2.lerp(&to.accel_m_s2, share),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_history_keeps_the_newest_samples_in_order() {
        let mut history = History::new();
        let pushed = HISTORY_CAPACITY as u64 + 10;
        for time_ns in 0..pushed {
            history.push(ImuSample { time_ns, ..EMPTY });
        }
        let kept: Vec<u64> = history.iter().map(|s| s.time_ns).collect();
        assert_eq!(kept, (10..pushed).collect::<Vec<_>>());
        assert_eq!(history.pop_oldest().map(|s| s.time_ns), Some(10));
        assert_eq!(history.iter().count(), HISTORY_CAPACITY - 1);
    }

    #[test]
    fn interpolation_hits_both_ends_and_the_middle() {
        let from = ImuSample { time_ns: 100, ..EMPTY };
        let to = ImuSample {
            time_ns: 200,
            gyro_rad_s: Vector3::new(1.0, 2.0, 3.0),
            accel_m_s2: Vector3::new(-4.0, 0.0, 8.0),
        };
        assert_eq!(interpolate(&from, &to, 100), from);
        assert_eq!(interpolate(&from, &to, 200), to);
        assert_eq!(interpolate(&from, &to, 150).accel_m_s2, Vector3::new(-2.0, 0.0, 4.0));
    }
}
