//! A recording's samples, counted and judged again.

use super::AuditRow;
use super::orders::Pursuits;
use crate::record::read::{ReadError, RecordVisitor, RecordedFlight};
use crate::record::{STATES, SequenceAudit, Stream, name_gaps};
use crate::run::{FlightHash, LogHash, Metrics};
use shared_types::{Header, Role, Sample, Topic, topics};
use std::collections::BTreeMap;

/// What the samples say.
#[derive(Debug)]
pub(super) struct Observed {
    pub(super) metrics: Metrics,
    pub(super) flight_hash: String,
    pub(super) log_hash: String,
    pub(super) pursuits: Pursuits,
    audit: SequenceAudit,
}

/// Sees every sample once.
struct Observer {
    metrics: Metrics,
    hashes: (FlightHash, LogHash),
    audit: SequenceAudit,
    streams: BTreeMap<&'static str, Stream>,
    states: BTreeMap<&'static str, Stream>,
    pursuits: Pursuits,
}

impl RecordVisitor for Observer {
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.metrics.observe(topic, sample);
        self.pursuits.sample(topic, sample);
        self.hashes.0.add(&topic.info, sample);
        self.hashes.1.add(&topic.info, sample);
        if let Some(stream) = self.streams.get(topic.info.name) {
            self.audit.observe(*stream, sample.header());
        }
    }

    fn state(&mut self, role: Role, header: &Header, _state: &[u8]) {
        if let Some(stream) = self.states.get(role.label()) {
            self.audit.observe(*stream, header);
        }
    }
}

impl Observed {
    pub(super) fn of(flight: &RecordedFlight) -> Result<Self, ReadError> {
        let mut audit = SequenceAudit::default();
        let names = topics::all().into_iter().map(|info| info.name);
        let streams = names.map(|name| (name, audit.register(name))).collect();
        let labels = Role::STEPPING.into_iter().map(Role::label);
        let states = labels.map(|of| (of, audit.register(format!("{STATES}{of}")))).collect();
        let metrics = Metrics::of(flight.scenario());
        let hashes = (FlightHash::default(), LogHash::default());
        let pursuits = Pursuits::default();
        let mut observer = Observer { metrics, hashes, audit, streams, states, pursuits };
        flight.visit(&mut observer)?;
        let Observer { mut metrics, hashes: (flight_hash, log_hash), audit, pursuits, .. } =
            observer;
        metrics.finish();
        let (flight_hash, log_hash) = (flight_hash.hex(), log_hash.hex());
        Ok(Self { metrics, flight_hash, log_hash, pursuits, audit })
    }

    /// By topic and seat.
    pub(super) fn audit_rows(&self) -> Vec<AuditRow> {
        let rows = self.audit.tallies().map(|(topic, seat, tally)| AuditRow {
            topic: topic.to_owned(),
            seat,
            writers: tally.writers,
            samples: tally.count,
            first: tally.first,
            last: tally.last,
            gaps: tally.gaps,
        });
        rows.collect()
    }

    /// Samples in the file.
    pub(super) fn samples(&self) -> u64 {
        self.audit.samples()
    }

    /// Sequence numbers missing between those in the file, and whose they are.
    pub(super) fn gaps(&self) -> (u64, String) {
        let gaps = self.audit.gaps();
        (gaps.iter().map(|(_, count)| count).sum(), name_gaps(&gaps))
    }

    /// What a summary would say of these samples, under the same names.
    fn summary(&self) -> BTreeMap<String, String> {
        let tracking = self.metrics.tracking();
        let loops = self.metrics.loops();
        let stats = || loops.iter();
        let entries = [
            ("position_rms_m", format!("{:.6}", tracking.rms_m)),
            ("position_max_m", format!("{:.6}", tracking.max_m)),
            ("constraint_violations", self.metrics.violations().to_string()),
            (
                "missed_ticks",
                stats().map(|s| s.skipped + s.input_deadline_misses).sum::<u64>().to_string(),
            ),
            ("late_samples", stats().map(|s| s.late_samples).sum::<u64>().to_string()),
            ("dropped_samples", self.gaps().0.to_string()),
            ("safe_mode_episodes", self.metrics.gate().safe_mode_episodes.to_string()),
            ("hash", self.flight_hash.clone()),
        ];
        entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }
}

/// Counts again what the summary of a recording would say that has none.
///
/// # Errors
/// The file is damaged.
pub(crate) fn recount(flight: &RecordedFlight) -> Result<BTreeMap<String, String>, ReadError> {
    Ok(Observed::of(flight)?.summary())
}
