//! What the estimates of a flight report about themselves: how long they stood on no sensor.

use record::Severity;
use shared_types::{Sample as _, StateEstimate};

/// More changes than this are counted and not reported one by one.
const NEWS_MAX: u64 = 200;

/// Silence of the estimator's sensors, counted, and reported when it begins and ends.
#[derive(Debug, Clone, Default)]
pub struct EstimateLog {
    imu_overdue: Silence,
    fix_overdue: Silence,
    reported: u64,
    news: Vec<(u64, Severity, String)>,
}

/// Spans in which one sensor was overdue.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Silence {
    /// How many there were.
    pub episodes: u64,
    /// Estimates made in them.
    pub steps: u64,
    from_ns: Option<u64>,
}

impl Silence {
    /// Takes the next estimate; true if something has begun or ended.
    fn observe(&mut self, is_overdue: bool, at_ns: u64) -> bool {
        self.steps += u64::from(is_overdue);
        let has_changed = is_overdue != self.from_ns.is_some();
        if has_changed {
            self.episodes += u64::from(is_overdue);
            self.from_ns = is_overdue.then_some(at_ns);
        }
        has_changed
    }
}

impl EstimateLog {
    pub(super) fn observe(&mut self, estimate: &StateEstimate) {
        let at_ns = estimate.header.release_ns;
        if self.imu_overdue.observe(estimate.imu_overdue.is_set(), at_ns) {
            let since_s = estimate.described_ns() as f64 * 1e-9;
            let begins = format!(
                "no IMU sample since {since_s:.3} s: the estimate stays that of this instant"
            );
            self.report(at_ns, self.imu_overdue, &begins, "IMU samples come again");
        }
        if self.fix_overdue.observe(estimate.fix_overdue.is_set(), at_ns) {
            let begins = "no pose fix is accepted: the estimate drifts";
            self.report(at_ns, self.fix_overdue, begins, "pose fixes are accepted again");
        }
    }

    /// Notes that a silence has just begun or ended.
    fn report(&mut self, at_ns: u64, silence: Silence, begins: &str, ends: &str) {
        self.reported += 1;
        if self.reported > NEWS_MAX {
            return;
        }
        let (severity, text) = match silence.from_ns {
            Some(_) => (Severity::Warning, begins),
            None => (Severity::Info, ends),
        };
        self.news.push((at_ns, severity, text.to_owned()));
    }

    /// Instant \[ns\], severity and text of what has not been taken yet.
    pub(super) fn take_news(&mut self) -> Vec<(u64, Severity, String)> {
        core::mem::take(&mut self.news)
    }

    /// Spans without IMU samples.
    #[must_use]
    pub fn imu_overdue(&self) -> Silence {
        self.imu_overdue
    }

    /// Spans without accepted pose fixes.
    #[must_use]
    pub fn fix_overdue(&self) -> Silence {
        self.fix_overdue
    }
}
