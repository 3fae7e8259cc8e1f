//! `morphquad topic info`.

use super::hz::{Count, Tallies, table};
use super::list::readers;
use super::{What, open, refuse};
use crate::bar::busy;
use crate::options::{Format, TopicInfoArguments};
use crate::refusal::Done;
use core::fmt::Write as _;
use host::exit;
use protocol::topic::fields::kind_of;
use protocol::topic::schema;
use record::read::{Closing, RecordedFlight};
use serde_json::{Value, json};
use shared_types::{Edge, TopicInfo};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// Describes topics, or a recording.
pub(super) fn run(arguments: &TopicInfoArguments, out: &mut dyn Write) -> Done {
    let what = What::of_samples(&arguments.what)?;
    let (text, json) = if let Some(path) = &what.file {
        of_file(path, &what)?
    } else {
        let text: Vec<String> = what.topics.iter().map(|topic| describe(topic)).collect();
        (text.join("\n"), what.topics.iter().map(|topic| object(topic)).collect())
    };
    match arguments.format {
        Format::Text => write!(out, "{text}")?,
        Format::Json => writeln!(out, "{json}")?,
    }
    out.flush()?;
    Ok(exit::PASS)
}

fn edge(topic: &TopicInfo) -> &'static str {
    match topic.edge {
        Edge::ZeroLatency => "zero latency: the step at its instant waits for it",
        Edge::Delayed => {
            "delayed: in effect a declared latency after its release, or at its instant"
        }
        Edge::RecordOnly => "for the recorder only",
    }
}

fn describe(topic: &TopicInfo) -> String {
    let schema = schema(topic);
    let mut text = format!("{}  {}\n", topic.name, topic.summary);
    let type_name = schema.map_or("", |schema| schema.name);
    let layout = schema.map_or(0, |schema| schema.layout_hash);
    let _ = writeln!(text, "  type    {type_name}, layout {layout:016x}");
    let _ = writeln!(text, "  from    {}", topic.from.label());
    let _ = writeln!(text, "  to      {}", readers(topic));
    let _ = writeln!(text, "  edge    {}", edge(topic));
    let _ = writeln!(text, "  keeps   {} samples for who joins late", topic.history);
    for field in schema.map_or(&[][..], |schema| schema.fields) {
        let _ = writeln!(text, "  {:<26}{}", field.name, kind_of(field));
    }
    text
}

fn object(topic: &TopicInfo) -> Value {
    let schema = schema(topic);
    let fields = schema.map_or(&[][..], |schema| schema.fields).iter();
    let fields: Vec<Value> =
        fields.map(|field| json!({"name": field.name, "kind": kind_of(field)})).collect();
    json!({
        "topic": topic.name,
        "summary": topic.summary,
        "type": schema.map(|schema| schema.name),
        "layout": schema.map(|schema| format!("{:016x}", schema.layout_hash)),
        "from": topic.from.label(),
        "to": topic.to.iter().map(|role| role.label()).collect::<Vec<_>>(),
        "keeps": topic.history,
        "in_flight_hash": topic.in_flight_hash,
        "fields": fields,
    })
}

fn of_file(path: &Path, what: &What) -> Result<(String, Value), crate::refusal::Failure> {
    let flight = open(path)?;
    let mut count = Count { what, tallies: Tallies::new() };
    let busy = busy("counting");
    let closing = flight.visit(&mut count).map_err(refuse)?;
    drop(busy);
    let bytes = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let text = head(&flight, &closing, bytes) + &table(&count.tallies).to_string();
    let topics: BTreeMap<_, _> =
        count.tallies.iter().map(|(name, tally)| (*name, tally.counted())).collect();
    let json = json!({
        "file": path.display().to_string(),
        "bytes": bytes,
        "complete": closing.complete,
        "recovered_from": closing.recovered.as_ref().map(|rescue| &rescue.from),
        "facts": flight.facts(),
        "summary": closing.summary,
        "topics": topics,
    });
    Ok((text, json))
}

fn head(flight: &RecordedFlight, closing: &Closing, bytes: u64) -> String {
    let fact = |key: &str| flight.facts().get(key).map_or("?", String::as_str);
    let size = bytes as f64 / 1e6;
    let mut text = format!(
        "run {}  {}  seed {}  {}, {size:.1} MB\n",
        fact("run_id"),
        flight.scenario().settings().scenario.name,
        fact("seed"),
        fact("clock"),
    );
    let version = format!("morphquad {} ({})", fact("version"), fact("git"));
    let _ = writeln!(text, "recorded by {version}");
    let summary = &closing.summary;
    // The verdict that the flight gave itself; before there were verdicts, how it ended.
    match (closing.complete, summary.get("verdict").or_else(|| summary.get("outcome"))) {
        (true, Some(verdict)) => {
            let hash = summary.get("hash").map_or("", String::as_str);
            let _ = writeln!(text, "{verdict}; hash {hash}\n");
        }
        _ => {
            let _ = writeln!(text, "INCOMPLETE: {closing}\n");
        }
    }
    text
}
