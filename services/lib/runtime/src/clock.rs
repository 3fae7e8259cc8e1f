//! The only place that reads host time or sleeps.

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};
use shared_types::ClockRecord;

/// `CLOCK_MONOTONIC` now \[ns\].
#[must_use]
pub fn mono_now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

/// Unix time now \[ns\], for labels only.
#[must_use]
pub fn unix_now_ns() -> u64 {
    let now = clock_gettime(ClockId::Realtime);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

/// Processor that the calling thread runs on.
#[must_use]
pub fn current_cpu() -> usize {
    rustix::thread::sched_getcpu()
}

/// Sleeps until an absolute instant of `CLOCK_MONOTONIC`; a signal ends the sleep early.
pub fn sleep_until(mono_ns: u64) {
    let until = Timespec {
        tv_sec: i64::try_from(mono_ns / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(mono_ns % 1_000_000_000).unwrap_or(0),
    };
    // An interrupted sleep is not an error: the caller re-checks why it slept.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &until);
}

/// Maps between logical time and the host clock of a realtime flight.
#[derive(Debug, Clone, Copy)]
pub struct WallMap {
    start_mono_ns: u64,
    speed: f64,
}

impl WallMap {
    /// The map announced by the conductor.
    #[must_use]
    pub fn new(record: &ClockRecord) -> Self {
        let speed = if record.speed > 0.0 && record.speed.is_finite() { record.speed } else { 1.0 };
        Self { start_mono_ns: record.start_mono_ns, speed }
    }

    /// Host instant of a logical one, which may lie before the start \[ns\].
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "non-negative")]
    pub fn mono_ns(&self, logical_ns: u64) -> u64 {
        if (self.speed - 1.0).abs() < f64::EPSILON {
            return self.start_mono_ns.saturating_add(logical_ns);
        }
        self.start_mono_ns.saturating_add((logical_ns as f64 / self.speed) as u64)
    }

    /// Host instant that lies a logical time before a logical instant \[ns\].
    #[must_use]
    pub fn mono_ns_ahead(&self, logical_ns: u64, lead_ns: u64) -> u64 {
        let lead = self.mono_ns(lead_ns) - self.start_mono_ns;
        self.mono_ns(logical_ns).saturating_sub(lead)
    }

    /// Logical instant of a host one; 0 before the start \[ns\].
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "non-negative")]
    pub fn logical_ns(&self, mono_ns: u64) -> u64 {
        let elapsed = mono_ns.saturating_sub(self.start_mono_ns);
        if (self.speed - 1.0).abs() < f64::EPSILON {
            return elapsed;
        }
        (elapsed as f64 * self.speed) as u64
    }
}
