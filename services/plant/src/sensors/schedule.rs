//! When a sensor samples, and when what it reads is lost.

use super::config::DropOut;
use shared_types::time::ns_from_s;

/// Nanoseconds in a second.
const SECOND_NS: u128 = 1_000_000_000;

/// Spans in which what a sensor reads is lost.
#[derive(Debug, Clone)]
pub(super) struct DropOuts(Vec<(u64, u64)>);

impl DropOuts {
    pub(super) fn new(spans: &[DropOut]) -> Self {
        Self(spans.iter().map(|d| (ns_from_s(d.from_s), ns_from_s(d.until_s))).collect())
    }

    pub(super) fn contains(&self, now_ns: u64) -> bool {
        self.0.iter().any(|(from, until)| (*from..*until).contains(&now_ns))
    }
}

/// Releases of a loop: release k at floor(k · 10⁹ / rate) ns, in integers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Schedule {
    rate_hz: u32,
    next_index: u64,
}

impl Schedule {
    /// At 0 Hz there is no release.
    pub(super) fn new(rate_hz: u32) -> Self {
        Self { rate_hz, next_index: 0 }
    }

    /// Index of the next release.
    pub(super) fn next_index(&self) -> u64 {
        self.next_index
    }

    /// Continues at the release of this index.
    pub(super) fn set_next_index(&mut self, next_index: u64) {
        self.next_index = next_index;
    }

    /// Instant of the next release.
    pub(super) fn next_ns(&self) -> u64 {
        let nanoseconds = u128::from(self.next_index) * SECOND_NS;
        let instant = nanoseconds.checked_div(u128::from(self.rate_hz));
        instant.and_then(|instant| u64::try_from(instant).ok()).unwrap_or(u64::MAX)
    }

    /// How many releases `now_ns` has reached since the last call; the next one then lies after
    /// `now_ns`.
    pub(super) fn take(&mut self, now_ns: u64) -> u64 {
        if self.rate_hz == 0 || now_ns < self.next_ns() {
            return 0;
        }
        // floor(k 10⁹ / r) > now holds from k = ceil((now + 1) r / 10⁹) on.
        let ticks = (u128::from(now_ns) + 1) * u128::from(self.rate_hz);
        let after = u64::try_from(ticks.div_ceil(SECOND_NS)).unwrap_or(u64::MAX);
        let passed = after.saturating_sub(self.next_index);
        self.next_index = after;
        passed
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn at_150_hz_the_releases_are_whole_nanoseconds_and_do_not_drift() {
        let mut schedule = Schedule::new(150);
        let releases: Vec<u64> = (0..301)
            .map(|_| {
                let at = schedule.next_ns();
                assert_eq!(schedule.take(at), 1);
                at
            })
            .collect();
        assert_eq!(releases[..4], [0, 6_666_666, 13_333_333, 20_000_000]);
        assert_eq!(releases[300], 2_000_000_000);
    }

    #[test]
    fn releases_that_a_slow_caller_passed_are_counted_once() {
        let mut schedule = Schedule::new(1000);
        assert_eq!(schedule.take(0), 1);
        assert_eq!(schedule.take(999_999), 0);
        assert_eq!(schedule.take(4_500_000), 4);
        assert_eq!(schedule.next_ns(), 5_000_000);
    }

    proptest! {
        #[test]
        fn after_taking_the_next_release_is_the_first_one_after_now(
            rate in 1_u32..=10_000, now in 0_u64..10_000_000_000_000
        ) {
            let mut schedule = Schedule::new(rate);
            schedule.take(now);
            prop_assert!(schedule.next_ns() > now);
            schedule.set_next_index(schedule.next_index() - 1);
            prop_assert!(schedule.next_ns() <= now);
        }
    }
}
