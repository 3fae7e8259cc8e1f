//! A recording's samples, counted and judged again.

use super::AuditRow;
use crate::record::read::{ReadError, RecordVisitor, RecordedFlight};
use crate::record::{SequenceAudit, Stream};
use crate::run::{FlightHash, LogHash, Metrics};
use shared_types::{Sample, Topic, topics};
use std::collections::BTreeMap;

/// What the samples say.
#[derive(Debug)]
pub(super) struct Observed {
    pub(super) metrics: Metrics,
    pub(super) flight_hash: String,
    pub(super) log_hash: String,
    audit: SequenceAudit,
}

/// Sees every sample once.
struct Observer {
    metrics: Metrics,
    hashes: (FlightHash, LogHash),
    audit: SequenceAudit,
    streams: BTreeMap<&'static str, Stream>,
}

impl RecordVisitor for Observer {
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.metrics.observe(topic, sample);
        self.hashes.0.add(&topic.info, sample);
        self.hashes.1.add(&topic.info, sample);
        if let Some(stream) = self.streams.get(topic.info.name) {
            self.audit.observe(*stream, sample.header());
        }
    }
}

impl Observed {
    pub(super) fn of(flight: &RecordedFlight) -> Result<Self, ReadError> {
        let mut audit = SequenceAudit::default();
        let names = topics::all().into_iter().map(|info| info.name);
        let streams = names.map(|name| (name, audit.register(name))).collect();
        let metrics = Metrics::of(flight.scenario());
        let hashes = (FlightHash::default(), LogHash::default());
        let mut observer = Observer { metrics, hashes, audit, streams };
        flight.visit(&mut observer)?;
        let Observer { mut metrics, hashes: (flight_hash, log_hash), audit, .. } = observer;
        metrics.finish();
        let (flight_hash, log_hash) = (flight_hash.hex(), log_hash.hex());
        Ok(Self { metrics, flight_hash, log_hash, audit })
    }

    /// By topic and seat.
    pub(super) fn audit_rows(&self) -> Vec<AuditRow> {
        let rows = self.audit.tallies().map(|(topic, seat, tally)| AuditRow {
            topic: topic.to_owned(),
            seat,
            samples: tally.count,
            first: tally.first,
            last: tally.last,
            gaps: tally.gaps,
        });
        rows.collect()
    }

    /// Samples in the file, and sequence numbers missing between them.
    pub(super) fn samples(&self) -> (u64, u64) {
        let tallies = self.audit.tallies();
        tallies.fold((0, 0), |(count, gaps), (.., tally)| (count + tally.count, gaps + tally.gaps))
    }
}
