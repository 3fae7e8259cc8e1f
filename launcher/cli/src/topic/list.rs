//! `morphquad topic list`.

use super::hz::{Tallies, listen};
use super::refuse;
use crate::options::{Format, TopicListArguments};
use crate::refusal::Done;
use figures::results::Table;
use host::exit;
use protocol::control::runs::{self, FindError};
use protocol::topic::schema;
use serde_json::{Value, json};
use shared_types::{TopicInfo, topics};
use std::io::Write;

/// Names every topic; with a running flight, also how often it comes.
pub(super) fn run(
    arguments: &TopicListArguments,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> Done {
    let tallies = match runs::find(arguments.run.run.as_deref()) {
        Ok(run) => Some(listen(&run, &topics::all(), arguments.duration, diagnostics)?),
        Err(FindError::NoRun) => None,
        Err(error) => return Err(refuse(error)),
    };
    match arguments.format {
        Format::Text => write!(out, "{}", table(tallies.as_ref()))?,
        Format::Json => {
            let list: Value =
                topics::all().into_iter().map(|topic| object(topic, tallies.as_ref())).collect();
            writeln!(out, "{list}")?;
        }
    }
    out.flush()?;
    Ok(exit::PASS)
}

/// Of the writer that writes most.
fn hz(topic: &TopicInfo, tallies: Option<&Tallies>) -> Option<f64> {
    let counted = tallies?.get(topic.name)?.counted();
    counted.into_iter().max_by_key(|counted| counted.count)?.hz
}

fn type_of(topic: &TopicInfo) -> &'static str {
    schema(topic).map_or("", |schema| schema.name)
}

pub(super) fn readers(topic: &TopicInfo) -> String {
    let readers: Vec<&str> = topic.to.iter().map(|role| role.label()).collect();
    if readers.is_empty() { "-".to_owned() } else { readers.join(" ") }
}

fn table(tallies: Option<&Tallies>) -> Table {
    let mut table = Table::new(["TOPIC", "TYPE", "FROM", "TO", "HZ"]);
    for topic in topics::all() {
        let hz = hz(topic, tallies).map_or("-".to_owned(), |hz| format!("{hz:.1}"));
        let from = topic.from.label().to_owned();
        table.push([topic.name.to_owned(), type_of(topic).to_owned(), from, readers(topic), hz]);
    }
    table
}

fn object(topic: &TopicInfo, tallies: Option<&Tallies>) -> Value {
    let to: Vec<&str> = topic.to.iter().map(|role| role.label()).collect();
    json!({
        "topic": topic.name,
        "type": type_of(topic),
        "from": topic.from.label(),
        "to": to,
        "summary": topic.summary,
        "hz": hz(topic, tallies),
    })
}
