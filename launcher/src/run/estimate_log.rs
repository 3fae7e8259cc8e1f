//! What the estimates of a flight say about themselves: how long they stood on no sensor.

use shared_types::{Sample as _, StateEstimate};

/// More changes than this are counted and not told one by one.
const NEWS_MAX: u64 = 200;

/// Silence of the estimator's sensors, counted, and told when it begins and ends.
#[derive(Debug, Clone, Default)]
pub struct EstimateLog {
    imu_overdue: Silence,
    fix_overdue: Silence,
    told: u64,
    news: Vec<(u64, String)>,
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
            let text = match self.imu_overdue.from_ns {
                Some(_) => format!(
                    "no IMU sample since {:.3} s: the estimate stays that of this instant",
                    estimate.described_ns() as f64 * 1e-9
                ),
                None => "IMU samples come again".to_owned(),
            };
            self.tell(at_ns, text);
        }
        if self.fix_overdue.observe(estimate.fix_overdue.is_set(), at_ns) {
            let text = match self.fix_overdue.from_ns {
                Some(_) => "no pose fix is accepted: the estimate drifts".to_owned(),
                None => "pose fixes are accepted again".to_owned(),
            };
            self.tell(at_ns, text);
        }
    }

    fn tell(&mut self, at_ns: u64, text: String) {
        self.told += 1;
        if self.told <= NEWS_MAX {
            self.news.push((at_ns, text));
        }
    }

    /// Instant \[ns\] and text of what has not been told yet.
    pub(super) fn take_news(&mut self) -> Vec<(u64, String)> {
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
