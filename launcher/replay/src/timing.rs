//! The time that the steps of a recorded flight took, as `[[timing]]` of another one.

use record::read::{ReadError, RecordVisitor, RecordedFlight};
use runtime::{Graph, Node};
use shared_types::{Deviation, DeviationKind, Header, Role, Sample, Topic, TopicInfo, topics};
use std::any::Any;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use thiserror::Error;

/// Why a recording does not give the time of its steps.
#[derive(Debug, Error)]
pub enum TimingError {
    /// The file.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Its loops cannot be wired.
    #[error("the recorded scenario cannot be wired: {0}")]
    Wiring(String),
    /// Simulated time stamps samples by when they were computed, and another speed by another clock.
    #[error(
        "it was flown in lockstep or at another speed than 1, and does not show when its steps were due"
    )]
    NoClock,
    /// The rest of the flight would be on time.
    #[error("it is incomplete, and lacks the time of some steps")]
    Incomplete,
    /// More than one process has had the steps of a role.
    #[error("{0} was flown by several processes, and an entry is about one")]
    Several(&'static str),
}

/// An entry for each loop that has published: when each of its steps began after its release, and how long it took.
///
/// # Errors
/// [`TimingError`].
pub fn timing_of(path: &Path) -> Result<String, TimingError> {
    let flight = RecordedFlight::open(path)?;
    let graph =
        flight.scenario().graph().map_err(|error| TimingError::Wiring(error.to_string()))?;
    let (steps, left_out) = (BTreeMap::new(), BTreeMap::new());
    let mut stamps = Stamps { graph: &graph, steps, left_out, several: None };
    let closing = flight.visit(&mut stamps)?;
    closing.require_no_holes(path)?;
    let lacks = closing.audit.iter().any(|(channel, tally)| {
        let name = channel.trim_start_matches('/').split('#').next();
        let mut wanted = topics::all().into_iter().filter(|topic| stamps.wants(topic));
        wanted.any(|topic| Some(topic.name) == name) && !tally.contains("\"gaps\":0,")
    });
    if !closing.complete || lacks || flight.continued().is_some() {
        return Err(TimingError::Incomplete);
    }
    if let Some(role) = stamps.several {
        return Err(TimingError::Several(role.label()));
    }
    // The plant is due at each release, by whatever clock.
    let plant = stamps.steps.get(Role::Plant.label());
    let starts = plant.into_iter().flat_map(BTreeMap::values);
    let mut starts = starts.map(|header| header.release_mono_ns.checked_sub(header.release_ns));
    let start_mono_ns = starts.next().flatten().ok_or(TimingError::NoClock)?;
    if starts.any(|start| start != Some(start_mono_ns)) {
        return Err(TimingError::NoClock);
    }
    let mut text = String::new();
    for node in graph.nodes() {
        if let Some(steps) = stamps.steps.get(node.role.label()) {
            let left_out = stamps.left_out.remove(node.role.label()).unwrap_or_default();
            write_entry(&mut text, node, (steps, left_out), start_mono_ns);
        }
    }
    Ok(text)
}

fn write_entry(
    text: &mut String,
    node: &Node,
    (steps, mut left_out): (&BTreeMap<u64, Header>, Vec<[u64; 2]>),
    start_mono_ns: u64,
) {
    let last_ns = steps.keys().next_back().copied().unwrap_or(0);
    let releases = (0..).map(|k| node.rate.release_ns(k)).take_while(|t_ns| *t_ns <= last_ns);
    let rows = releases.map(|release_ns| match steps.get(&release_ns) {
        None => "[]".to_owned(),
        Some(Header { start_mono_ns: begin_ns, publish_mono_ns, .. }) => {
            let due_ns = start_mono_ns.saturating_add(release_ns);
            let begin_after_ns = i128::from(*begin_ns) - i128::from(due_ns);
            format!("[{begin_after_ns},{}]", publish_mono_ns.saturating_sub(*begin_ns))
        }
    });
    // Those for which none came after them any more.
    left_out.retain(|[_, last]| node.rate.release_ns(*last) < last_ns);
    // A string takes everything.
    let _ = write!(
        text,
        "[[timing]]\nloop = {:?}\nrecorded = {{ rate_hz = {:?}, steps_ns = [{}], left_out = {left_out:?} }}\n",
        node.role.label(),
        node.rate.hz(),
        rows.collect::<Vec<_>>().join(",")
    );
}

/// The first header of each step, by its loop and release.
struct Stamps<'a> {
    graph: &'a Graph,
    steps: BTreeMap<&'static str, BTreeMap<u64, Header>>,
    /// Numbers of the first and the last release that a loop left out in a row.
    left_out: BTreeMap<&'static str, Vec<[u64; 2]>>,
    several: Option<Role>,
}

impl RecordVisitor for Stamps<'_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        topic.from.is_stepping() || topic.name == topics::DEVIATION.info.name
    }

    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        if let Some(deviation) = (sample as &dyn Any).downcast_ref::<Deviation>() {
            if deviation.kind == DeviationKind::SkippedReleases {
                let left_out = self.left_out.entry(deviation.role.label()).or_default();
                left_out.push([deviation.first, deviation.last]);
            }
            return;
        }
        let (role, header) = (self.graph.producer(&topic.info), sample.header());
        if header.seat > 0 || header.generation > 0 {
            self.several = Some(role);
        }
        let steps = self.steps.entry(role.label()).or_default();
        steps.entry(header.release_ns).or_insert(*header);
    }
}
