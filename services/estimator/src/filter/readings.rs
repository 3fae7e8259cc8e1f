//! Readings of one number since the base belief: fixed room, oldest first.

use super::scalar::{Reading, Scalar};

/// As many as two sensors of 500 Hz give while the history of a 1 kHz IMU reaches back. Of more, the oldest are not
/// replayed after a fix.
pub(super) const READINGS_CAPACITY: usize = 64;

#[derive(Debug, Clone)]
pub(super) struct Readings {
    readings: [Reading; READINGS_CAPACITY],
    length: usize,
}

impl Readings {
    pub(super) fn new() -> Self {
        let none = Reading { time_ns: 0, of: Scalar::Barometer, value: 0.0 };
        Self { readings: [none; READINGS_CAPACITY], length: 0 }
    }

    pub(super) fn all(&self) -> &[Reading] {
        &self.readings[..self.length]
    }

    /// Adds one in the order of time, behind those of the same instant, in place of the oldest if
    /// there is no room; and returns its place.
    pub(super) fn insert(&mut self, reading: Reading) -> usize {
        if self.length == READINGS_CAPACITY {
            self.forget(1);
        }
        let at = self.all().partition_point(|other| other.time_ns <= reading.time_ns);
        self.readings.copy_within(at..self.length, at + 1);
        self.readings[at] = reading;
        self.length += 1;
        at
    }

    /// How many there are until an instant.
    pub(super) fn until(&self, time_ns: u64) -> usize {
        self.all().partition_point(|reading| reading.time_ns <= time_ns)
    }

    /// Forgets the oldest.
    pub(super) fn forget(&mut self, count: usize) {
        let count = count.min(self.length);
        self.readings.copy_within(count..self.length, 0);
        self.length -= count;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time_ns: u64, value: f64) -> Reading {
        Reading { time_ns, of: Scalar::RangeFinder, value }
    }

    #[test]
    fn they_are_kept_in_order_and_the_oldest_are_forgotten() {
        let mut readings = Readings::new();
        for (time_ns, value) in [(10, 0.0), (30, 1.0), (20, 2.0), (20, 3.0), (5, 4.0)] {
            readings.insert(at(time_ns, value));
        }
        let values: Vec<f64> = readings.all().iter().map(|r| r.value).collect();
        assert_eq!(values, [4.0, 0.0, 2.0, 3.0, 1.0]);
        assert_eq!(readings.until(20), 4);
        readings.forget(4);
        assert_eq!(readings.all(), [at(30, 1.0)]);
        readings.forget(1);
        for time_ns in 0..100 {
            readings.insert(at(time_ns, 0.0));
        }
        let kept: Vec<u64> = readings.all().iter().map(|r| r.time_ns).collect();
        assert_eq!(kept, (36..100).collect::<Vec<_>>(), "the newest");
    }
}
