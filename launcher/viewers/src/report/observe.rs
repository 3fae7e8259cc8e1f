//! A recording's samples, counted and judged again.

use super::AuditRow;
use super::pursuits::Pursuits;
use ::verdict::{End, Outcome, Verdict};
use observe::{
    ENDED, FLOWN_NS, Facts, FlightHash, LogHash, Metrics, describe_end, kept_hash, read_end,
};
use record::read::{Closing, ReadError, RecordVisitor, RecordedFlight};
use record::{SequenceAudit, Stream, content, name_gaps};
use serde_json::{Map, Value};
use shared_types::{Sample, Topic, Truth, topics};
use std::any::Any;
use std::collections::BTreeMap;

/// What follows from the samples.
#[derive(Debug)]
pub(crate) struct Observed {
    pub(super) metrics: Metrics,
    /// What it is judged by.
    pub(super) outcome: Outcome,
    /// What is reported of it.
    pub(super) facts: Facts,
    verdict: Verdict,
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
    pursuits: Pursuits,
    /// Last instant of the vehicle \[ns\].
    until_ns: u64,
}

impl RecordVisitor for Observer {
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if any.is::<Truth>() {
            self.until_ns = sample.header().valid_ns;
        }
        self.metrics.observe(topic, sample);
        self.pursuits.sample(topic, sample);
        self.hashes.0.add(&topic.info, sample);
        self.hashes.1.add(&topic.info, sample);
        if let Some(stream) = self.streams.get(topic.info.name) {
            self.audit.observe(*stream, sample.header(), content(&topic.info, sample));
        }
    }
}

impl Observed {
    /// Goes through a recording.
    ///
    /// # Errors
    /// The file is damaged.
    pub(crate) fn of(flight: &RecordedFlight) -> Result<Self, ReadError> {
        let mut audit = SequenceAudit::default();
        let names = topics::all().into_iter().map(|info| info.name);
        let streams = names.map(|name| (name, audit.register(name))).collect();
        let metrics = Metrics::of(flight.scenario());
        let hashes = (FlightHash::default(), LogHash::default());
        let pursuits = Pursuits::default();
        let mut observer = Observer { metrics, hashes, audit, streams, pursuits, until_ns: 0 };
        let closing = flight.visit(&mut observer)?;
        let Observer { mut metrics, hashes, audit, pursuits, until_ns, .. } = observer;
        metrics.finish();
        let (flight_hash, log_hash) = (hashes.0.hex(), hashes.1.hex());
        let mut ending = ending(&closing, until_ns);
        ending.altered = [("hash", &flight_hash), ("log_hash", &log_hash)]
            .into_iter()
            .map(|(key, hash)| kept_hash(&closing.summary, key).is_some_and(|kept| kept != hash))
            .map(u64::from)
            .sum();
        let gaps = audit.gaps();
        let lost = gaps.iter().map(|(_, count)| count).sum();
        ending.dropped = (lost, if lost > 0 { name_gaps(&gaps) } else { String::new() });
        let (outcome, verdict) = (metrics.outcome(&ending), metrics.judge(&ending));
        let facts = Facts::of(&metrics, &outcome);
        Ok(Self { metrics, outcome, facts, verdict, flight_hash, log_hash, pursuits, audit })
    }

    /// The verdict on the flight: the one that its own summary has, if it was recorded to its end.
    pub(crate) fn verdict(&self) -> &Verdict {
        &self.verdict
    }

    /// The line that every output about this flight begins with.
    pub(crate) fn line(&self) -> String {
        self.metrics.line(&self.verdict)
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

    /// What the summary of a flight has too, as numbers.
    pub(super) fn measured(&self) -> Map<String, Value> {
        let mut measured = self.facts.to_json();
        measured.insert("hash".to_owned(), self.flight_hash.clone().into());
        measured.insert("log_hash".to_owned(), self.log_hash.clone().into());
        measured.insert(ENDED.to_owned(), describe_end(&self.outcome.end).into());
        measured
    }

    /// What a summary of these samples would have, under the same names.
    pub(crate) fn summary(&self) -> BTreeMap<String, String> {
        let facts = self.facts.iter().map(|(fact, value)| (fact.key.to_owned(), fact.text(value)));
        facts.chain([("hash".to_owned(), self.flight_hash.clone())]).collect()
    }
}

/// How a flight ended if its recording ends like this, with the vehicle at `until_ns`.
fn ending(closing: &Closing, until_ns: u64) -> ::observe::Closing {
    let unrecorded = closing.has_holes().then(|| format!("the file has holes, {closing}"));
    let (end, flown_ns) = if closing.summary.is_empty() {
        let until_s = until_ns as f64 * 1e-9;
        (End::Cut(format!("the file ends at {until_s:.3} s, {closing}")), until_ns)
    } else {
        let entry = |key: &str| closing.summary.get(key);
        let end =
            entry(ENDED).map_or_else(|| before_there_were_verdicts(closing), |text| read_end(text));
        let flown_ns = entry(FLOWN_NS).and_then(|text| text.parse().ok());
        (end, flown_ns.unwrap_or(until_ns))
    };
    let is_cut = !closing.complete;
    ::observe::Closing { end, flown_ns, unrecorded, is_cut, ..::observe::Closing::default() }
}

/// The end of a flight if its summary has only the outcome as text.
fn before_there_were_verdicts(closing: &Closing) -> End {
    let outcome = closing.summary.get("outcome").map_or("", String::as_str);
    match outcome.strip_prefix("lost: ") {
        Some(why) => End::Crashed(why.to_owned()),
        None if outcome == "interrupted" => End::Interrupted,
        None => End::Planned,
    }
}
