//! One pass over a recording: each record, decoded by its channel, shown to a visitor.

use super::{LayoutChange, ReadError, RecordedFlight};
use crate::messages::{decode_log, decode_state};
use crate::{Clock, DecodeError, decode};
use components::StateLayout;
use core::cell::Cell;
use core::fmt;
use core::ops::ControlFlow;
use mcap::records::Record;
use shared_types::topics::visit_all;
use shared_types::{Header, Role, Sample, Seat, Topic, TopicInfo, TopicVisitor};
use std::any::Any;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::path::Path;

use super::records::{Ending, Records};
use super::recover::RECOVERED;

/// A published state as recorded.
#[derive(Debug, Clone)]
pub struct RecordedState {
    /// Sequence, instant and generation of the state.
    pub header: Header,
    /// The packed state, header first.
    pub bytes: Vec<u8>,
}

/// An event, as text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedEvent {
    /// Unix time \[ns\].
    pub stamp_ns: u64,
    /// Number of the severity, from 1 (debug) to 5 (fatal).
    pub level: u64,
    /// Its source.
    pub source: String,
    /// What.
    pub text: String,
}

impl RecordedEvent {
    /// Of a `foxglove.Log`.
    ///
    /// # Errors
    /// It is none.
    pub fn decode(log: &[u8]) -> Result<Self, DecodeError> {
        let (stamp_ns, level, text, source) = decode_log(log)?;
        Ok(Self { stamp_ns, level, source, text })
    }

    /// Logical time of it \[s\], in a flight whose clock runs like that from `epoch_unix_ns` on.
    #[must_use]
    pub fn at_s(&self, epoch_unix_ns: u64, clock: Clock) -> f64 {
        let since_s = self.stamp_ns.saturating_sub(epoch_unix_ns) as f64 * 1e-9;
        match clock {
            Clock::Lockstep => since_s,
            Clock::Realtime { speed } => since_s * speed,
        }
    }

    /// Name of the severity.
    #[must_use]
    pub fn severity(&self) -> &'static str {
        match self.level {
            ..=1 => "debug",
            2 => "info",
            3 => "warning",
            4 => "error",
            _ => "fatal",
        }
    }
}

/// Sees the records of a flight; every method has a default that ignores its record.
pub trait RecordVisitor {
    /// False for topics that need not be decoded.
    fn wants(&self, _topic: &TopicInfo) -> bool {
        true
    }
    fn sample<T: Sample>(&mut self, _topic: &'static Topic<T>, _sample: &T) {}
    /// True if the bytes of states matter, as to what flies on from them: states of a layout that this build does not
    /// know are then refused, and otherwise shown as they are.
    fn reads_states(&self) -> bool {
        false
    }
    /// A published state of the component that fills `role`.
    fn state(&mut self, _role: Role, _header: &Header, _state: &[u8]) {}
    fn event(&mut self, _event: RecordedEvent) {}
    /// True once it has seen enough: the pass ends there.
    fn is_done(&self) -> bool {
        false
    }
    /// A scenario that configures one controller alone, see [`seat_config`].
    fn scenario(&mut self, _name: &str, _text: &str) {}
}

/// Name of the scenario that configures one life of a process.
#[must_use]
pub fn seat_config(seat: Seat, generation: u32) -> String {
    format!("{}@{}.{generation}.toml", seat.role.label(), seat.index)
}

/// The end of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Closing {
    /// False if the file is cut: its recorder was killed or still writes, or it is a part, or
    /// recovered from one.
    pub complete: bool,
    /// The flight's summary; empty in a cut file.
    pub summary: BTreeMap<String, String>,
    /// The audit of every sequence; empty in a cut file.
    pub audit: BTreeMap<String, String>,
    /// Of a file that `morphquad recover` has made.
    pub recovered: Option<Rescue>,
}

/// What a recovered file was made from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Rescue {
    /// Name of that file.
    pub from: String,
    /// What was wrong with it, if it was not just cut.
    pub damage: Option<String>,
    /// Records and chunks of it that could not be read.
    pub left_out: u64,
}

impl Closing {
    /// True if parts of it could not be read of the file that it was recovered from.
    #[must_use]
    pub fn has_holes(&self) -> bool {
        self.recovered.as_ref().is_some_and(|rescue| rescue.left_out > 0)
    }

    /// Refuses a file with holes, of which nothing can be flown again.
    ///
    /// # Errors
    /// [`ReadError::Holed`].
    pub fn require_no_holes(&self, path: &Path) -> Result<(), ReadError> {
        match &self.recovered {
            Some(Rescue { from, left_out: left_out @ 1.., .. }) => Err(ReadError::Holed {
                path: path.to_owned(),
                from: from.clone(),
                left_out: *left_out,
            }),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for Closing {
    /// Why the file may not be all of its flight; nothing if it is.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.recovered {
            Some(Rescue { from, damage: None, .. }) => {
                write!(f, "it is recovered from {from}, whose recorder was killed")
            }
            Some(Rescue { from, damage: Some(damage), .. }) => {
                write!(f, "it is recovered from {from} ({damage})")
            }
            None if !self.complete => {
                write!(f, "it is cut: its recorder was killed or still writes")
            }
            None if self.summary.is_empty() => write!(f, "it has no summary"),
            None => Ok(()),
        }
    }
}

/// Decodes a sample and shows it.
type Show<V> = Box<dyn Fn(&[u8], &mut V) -> Result<(), DecodeError>>;

/// What to do with the messages of one channel.
enum Reader<V> {
    Sample(Show<V>),
    /// Role, layouts of all that can fill it, and whether one of them has been met; the first is of
    /// the one that begins.
    State(Role, Vec<StateLayout>, Cell<bool>),
    Events,
}

pub(super) fn visit<V: RecordVisitor>(
    flight: &RecordedFlight,
    visitor: &mut V,
) -> Result<Closing, ReadError> {
    let readers = readers(flight, visitor);
    let mut closing = Closing::default();
    let ending = Records::open(&flight.path)?.for_each(|record| {
        match record {
            Record::Message { header, data } => {
                if let Some((topic, reader)) = readers.get(&header.channel_id) {
                    read(flight, (topic, reader), &data, visitor)?;
                }
            }
            Record::Attachment { header, data, .. } => {
                visitor.scenario(&header.name, &String::from_utf8_lossy(&data));
            }
            Record::Metadata(metadata) if metadata.name == "summary" => {
                closing.summary = metadata.metadata;
            }
            Record::Metadata(metadata) if metadata.name == "audit" => {
                closing.audit = metadata.metadata;
            }
            Record::Metadata(mut metadata) if metadata.name == RECOVERED => {
                let mut entry = |key: &str| metadata.metadata.remove(key);
                let from = entry("from").unwrap_or_default();
                let left_out = entry("left_out").and_then(|n| n.parse().ok()).unwrap_or(0);
                closing.recovered = Some(Rescue { from, damage: entry("damage"), left_out });
            }
            _ => {}
        }
        Ok(if visitor.is_done() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    })?;
    closing.complete = ending == Ending::Whole && closing.recovered.is_none();
    Ok(closing)
}

fn read<V: RecordVisitor>(
    flight: &RecordedFlight,
    (topic, reader): (&str, &Reader<V>),
    data: &[u8],
    visitor: &mut V,
) -> Result<(), ReadError> {
    let broken = |error: DecodeError| ReadError::Record {
        path: flight.path.clone(),
        topic: topic.to_owned(),
        error,
    };
    match reader {
        Reader::Sample(show) => show(data, visitor).map_err(broken),
        Reader::State(role, layouts, known) => {
            let (header, layout_hash, state) = decode_state(data).map_err(broken)?;
            if layouts.iter().any(|layout| layout.hash == layout_hash) {
                known.set(true);
                visitor.state(*role, &header, state);
                return Ok(());
            }
            // A process that follows one of ours may be a foreign executable.
            let unknown = layouts.first().filter(|_| !known.get());
            if unknown.is_some() && !visitor.reads_states() {
                visitor.state(*role, &header, state);
            } else if let Some(layout) = unknown {
                return Err(ReadError::Layout(Box::new(LayoutChange {
                    path: flight.path.clone(),
                    topic: topic.to_owned(),
                    type_name: layout.type_name.to_owned(),
                    theirs: format!("{layout_hash:016x}"),
                    ours: format!("{:016x}", layout.hash),
                    recorder: flight.recorder(),
                    detail: " (memory, inputs or header of the state)".to_owned(),
                })));
            }
            Ok(())
        }
        Reader::Events => {
            visitor.event(RecordedEvent::decode(data).map_err(broken)?);
            Ok(())
        }
    }
}

/// What to do with each channel, by its number in the file.
fn readers<V: RecordVisitor>(
    flight: &RecordedFlight,
    visitor: &V,
) -> BTreeMap<u16, (String, Reader<V>)> {
    let mut all = Readers { flight, visitor, readers: BTreeMap::new() };
    let Ok(()) = visit_all(&mut all);
    let mut readers = all.readers;
    for layout in &flight.layouts {
        let topic = format!("/state/{}", layout.role.label());
        if let Some(channel) = flight.channels.get(&topic) {
            let reader = readers.entry(channel.id);
            let none = || (topic, Reader::State(layout.role, Vec::new(), Cell::new(false)));
            if let (_, Reader::State(_, layouts, _)) = reader.or_insert_with(none) {
                layouts.push(*layout);
            }
        }
    }
    if let Some(channel) = flight.channels.get("/events") {
        readers.insert(channel.id, ("/events".to_owned(), Reader::Events));
    }
    readers
}

struct Readers<'a, V> {
    flight: &'a RecordedFlight,
    visitor: &'a V,
    readers: BTreeMap<u16, (String, Reader<V>)>,
}

impl<V: RecordVisitor> TopicVisitor for Readers<'_, V> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let name = format!("/{}", topic.info.name);
        if let Some(channel) = self.flight.channels.get(&name)
            && self.visitor.wants(&topic.info)
        {
            let show = move |data: &[u8], visitor: &mut V| {
                visitor.sample(topic, &decode::<T>(data)?);
                Ok(())
            };
            self.readers.insert(channel.id, (name, Reader::Sample(Box::new(show))));
        }
        Ok(())
    }
}

/// Collects one topic.
pub(super) struct Collect<T> {
    pub(super) topic: &'static str,
    pub(super) samples: Vec<T>,
}

impl<T: Sample> RecordVisitor for Collect<T> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        topic.name == self.topic
    }
    fn sample<U: Sample>(&mut self, topic: &'static Topic<U>, sample: &U) {
        if topic.info.name == self.topic
            && let Some(sample) = (sample as &dyn Any).downcast_ref::<T>()
        {
            self.samples.push(*sample);
        }
    }
}

/// Collects the states of one role.
pub(super) struct CollectStates {
    pub(super) role: Role,
    pub(super) states: Vec<RecordedState>,
}

impl RecordVisitor for CollectStates {
    fn wants(&self, _topic: &TopicInfo) -> bool {
        false
    }
    fn reads_states(&self) -> bool {
        true
    }
    fn state(&mut self, role: Role, header: &Header, state: &[u8]) {
        if role == self.role {
            self.states.push(RecordedState { header: *header, bytes: state.to_vec() });
        }
    }
}
