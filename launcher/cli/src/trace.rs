//! `morphquad trace`: where a command's time went, from a recording.

use super::flown::{named_or_latest, recorded, unreadable};
use super::options::{Format, TraceArguments};
use super::refusal::{Done, Failure};
use host::exit;
use serde_json::{Map, Value, json};
use shared_types::Header;
use std::fmt::Write as _;
use std::io::{self, Write};
use viewers::trace::{Chain, SEGMENTS, Sum, Traced, trace};

/// Shows a summary, or one command's chain.
pub(super) fn run(arguments: &TraceArguments, out: &mut dyn Write) -> Done {
    let flight = recorded(&named_or_latest(arguments.file.as_deref(), &mut io::stderr())?)?;
    let file = flight.path().display().to_string();
    let busy = super::bar::busy("reading");
    let (text, json, complete) = match arguments.command {
        None => {
            let mut sum = Sum::default();
            let ended = trace(&flight, |traced| sum.add(traced));
            let report = sum.report(&ended.map_err(|error| unreadable(&error))?);
            let mut json = report.to_json();
            json["file"] = json!(file);
            (report.to_string(), json, report.is_complete())
        }
        Some(sequence) => {
            let mut wanted = Wanted::new(sequence, arguments.seat);
            let ended = trace(&flight, |traced| wanted.see(traced));
            let whole = ended.map_err(|error| unreadable(&error))?.closing.complete;
            let found = wanted.found()?;
            let mut text = found.iter().map(text_of).collect::<Vec<_>>().join("\n");
            if !whole {
                text.push_str("\nThe file is cut: what came after its end is not known.\n");
            }
            let commands: Vec<_> = found.iter().map(json_of).collect();
            let complete = whole && found.iter().all(|one| one.chain.is_ok());
            (text, json!({ "file": file, "commands": commands }), complete)
        }
    };
    drop(busy);
    match arguments.format {
        Format::Text => out.write_all(text.as_bytes())?,
        Format::Json => writeln!(out, "{json}")?,
    }
    out.flush()?;
    Ok(if complete { exit::PASS } else { exit::FAILED })
}

/// Every command of a sequence; two seats, or two lives of one, may both have sent one.
struct Wanted {
    sequence: u64,
    seat: Option<u32>,
    found: Vec<Traced>,
    /// First and last sequence there is.
    range: Option<(u64, u64)>,
}

impl Wanted {
    fn new(sequence: u64, seat: Option<u32>) -> Self {
        Self { sequence, seat, found: Vec::new(), range: None }
    }

    fn see(&mut self, traced: &Traced) {
        let Header { seat, sequence, .. } = traced.command;
        if self.seat.is_some_and(|wanted| wanted != seat) {
            return;
        }
        let (first, last) = self.range.unwrap_or((sequence, sequence));
        self.range = Some((first.min(sequence), last.max(sequence)));
        if sequence == self.sequence {
            self.found.push(traced.clone());
        }
    }

    fn found(self) -> Result<Vec<Traced>, Failure> {
        if !self.found.is_empty() {
            return Ok(self.found);
        }
        let of_seat = self.seat.map_or(String::new(), |seat| format!(" of seat {seat}"));
        let there_are = match self.range {
            Some((first, last)) => format!("the file has {first} to {last}{of_seat}"),
            None => format!("the file has none{of_seat}"),
        };
        let sequence = self.sequence;
        let what =
            format!("--command {sequence}: no wrench command has this sequence; {there_are}");
        Err(Failure::plain(&what, exit::USAGE))
    }
}

/// The samples of a chain with their topics, in the order of time.
fn rows(chain: &Chain) -> Vec<(&'static str, Header)> {
    let mut rows = Vec::new();
    if let Some(by) = chain.setpoint {
        rows.push(("imu", by.imu));
        rows.push(("state_estimate", by.estimate));
        rows.push(("attitude_setpoint", by.setpoint));
    }
    rows.push(("imu", chain.imu));
    rows.push(("state_estimate", chain.estimate));
    rows.push(("wrench_command", chain.command));
    rows.extend(chain.tick.map(|tick| ("applied_command", tick)));
    rows
}

fn text_of(traced: &Traced) -> String {
    let Header { sequence, seat, release_ns, valid_ns, .. } = traced.command;
    let mut text = format!(
        "command {sequence} of attitude seat {seat}, released at {:.6} s, in effect from {:.6} s\n",
        release_ns as f64 * 1e-9,
        valid_ns as f64 * 1e-9
    );
    let chain = match &traced.chain {
        Ok(chain) => chain,
        Err(broken) => {
            let _ = writeln!(text, "not traced: it {broken}");
            return text;
        }
    };
    let _ = writeln!(
        text,
        "\n{:<18}{:>4}{:>9}{:>11}{:>9}{:>9}{:>10}{:>10}",
        "SAMPLE", "SEAT", "SEQUENCE", "RELEASE", "DUE", "ARRIVED", "START", "PUBLISHED"
    );
    let zero_ns = chain.imu.release_mono_ns;
    for (topic, header) in rows(chain) {
        let _ = writeln!(
            text,
            "{topic:<18}{:>4}{:>9}{:>9.4} s{:>9}{:>9}{:>10}{:>10}",
            header.seat,
            header.sequence,
            header.release_ns as f64 * 1e-9,
            since(zero_ns, header.release_mono_ns),
            since(zero_ns, header.receive_mono_ns),
            since(zero_ns, header.start_mono_ns),
            since(zero_ns, header.publish_mono_ns),
        );
    }
    text += "\nMicroseconds since the imu sample of the command was due. ARRIVED is when the sample by which \
             a\nstep went came to its process, START its beginning, PUBLISHED its end. Of the plant's tick it\n\
             is the newest command.\n\n";
    for segment in &SEGMENTS {
        if let Some(length_ns) = segment.of(chain) {
            let _ = writeln!(text, "{:<34}{:>10.1} us", segment.text, length_ns as f64 * 1e-3);
        }
    }
    let _ = writeln!(
        text,
        "{:<34}{:>10.1} us",
        "logical age of imu at effect",
        chain.age_ns() as f64 * 1e-3
    );
    if chain.tick.is_none() {
        text +=
            "it moved no rotor: a shadow's, overtaken within a tick, or the last of the flight\n";
    }
    text
}

/// Microseconds between two stamps; a dash where there is none.
fn since(zero_ns: u64, stamp_ns: u64) -> String {
    if stamp_ns == 0 || zero_ns == 0 {
        return "-".to_owned();
    }
    format!("{:.1}", (i128::from(stamp_ns) - i128::from(zero_ns)) as f64 * 1e-3)
}

fn json_of(traced: &Traced) -> Value {
    let Header { sequence, seat, generation, release_ns, valid_ns, .. } = traced.command;
    let mut json = json!({
        "sequence": sequence, "seat": seat, "generation": generation, "release_ns": release_ns,
        "valid_ns": valid_ns, "traced": traced.chain.is_ok(),
    });
    match &traced.chain {
        Err(broken) => json["reason"] = json!(broken.to_string()),
        Ok(chain) => {
            let lengths =
                SEGMENTS.iter().filter_map(|s| Some((s.key.to_owned(), json!(s.of(chain)?))));
            json["segments_ns"] = Value::Object(lengths.collect::<Map<_, _>>());
            json["age_ns"] = json!(chain.age_ns());
            json["applied"] = json!(chain.tick.is_some());
            json["chain"] =
                rows(chain).into_iter().map(|(topic, header)| link(topic, &header)).collect();
        }
    }
    json
}

fn link(topic: &str, header: &Header) -> Value {
    json!({
        "topic": topic,
        "seat": header.seat,
        "generation": header.generation,
        "sequence": header.sequence,
        "input_sequence": header.input_sequence,
        "cause_sequence": header.cause_sequence,
        "release_ns": header.release_ns,
        "valid_ns": header.valid_ns,
        "release_mono_ns": header.release_mono_ns,
        "receive_mono_ns": header.receive_mono_ns,
        "start_mono_ns": header.start_mono_ns,
        "publish_mono_ns": header.publish_mono_ns,
    })
}
