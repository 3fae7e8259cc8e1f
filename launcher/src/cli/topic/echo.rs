//! `morphquad topic echo`.

use super::{What, find, open, refuse};
use crate::cli::options::{SampleFormat, TopicEchoArguments};
use crate::cli::refusal::Done;
use crate::exit;
use crate::record::read::RecordVisitor;
use crate::topic::fields::{to_json, to_text};
use crate::topic::live::{Listening, Word};
use crate::topic::unpack;
use core::time::Duration;
use serde_json::{Map, Value, json};
use shared_types::{Header, Sample, Topic, TopicInfo};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// How long to wait before looking whether anything is to be written out.
const MOMENT: Duration = Duration::from_millis(100);

/// Shows samples until there are enough, or no more.
pub(super) fn run(
    arguments: &TopicEchoArguments,
    out: &mut dyn Write,
    said: &mut dyn Write,
) -> Done {
    let what = What::of(&arguments.what)?;
    let mut echo = Echo::new(arguments, out);
    match &what.file {
        Some(path) => {
            let flight = open(path)?;
            let mut reader = FromFile { what: &what, echo: &mut echo };
            flight.visit(&mut reader).map_err(refuse)?;
        }
        None => live(arguments, &what, &mut echo, said)?,
    }
    echo.finish()?;
    Ok(exit::PASS)
}

fn live(
    arguments: &TopicEchoArguments,
    what: &What,
    echo: &mut Echo<'_>,
    said: &mut dyn Write,
) -> Result<(), crate::cli::refusal::Failure> {
    let run = find(arguments.run.run.as_deref())?;
    let mut listening = Listening::to(&run, &what.topics_or_all()).map_err(refuse)?;
    while !echo.is_done() {
        match listening.next(MOMENT).map_err(refuse)? {
            Word::Sample(topic, packed) => {
                if let Some((header, fields)) = unpack(topic, &packed) {
                    echo.show(topic.name, &header, || fields);
                }
            }
            Word::Dropped(count) => {
                writeln!(said, "morphquad: {count} samples were left out, read too slowly")?;
            }
            Word::Nothing => echo.out.flush()?,
            Word::Over => break,
        }
    }
    Ok(())
}

/// Writes what passes.
struct Echo<'a> {
    arguments: &'a TopicEchoArguments,
    out: &'a mut dyn Write,
    /// Samples of each topic so far.
    seen: BTreeMap<&'static str, u64>,
    shown: u64,
    trouble: Option<io::Error>,
}

impl<'a> Echo<'a> {
    fn new(arguments: &'a TopicEchoArguments, out: &'a mut dyn Write) -> Self {
        Self { arguments, out, seen: BTreeMap::new(), shown: 0, trouble: None }
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
        let from_ns = self.arguments.from.map_or(0, |from| from.as_nanos());
        if self.is_done() || u128::from(header.release_ns) < from_ns {
            return;
        }
        let seen = self.seen.entry(topic).or_default();
        *seen += 1;
        if !(*seen - 1).is_multiple_of(self.arguments.every) {
            return;
        }
        let fields = fields();
        let written = match self.arguments.format {
            SampleFormat::Text => write!(self.out, "{}", to_text(topic, header, &fields)),
            SampleFormat::Jsonl => writeln!(self.out, "{}", json!({topic: fields})),
            SampleFormat::Json => {
                let before = if self.shown == 0 { "[\n" } else { ",\n" };
                write!(self.out, "{before}{}", json!({topic: fields}))
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
    echo: &'a mut Echo<'e>,
}

impl RecordVisitor for FromFile<'_, '_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        self.what.wants(topic)
    }
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.echo.show(topic.info.name, sample.header(), || to_json(sample));
    }
}
