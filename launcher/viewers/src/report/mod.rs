//! What a recording is worth: one sentence, every number with its gate and the command that gives it again,
//! and pictures.
//!
//! Numbers come from the samples in the file, not from the flight's own summary: `observe.rs` goes
//! through them, `numbers.rs` puts them beside the limits of the verdict, `response.rs` looks at what
//! followed each disturbance, swap and fault, `orders.rs` at what became of each order (of a move of the
//! reference by `pursuits.rs`), `pictures.rs` draws, `render.rs` writes it down.

mod numbers;
mod observe;
mod orders;
mod parted;
mod pictures;
mod pursuits;
mod render;
mod response;

pub use numbers::Number;
pub(crate) use observe::Observed;
pub use orders::Ordered;
pub use parted::Parted;
pub use pictures::pictures;
pub use render::{Folder, document};
pub use response::Response;

use crate::trace::{self, trace};
use crate::view::{Gathered, ViewError, gather};
use ::verdict::Verdict;
use pictures::Tails;
use record::read::RecordedFlight;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Everything that is reported of one recording.
#[derive(Debug)]
pub struct Report {
    /// The file, as it was named.
    pub file: String,
    /// What was flown.
    pub scenario: String,
    /// The verdict, and why: the line that every output about this flight begins with.
    pub line: String,
    /// Everything that the summary of a flight has too, under the same keys.
    measured: Map<String, Value>,
    /// The same for machines, with every reason and limit.
    pub verdict: Verdict,
    /// What the file lacks, in a sentence; empty if it is all of its flight.
    pub lacks: String,
    /// The command that flies it again.
    pub again: String,
    /// Every number, in the order shown.
    pub numbers: Vec<Number>,
    /// What followed what.
    pub responses: Vec<Response>,
    /// What was ordered, and what came of it.
    pub orders: Vec<Ordered>,
    /// Changes of a slot's owner, as the flight recorded them.
    pub swaps: Value,
    /// Another recording of the same scenario that is another flight, if one is known.
    pub parted: Option<Parted>,
    /// Samples by topic and seat.
    pub audit: Vec<AuditRow>,
    /// Where the commands' time went.
    pub latency: trace::Report,
    /// Run, build and machine.
    pub facts: BTreeMap<String, String>,
    gathered: Gathered,
    tails: Tails,
}

/// Samples of one seat of one topic.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AuditRow {
    /// Name of the topic.
    pub topic: String,
    /// Seat of the producer.
    pub seat: u32,
    /// Processes that sat there and wrote, one after the other; each numbers on its own.
    pub writers: u64,
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
    /// Goes through a recording, in bounded memory but for four lengths of each command.
    ///
    /// # Errors
    /// The file is damaged, or nothing was flown.
    pub fn of(flight: &RecordedFlight) -> Result<Self, ViewError> {
        let gathered = gather(flight)?;
        let observed = Observed::of(flight)?;
        let (mut sum, mut tails) = (trace::Sum::default(), Tails::default());
        let ended = trace(flight, |traced| {
            sum.add(traced);
            tails.add(traced);
        })?;
        let latency = sum.report(&ended);
        let responses = response::responses(&gathered);
        let orders = orders::ordered(&gathered, &observed.pursuits, &responses);
        let numbers = numbers::numbers(flight, &gathered, &observed, &latency);
        let scenario = flight.scenario().settings().scenario.name.clone();
        let swaps =
            gathered.closing.summary.get("swaps").and_then(|t| serde_json::from_str(t).ok());
        Ok(Self {
            file: flight.path().display().to_string(),
            line: observed.line(),
            measured: observed.measured(),
            verdict: observed.verdict().clone(),
            scenario,
            lacks: lacks(&gathered),
            again: numbers::flown_again(flight, &gathered.closing),
            numbers,
            responses,
            orders,
            swaps: swaps.unwrap_or_else(|| json!([])),
            parted: None,
            audit: observed.audit_rows(),
            latency,
            facts: flight.facts().clone(),
            gathered,
            tails: tails.sorted(),
        })
    }

    /// True if the flight passed.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.verdict.passed()
    }

    /// True if time stood still whenever a step was not done: then a latency is the machine's own, and
    /// no process ever was late.
    fn is_lockstep(&self) -> bool {
        self.facts.get("clock").is_some_and(|clock| clock == "lockstep")
    }

    /// For machines.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let Self { file, scenario, line, lacks, again, numbers, responses, .. } = self;
        let Self { orders, swaps, parted, audit, facts, verdict, .. } = self;
        let mut all = self.measured.clone();
        let of_the_file = json!({
            "file": file, "scenario": scenario, "pass": self.passes(), "line": line, "verdict": verdict,
            "lacks": lacks, "again": again, "numbers": numbers, "responses": responses, "orders": orders,
            "swaps": swaps, "parted": parted, "audit": audit, "latency": self.latency.to_json(),
            "latency_is_of_lockstep": self.is_lockstep(), "facts": facts,
        });
        all.extend(of_the_file.as_object().cloned().unwrap_or_default());
        all.into()
    }
}

/// What an incomplete file lacks.
fn lacks(gathered: &Gathered) -> String {
    let why = gathered.closing.to_string();
    if why.is_empty() {
        return why;
    }
    let ends_in_order = !gathered.closing.summary.is_empty();
    if gathered.closing.has_holes() {
        let end = if ends_in_order { "" } else { ", nor how the flight ended" };
        return format!(
            "The file has holes: {why}. What was in the damaged parts is not in it{end}; every number here \
             is computed from the samples that are."
        );
    }
    if ends_in_order {
        return format!("The file lacks its own end: {why}. All of the flight is in it.");
    }
    let until_s = gathered.span_ns.1 as f64 * 1e-9;
    let remedy = match gathered.closing.recovered {
        None => " `morphquad recover` makes a complete file of it.",
        Some(_) => "",
    };
    format!(
        "The file is not all of its flight: {why}. It ends at {until_s:.3} s. How the flight ended, what it \
         counted itself and how its swaps came out are not in it; every number here is computed from the \
         samples that are.{remedy}"
    )
}
