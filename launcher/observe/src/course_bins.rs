//! Distances from the path and errors of the heading, in bins of a tenth of a second that wait until it is known what they count for.

use ::verdict::{Tracking, worst};
use std::collections::VecDeque;

/// Length of a bin \[ns\].
const BIN_NS: u64 = 100_000_000;
/// Bins of a second.
const SECOND: usize = 10;

/// How far off its path a vehicle is at an instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Off {
    /// Distance \[m\].
    pub(super) distance_m: f64,
    /// Error of the heading, without its sign \[rad\].
    pub(super) heading_rad: f64,
}

/// Errors of a tenth of a second.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bin {
    index: u64,
    count: u64,
    sum_m: f64,
    squares_m2: f64,
    max_m: f64,
    max_at_ns: u64,
    heading_rad: f64,
    heading_at_ns: u64,
}

impl Bin {
    pub(super) fn begin_ns(&self) -> u64 {
        self.index.saturating_mul(BIN_NS)
    }

    pub(super) fn end_ns(&self) -> u64 {
        self.begin_ns().saturating_add(BIN_NS - 1)
    }
}

/// Errors so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Errors {
    /// In the order of time, none of them settled.
    waiting: VecDeque<Bin>,
    /// The last second that belongs to no recovery.
    second: VecDeque<Bin>,
    tracking: Tracking,
    squares_m2: f64,
    calm: u64,
    total: u64,
}

impl Errors {
    /// Takes an error; they come in the order of time.
    pub(super) fn add(&mut self, t_ns: u64, off: Off) {
        let Off { distance_m: error_m, heading_rad } = off;
        self.total += 1;
        let index = t_ns / BIN_NS;
        if self.waiting.back().is_none_or(|bin| bin.index < index) {
            self.waiting.push_back(Bin {
                index,
                count: 0,
                sum_m: 0.0,
                squares_m2: 0.0,
                max_m: 0.0,
                max_at_ns: t_ns,
                heading_rad: 0.0,
                heading_at_ns: t_ns,
            });
        }
        let Some(bin) = self.waiting.back_mut() else { return };
        bin.count += 1;
        bin.sum_m += error_m;
        bin.squares_m2 += error_m * error_m;
        if exceeds(error_m, bin.max_m) {
            (bin.max_m, bin.max_at_ns) = (error_m, t_ns);
        }
        if exceeds(heading_rad, bin.heading_rad) {
            (bin.heading_rad, bin.heading_at_ns) = (heading_rad, t_ns);
        }
    }

    /// Counts every bin that ends before `until_ns`.
    pub(super) fn settle(&mut self, until_ns: u64, is_recovery: &dyn Fn(&Bin) -> bool) {
        while let Some(bin) = self.waiting.front().copied().filter(|bin| bin.end_ns() < until_ns) {
            self.waiting.pop_front();
            let tracking = &mut self.tracking;
            if is_recovery(&bin) {
                if exceeds(bin.max_m, tracking.recovering_m) {
                    tracking.recovering_m = bin.max_m;
                    tracking.recovering_at_s = bin.max_at_ns as f64 * 1e-9;
                }
                self.second.clear();
                continue;
            }
            if exceeds(bin.max_m, tracking.max_m) {
                (tracking.max_m, tracking.max_at_s) = (bin.max_m, bin.max_at_ns as f64 * 1e-9);
            }
            if exceeds(bin.heading_rad, tracking.heading_rad) {
                tracking.heading_rad = bin.heading_rad;
                tracking.heading_at_s = bin.heading_at_ns as f64 * 1e-9;
            }
            self.squares_m2 += bin.squares_m2;
            self.calm += bin.count;
            self.sustain(bin);
        }
    }

    /// Whether a whole second went by without a recovery, and how far off it was on average.
    fn sustain(&mut self, bin: Bin) {
        if self.second.back().is_some_and(|last| last.index + 1 != bin.index) {
            self.second.clear();
        }
        self.second.push_back(bin);
        if self.second.len() > SECOND {
            self.second.pop_front();
        }
        if self.second.len() < SECOND {
            return;
        }
        let count: u64 = self.second.iter().map(|bin| bin.count).sum();
        let sum_m: f64 = self.second.iter().map(|bin| bin.sum_m).sum();
        let mean_m = sum_m / count.max(1) as f64;
        if exceeds(mean_m, self.tracking.sustained_m) {
            self.tracking.sustained_m = mean_m;
            self.tracking.sustained_at_s = bin.end_ns().saturating_add(1) as f64 * 1e-9;
        }
    }

    /// What came of it, with the mean over the last second; none without an error.
    pub(super) fn tracking(&self, end_m: f64) -> Option<Tracking> {
        let rms_m = (self.squares_m2 / self.calm.max(1) as f64).sqrt();
        (self.total > 0).then_some(Tracking { rms_m, end_m, ..self.tracking })
    }
}

/// True if a measurement is worse than the worst so far; what is no number is, once.
fn exceeds(value: f64, most: f64) -> bool {
    worst(value, most).to_bits() != most.to_bits() && !most.is_nan()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn errors(of: impl Fn(u64) -> f64, until_ms: u64) -> Errors {
        let mut errors = Errors::default();
        for t_ms in 0..until_ms {
            errors.add(t_ms * MS, Off { distance_m: of(t_ms), heading_rad: 0.1 * of(t_ms) });
        }
        errors
    }

    #[test]
    fn a_peak_within_a_recovery_counts_apart_from_the_others() {
        let mut errors = errors(|t_ms| if t_ms == 1_250 { 0.7 } else { 0.01 }, 4_000);
        errors.settle(u64::MAX, &|bin| bin.begin_ns() >= 1_000 * MS && bin.end_ns() < 2_000 * MS);
        let tracking = errors.tracking(0.01).unwrap();
        assert!((tracking.recovering_m - 0.7).abs() < 1e-12, "{tracking:?}");
        assert!((tracking.recovering_at_s - 1.25).abs() < 1e-9, "{tracking:?}");
        assert!((tracking.max_m - 0.01).abs() < 1e-12, "{tracking:?}");
        assert!((tracking.heading_rad - 0.001).abs() < 1e-12, "{tracking:?}");
        assert!((tracking.rms_m - 0.01).abs() < 1e-12, "{tracking:?}");
    }

    #[test]
    fn what_lasts_for_a_second_is_its_mean_and_what_is_shorter_is_left_out() {
        let mut short = errors(|_| 0.2, 900);
        short.settle(u64::MAX, &|_| false);
        assert!(short.tracking(0.2).unwrap().sustained_m.abs() < 1e-12);
        let mut long = errors(|t_ms| if t_ms < 2_000 { 0.2 } else { 0.1 }, 4_000);
        long.settle(u64::MAX, &|_| false);
        let tracking = long.tracking(0.1).unwrap();
        assert!((tracking.sustained_m - 0.2).abs() < 1e-9, "{tracking:?}");
        assert!(tracking.sustained_at_s <= 2.0, "{tracking:?}");
    }

    #[test]
    fn an_error_that_is_no_number_is_the_largest_ever_after() {
        let mut errors = errors(|t_ms| if t_ms == 500 { f64::NAN } else { 0.1 }, 3_000);
        errors.settle(u64::MAX, &|_| false);
        let tracking = errors.tracking(0.1).unwrap();
        assert!(tracking.max_m.is_nan() && tracking.rms_m.is_nan(), "{tracking:?}");
        assert!((tracking.max_at_s - 0.5).abs() < 1e-9, "{tracking:?}");
        assert!(tracking.heading_rad.is_nan(), "{tracking:?}");
        assert!((tracking.heading_at_s - 0.5).abs() < 1e-9, "{tracking:?}");
    }

    #[test]
    fn nothing_was_measured_where_no_error_came() {
        assert_eq!(Errors::default().tracking(0.0), None);
    }
}
