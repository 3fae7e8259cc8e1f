//! `morphquad topic echo`.

use super::{EVENTS, Trouble, What, find, open, refuse};
use crate::options::{SampleFormat, TopicEchoArguments};
use crate::refusal::{Done, Failure};
use core::time::Duration;
use host::exit;
use protocol::topic::fields::{at, in_a_row, to_json, to_text};
use protocol::topic::live::{Listening, Message};
use protocol::topic::{schema, unpack};
use record::Clock;
use record::read::{RecordVisitor, RecordedEvent};
use serde_json::{Map, Value, json};
use shared_types::{Header, Sample, Topic, TopicInfo};
use std::collections::BTreeMap;
use std::io::{self, Write};
use viewers::export::{field_remedy, headings, is_of};

/// How long to wait before looking whether anything is to be written out.
const MOMENT: Duration = Duration::from_millis(100);

/// Shows samples until there are enough, or no more.
pub(super) fn run(
    arguments: &TopicEchoArguments,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> Done {
    let what = What::of(&arguments.what)?;
    what.require_no_run_beside_a_file(&arguments.run)?;
    if let Some(field) = arguments.fields.first().filter(|_| what.is_all() || what.wants_events()) {
        return Err(refuse(Trouble::FieldOfAll(field.clone())));
    }
    for (topic, field) in
        what.topics.iter().flat_map(|t| arguments.fields.iter().map(move |f| (t, f)))
    {
        has_field(topic, field)?;
    }
    let mut echo = Echo::new(arguments, out);
    echo.several = what.topics.len() > 1;
    match &what.file {
        Some(path) => {
            let flight = open(path)?;
            let time = (flight.epoch_unix_ns(), flight.clock());
            let mut reader = FromFile { what: &what, time, echo: &mut echo };
            flight.visit(&mut reader).map_err(refuse)?;
        }
        None => live(arguments, &what, &mut echo, diagnostics)?,
    }
    echo.finish()?;
    Ok(exit::PASS)
}

/// Refuses a field that no sample of a topic has.
fn has_field(topic: &TopicInfo, field: &str) -> Result<(), Failure> {
    let columns = schema(topic).map(|schema| headings(&schema)).unwrap_or_default();
    if columns.iter().any(|(column, _)| is_of(column, field)) {
        return Ok(());
    }
    let remedy = field_remedy(&columns, field);
    Err(refuse(Trouble::NoField { topic: topic.name, field: field.to_owned(), remedy }))
}

fn live(
    arguments: &TopicEchoArguments,
    what: &What,
    echo: &mut Echo<'_>,
    diagnostics: &mut dyn Write,
) -> Result<(), Failure> {
    let run = find(arguments.run.run.as_deref())?;
    let topics = what.topics_or_all();
    let mut listening = Listening::to(&run, &topics, what.wants_events()).map_err(refuse)?;
    let time = (listening.flying().epoch_unix_ns, listening.flying().clock());
    while !echo.is_done() {
        match listening.next(MOMENT).map_err(refuse)? {
            Message::Sample(topic, packed) => {
                if let Some((header, fields)) = unpack(topic, &packed) {
                    echo.show(topic.name, &header, || fields);
                }
            }
            Message::Dropped(count) => {
                writeln!(diagnostics, "morphquad: {count} samples were left out, read too slowly")?;
            }
            Message::Log(log) => {
                if let Ok(event) = RecordedEvent::decode(&log) {
                    echo.show_event(&event, time);
                }
            }
            Message::Nothing | Message::Ended(_) => echo.out.flush()?,
            Message::Over => break,
        }
    }
    Ok(())
}

/// Writes what passes.
struct Echo<'a> {
    arguments: &'a TopicEchoArguments,
    out: &'a mut dyn Write,
    /// A line of fields names its topic.
    several: bool,
    /// Samples of each topic so far.
    seen: BTreeMap<&'static str, u64>,
    shown: u64,
    trouble: Option<io::Error>,
}

impl<'a> Echo<'a> {
    fn new(arguments: &'a TopicEchoArguments, out: &'a mut dyn Write) -> Self {
        Self { arguments, out, several: false, seen: BTreeMap::new(), shown: 0, trouble: None }
    }

    fn is_done(&self) -> bool {
        self.trouble.is_some() || self.arguments.count.is_some_and(|count| self.shown >= count)
    }

    fn show(
        &mut self,
        topic: &'static str,
        header: &Header,
        fields: impl FnOnce() -> Map<String, Value>,
    ) {
        if !self.is_next(topic, header.release_ns as f64 * 1e-9) {
            return;
        }
        let fields = fields();
        if self.arguments.fields.is_empty() {
            let text = || to_text(topic, header, &fields);
            self.write(text, || json!({topic: fields}));
            return;
        }
        let (t_s, wanted) = (header.valid_ns as f64 * 1e-9, &self.arguments.fields);
        let found = || wanted.iter().filter_map(|path| Some((path, at(&fields, path)?)));
        let name = if self.several { format!("{topic} ") } else { String::new() };
        let text = || {
            let values: Vec<String> = found().map(|(_, value)| in_a_row(value)).collect();
            format!("{name}{t_s:.6} {}\n", values.join(" "))
        };
        let object = || {
            let mut object = Map::from_iter([("t_s".to_owned(), json!(t_s))]);
            object.extend(found().map(|(path, value)| (path.clone(), value.clone())));
            json!({topic: object})
        };
        self.write(text, object);
    }

    /// Shows an event of a flight that began at Unix time `time.0` \[ns\].
    fn show_event(&mut self, event: &RecordedEvent, (epoch_unix_ns, clock): (u64, Clock)) {
        let at_s = event.at_s(epoch_unix_ns, clock);
        if !self.is_next(EVENTS, at_s) {
            return;
        }
        let RecordedEvent { source, text, .. } = event;
        let severity = event.severity();
        self.write(
            || format!("{EVENTS}  {at_s:.6} s  {severity}  {source}: {text}\n"),
            || json!({EVENTS: { "t_s": at_s, "severity": severity, "source": source, "text": text }}),
        );
    }

    /// Counts one of a topic; true if it is to be shown.
    fn is_next(&mut self, topic: &'static str, at_s: f64) -> bool {
        let from_s = self.arguments.from.map_or(0.0, |from| from.as_secs_f64());
        // Instants are whole nanoseconds; a double has them to fractions of one.
        if self.is_done() || at_s < from_s - 0.5e-9 {
            return false;
        }
        let seen = self.seen.entry(topic).or_default();
        *seen += 1;
        (*seen - 1).is_multiple_of(self.arguments.every)
    }

    fn write(&mut self, text: impl FnOnce() -> String, object: impl FnOnce() -> Value) {
        let written = match self.arguments.format {
            SampleFormat::Text => write!(self.out, "{}", text()),
            SampleFormat::Jsonl => writeln!(self.out, "{}", object()),
            SampleFormat::Json => {
                let before = if self.shown == 0 { "[\n" } else { ",\n" };
                write!(self.out, "{before}{}", object())
            }
        };
        self.trouble = written.err();
        self.shown += 1;
    }

    fn finish(&mut self) -> io::Result<()> {
        if let Some(trouble) = self.trouble.take() {
            return Err(trouble);
        }
        if self.arguments.format == SampleFormat::Json {
            let before = if self.shown == 0 { "[" } else { "\n" };
            writeln!(self.out, "{before}]")?;
        }
        self.out.flush()
    }
}

struct FromFile<'a, 'e> {
    what: &'a What,
    time: (u64, Clock),
    echo: &'a mut Echo<'e>,
}

impl RecordVisitor for FromFile<'_, '_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        self.what.wants(topic)
    }
    fn is_done(&self) -> bool {
        self.echo.is_done()
    }
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.echo.show(topic.info.name, sample.header(), || to_json(sample));
    }
    fn event(&mut self, event: RecordedEvent) {
        if self.what.wants_events() {
            self.echo.show_event(&event, self.time);
        }
    }
}
