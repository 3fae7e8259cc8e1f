//! `morphquad topic hz`.

use super::{Trouble, What, find, open, refuse};
use crate::bar::busy;
use crate::options::{Format, TopicHzArguments};
use crate::refusal::{Done, Failure};
use core::time::Duration;
use figures::results::Table;
use host::exit;
use protocol::control::runs::Run;
use protocol::topic::header;
use protocol::topic::live::{Listening, Message};
use protocol::topic::tally::{Counted, Tally};
use record::read::RecordVisitor;
use runtime::clock::mono_now_ns;
use serde_json::json;
use shared_types::{Sample, Topic, TopicInfo};
use std::collections::BTreeMap;
use std::io::Write;

/// How long is counted what comes.
const USUAL: Duration = Duration::from_secs(2);

/// Tallies by topic.
pub(super) type Tallies = BTreeMap<&'static str, Tally>;

/// Counts and shows.
pub(super) fn run(
    arguments: &TopicHzArguments,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> Done {
    let what = What::of_samples(&arguments.what)?;
    what.require_no_run_beside_a_file(&arguments.run)?;
    let tallies = if let Some(path) = &what.file {
        if arguments.duration.is_some() {
            return Err(refuse(Trouble::OfRun("--for")));
        }
        let flight = open(path)?;
        let mut count = Count { what: &what, tallies: Tallies::new() };
        let _busy = busy("counting");
        flight.visit(&mut count).map_err(refuse)?;
        count.tallies
    } else {
        let run = find(arguments.run.run.as_deref())?;
        let wanted = what.topics_or_all();
        listen(&run, &wanted, arguments.duration.unwrap_or(USUAL), diagnostics)?
    };
    let silent = what.topics.iter().filter(|topic| !tallies.contains_key(topic.name));
    match arguments.format {
        Format::Json => {
            let list = |tally: &Tally| json!(tally.counted());
            let mut object: BTreeMap<&str, _> =
                tallies.iter().map(|(name, tally)| (*name, list(tally))).collect();
            object.extend(silent.map(|topic| (topic.name, json!([]))));
            writeln!(out, "{}", json!(object))?;
        }
        Format::Text => {
            write!(out, "{}", table(&tallies))?;
            for topic in silent {
                writeln!(out, "{}: nothing came", topic.name)?;
            }
        }
    }
    out.flush()?;
    Ok(exit::PASS)
}

/// Counts what comes on `topics` for so long, and says how many samples were left out if any were.
pub(super) fn listen(
    run: &Run,
    topics: &[&'static TopicInfo],
    duration: Duration,
    diagnostics: &mut dyn Write,
) -> Result<Tallies, Failure> {
    let mut listening = Listening::to(run, topics, false).map_err(refuse)?;
    let _busy = busy("listening");
    let (mut tallies, mut dropped) = (Tallies::new(), 0);
    let begin_ns = mono_now_ns();
    let elapsed = || Duration::from_nanos(mono_now_ns().saturating_sub(begin_ns));
    while let Some(left) = duration.checked_sub(elapsed()) {
        match listening.next(left).map_err(refuse)? {
            Message::Sample(topic, packed) => {
                if let Some(header) = header(&packed) {
                    tallies.entry(topic.name).or_default().count(&header);
                }
            }
            Message::Dropped(count) => dropped += count,
            Message::Nothing | Message::Log(_) | Message::Ended(_) => {}
            Message::Over => break,
        }
    }
    if dropped > 0 {
        writeln!(diagnostics, "morphquad: {dropped} samples were left out, read too slowly")?;
    }
    Ok(tallies)
}

/// A line for each writer of each topic.
pub(super) fn table(tallies: &Tallies) -> Table {
    let headings = ["TOPIC", "SEAT", "SAMPLES", "HZ", "MIN ms", "MAX ms", "WALL Hz", "GAPS"];
    let mut table = Table::new(headings);
    for (name, tally) in tallies {
        for counted in tally.counted() {
            let Counted { seat, count, hz, shortest_s, longest_s, wall_hz, gaps, .. } = counted;
            let rate = |hz: Option<f64>| hz.map_or("-".to_owned(), |hz| format!("{hz:.2}"));
            let ms = |s: Option<f64>| s.map_or("-".to_owned(), |s| format!("{:.3}", s * 1e3));
            table.push([
                (*name).to_owned(),
                seat.to_string(),
                count.to_string(),
                rate(hz),
                ms(shortest_s),
                ms(longest_s),
                rate(wall_hz),
                gaps.to_string(),
            ]);
        }
    }
    table
}

/// Counts what is recorded.
pub(super) struct Count<'a> {
    pub(super) what: &'a What,
    pub(super) tallies: Tallies,
}

impl RecordVisitor for Count<'_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        self.what.wants(topic)
    }
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.tallies.entry(topic.info.name).or_default().count(sample.header());
    }
}
