//! What a recording is worth: one sentence, every number with its gate and the command that gives it again,
//! and pictures.
//!
//! Numbers come from the samples in the file, not from what the flight said of itself: `observe.rs` goes
//! through them, `numbers.rs` judges them, `response.rs` looks at what followed each disturbance, swap and
//! fault, `pictures.rs` draws, `told.rs` writes it down.

mod numbers;
mod observe;
mod pictures;
mod response;
mod told;

pub use numbers::Number;
pub use pictures::pictures;
pub use response::Response;
pub use told::document;

use crate::record::read::RecordedFlight;
use crate::trace::{self, trace};
use crate::view::{Gathered, ViewError, gather};
use observe::Observed;
use serde::Serialize;
use std::collections::BTreeMap;

/// Everything that is told of one recording.
#[derive(Debug)]
pub struct Report {
    /// The file, as it was named.
    pub file: String,
    /// What was flown.
    pub scenario: String,
    /// In one sentence: pass or fail, and why.
    pub sentence: String,
    /// Every number, in the order told.
    pub numbers: Vec<Number>,
    /// What followed what.
    pub responses: Vec<Response>,
    /// Changes of who commands, as the flight told them.
    pub swaps: serde_json::Value,
    /// Samples by topic and seat.
    pub audit: Vec<AuditRow>,
    /// Where the commands' time went.
    pub latency: trace::Report,
    /// Run, build and machine.
    pub facts: BTreeMap<String, String>,
    gathered: Gathered,
    trace: trace::Trace,
}

/// Samples of one seat of one topic.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AuditRow {
    /// Name of the topic.
    pub topic: String,
    /// Seat of the producer.
    pub seat: u32,
    /// In the file.
    pub samples: u64,
    /// Sequence of the first.
    pub first: u64,
    /// Sequence of the last.
    pub last: u64,
    /// Numbers between that are not in the file.
    pub gaps: u64,
}

impl Report {
    /// Goes through a recording, in bounded memory but for the headers of its commands.
    ///
    /// # Errors
    /// The file is damaged, or nothing was flown.
    pub fn of(flight: &RecordedFlight) -> Result<Self, ViewError> {
        let gathered = gather(flight)?;
        let observed = Observed::of(flight)?;
        let trace = trace(flight)?;
        let latency = trace::Report::new(&trace);
        let responses = response::responses(&gathered);
        let numbers = numbers::numbers(flight, &gathered, &observed, &latency);
        let scenario = flight.scenario().settings().scenario.name.clone();
        let swaps =
            gathered.closing.summary.get("swaps").and_then(|t| serde_json::from_str(t).ok());
        Ok(Self {
            file: flight.path().display().to_string(),
            sentence: numbers::sentence(&scenario, &numbers, &observed, &latency),
            scenario,
            numbers,
            responses,
            swaps: swaps.unwrap_or_else(|| serde_json::json!([])),
            audit: observed.audit_rows(),
            latency,
            facts: flight.facts().clone(),
            gathered,
            trace,
        })
    }

    /// True if every gate holds.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.numbers.iter().all(|number| number.holds != Some(false))
    }

    /// For machines.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Value {
        let Self { file, scenario, sentence, numbers, responses, swaps, audit, facts, .. } = self;
        serde_json::json!({
            "file": file, "scenario": scenario, "pass": self.passes(), "sentence": sentence,
            "numbers": numbers, "responses": responses, "swaps": swaps, "audit": audit,
            "latency": self.latency.to_json(), "facts": facts,
        })
    }
}
