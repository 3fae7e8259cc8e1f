//! Samples and states of a flight, faster than a flight publishes them, through shared memory into what a
//! launcher records with.

use crate::burst::Burst;
use core::fmt;
use record::name_gaps;
use record::read::{RecordVisitor, RecordedFlight};
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::{RECORDER_CAPACITY, STATE_DEPTH};
use scenario::Scenario;
use shared_types::{Header, Role, Sample, Topic};
use simulate::{Pin, RunOptions, Speed};
use std::error::Error;
use std::path::Path;

/// How often a launcher drains \[ns\].
const DRAIN_EVERY_NS: u64 = 1_000_000;
/// Times that every ring is filled to the brim.
const FILLS: u64 = 8;

/// What is offered.
#[derive(Debug, Clone)]
pub(crate) struct RecorderPlan {
    /// The flight whose samples and states they are.
    pub(crate) scenario: Scenario,
    /// So many a second.
    pub(crate) per_s: u32,
    /// For so long \[ns\].
    pub(crate) for_ns: u64,
}

/// What became of it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RecorderReport {
    /// Asked for, per second.
    pub(crate) per_s: u32,
    /// Offered at that rate.
    pub(crate) paced: u64,
    /// Time that took \[s\].
    pub(crate) paced_s: f64,
    /// Drained and recorded, of the time at that rate: the share of one processor.
    pub(crate) busy_share: f64,
    /// Each of them \[us\].
    pub(crate) drain_us: f64,
    /// Offered in bursts that fill the rings, each before anything is drained.
    pub(crate) burst: u64,
    /// In one of them.
    pub(crate) per_burst: u64,
    /// Of the flight's own time that one of them holds \[s\].
    pub(crate) burst_holds_s: f64,
    /// Offered per second within a burst, and drained per second after it.
    pub(crate) burst_per_s: [f64; 2],
    /// Samples and states in the file.
    pub(crate) in_file: u64,
    /// What is not, by topic; empty if all is.
    pub(crate) missing: String,
    /// Size of the file.
    pub(crate) bytes: u64,
    /// Why the recording stopped, if it did.
    pub(crate) error: Option<String>,
}

impl RecorderReport {
    /// True if everything that was offered is in the file.
    pub(crate) fn holds(&self) -> bool {
        self.in_file == self.paced + self.burst && self.missing.is_empty() && self.error.is_none()
    }
}

#[derive(Default)]
struct Count(u64);

impl RecordVisitor for Count {
    fn sample<T: Sample>(&mut self, _topic: &'static Topic<T>, _sample: &T) {
        self.0 += 1;
    }
    fn state(&mut self, _role: Role, _header: &Header, _state: &[u8]) {
        self.0 += 1;
    }
}

/// Offers, drains and reads the file in `folder` again.
pub(crate) fn measure(
    plan: &RecorderPlan,
    folder: &Path,
) -> Result<RecorderReport, Box<dyn Error>> {
    let flight_s = plan.scenario.duration_ns() as f64 * 1e-9;
    let options = RunOptions {
        scenario: plan.scenario.clone(),
        speed: Speed::Max,
        record: Some(folder.to_owned()),
        name: None,
        pin: Pin::None,
        disorder: None,
        progress: false,
        live: None,
    };
    let mut burst = Burst::prepare(options, "b0rec")?;
    let (paced, paced_ns, busy_ns) = pace(&mut burst, plan);
    let (mut filled, mut fill_ns, mut drain_ns) = (0, 0, 0);
    for _ in 0..FILLS {
        let begin_ns = mono_now_ns();
        filled += burst.fill();
        let full_ns = mono_now_ns();
        burst.drain();
        fill_ns += full_ns - begin_ns;
        drain_ns += mono_now_ns() - full_ns;
    }
    let per_flight = burst.per_flight();
    let summary = burst.finish()?;
    let path = summary.recording.clone().unwrap_or_default();
    let bytes = std::fs::metadata(&path)?.len();
    let mut count = Count::default();
    let read = RecordedFlight::open(&path).and_then(|flight| flight.visit(&mut count));
    let error = summary.recording_error.clone().or(read.err().map(|error| error.to_string()));
    let per_s = |count: u64, ns: u64| count as f64 * 1e9 / ns.max(1) as f64;
    let per_burst = filled / FILLS;
    Ok(RecorderReport {
        per_s: plan.per_s,
        paced,
        paced_s: paced_ns as f64 * 1e-9,
        busy_share: busy_ns as f64 / paced_ns.max(1) as f64,
        drain_us: busy_ns as f64 * 1e-3 / paced.max(1) as f64,
        burst: filled,
        per_burst,
        burst_holds_s: flight_s * per_burst as f64 / per_flight.max(1) as f64,
        burst_per_s: [per_s(filled, fill_ns), per_s(filled, drain_ns)],
        in_file: count.0,
        missing: name_gaps(&summary.audit.gaps()),
        bytes,
        error,
    })
}

/// Offers so many a second and drains as a launcher does: how many it were, in which time, and how much of
/// it was taken by the recorder \[ns\].
fn pace(burst: &mut Burst, plan: &RecorderPlan) -> (u64, u64, u64) {
    let begin_ns = mono_now_ns();
    let (mut offered, mut busy_ns) = (0, 0);
    loop {
        let now_ns = mono_now_ns();
        let since_ns = (now_ns - begin_ns).min(plan.for_ns);
        let due = u128::from(since_ns) * u128::from(plan.per_s) / 1_000_000_000;
        let due = u64::try_from(due).unwrap_or(u64::MAX);
        burst.offer(due - offered);
        offered = due;
        let drain_ns = mono_now_ns();
        burst.drain();
        let done_ns = mono_now_ns();
        busy_ns += done_ns - drain_ns;
        if since_ns == plan.for_ns {
            return (offered, done_ns - begin_ns, busy_ns);
        }
        sleep_until(now_ns + DRAIN_EVERY_NS);
    }
}

impl fmt::Display for RecorderReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { per_s, paced, paced_s, busy_share, drain_us, per_burst, in_file, .. } = self;
        let all = self.paced + self.burst;
        writeln!(
            f,
            "{per_s} a second for {paced_s:.2} s, drained every millisecond: {paced} offered; \
             the recorder took {drain_us:.2} us of each, {:.0} % of a processor",
            100.0 * busy_share
        )?;
        let [filled, drained] = self.burst_per_s.map(|rate| rate * 1e-3);
        writeln!(
            f,
            "{FILLS} bursts of {per_burst} at {filled:.0} thousand a second before anything was drained, \
             then at {drained:.0} thousand a second"
        )?;
        writeln!(
            f,
            "a burst may be {RECORDER_CAPACITY} samples of a topic and {STATE_DEPTH} states of a seat: \
             {:.2} s of this flight",
            self.burst_holds_s
        )?;
        let size = self.bytes as f64 / all.max(1) as f64;
        writeln!(f, "{in_file} of {all} are in the file, {size:.0} bytes each")?;
        if let Some(error) = &self.error {
            writeln!(f, "recording: {error}")?;
        }
        if self.holds() {
            writeln!(f, "holds: nothing is missing")
        } else {
            writeln!(f, "FAILS: missing are {}", self.missing)
        }
    }
}
