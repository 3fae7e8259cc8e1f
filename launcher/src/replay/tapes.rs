//! Samples by topic with their types forgotten: what was recorded, and what comes out of a replay.

use super::ReplayError;
use super::again::Topics;
use crate::record::read::{Closing, ReadError, RecordVisitor, RecordedFlight, RecordedState};
use runtime::graph::CREDIT_NS;
use shared_types::{
    Deviation, DeviationKind, Header, LoopStats, Role, Sample, Topic, TopicInfo, topics,
};
use std::any::Any;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Samples of several topics, each in the order recorded or produced.
#[derive(Default)]
pub(super) struct Tapes {
    /// `Rc<Vec<T>>` by topic name.
    tapes: BTreeMap<&'static str, Box<dyn Any>>,
}

impl Tapes {
    /// All samples of a topic.
    pub(super) fn of<T: Sample>(&self, topic: &Topic<T>) -> Rc<Vec<T>> {
        let tape = self.tapes.get(topic.info.name).and_then(|any| any.downcast_ref::<Rc<Vec<T>>>());
        tape.map(Rc::clone).unwrap_or_default()
    }

    /// Adds a sample. Nobody may hold the topic's tape meanwhile.
    pub(super) fn push<T: Sample>(&mut self, topic: &Topic<T>, sample: T) {
        let tape = self
            .tapes
            .entry(topic.info.name)
            .or_insert_with(|| Box::new(Rc::new(Vec::<T>::new())))
            .downcast_mut::<Rc<Vec<T>>>();
        if let Some(samples) = tape.and_then(Rc::get_mut) {
            samples.push(sample);
        }
    }
}

impl core::fmt::Debug for Tapes {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_set().entries(self.tapes.keys()).finish()
    }
}

/// What a recording holds for one role.
#[derive(Debug, Default)]
pub(super) struct Recorded {
    pub(super) tapes: Tapes,
    pub(super) states: Vec<RecordedState>,
    /// Last step that left a trace and can be replayed, by the generation of the process \[ns\].
    pub(super) traces: BTreeMap<u32, u64>,
    pub(super) closing: Closing,
    /// Somebody has published from another seat than the first.
    pub(super) changed_hands: bool,
}

impl Recorded {
    /// Only of flights in which nobody followed anybody on a slot's other seats.
    pub(super) fn of_one_hand(self) -> Result<Self, ReplayError> {
        if self.changed_hands { Err(ReplayError::ChangedHands) } else { Ok(self) }
    }

    /// True if the flight's own audit says that the recorder lost samples of a topic.
    pub(super) fn has_gaps(&self, topic: &str) -> bool {
        let of_topic = |key: &str| key.split_once('#').is_some_and(|(name, _)| name == topic);
        self.closing.audit.iter().any(|(key, tally)| {
            of_topic(key.trim_start_matches('/')) && !tally.contains("\"gaps\":0,")
        })
    }
}

impl Recorded {
    /// A process that was killed did not tell how far its inputs had got; the last state of its life
    /// does, so its life is replayed up to there.
    fn end_at_last_states(&mut self) {
        let deviations = self.tapes.of(&topics::DEVIATION);
        for (generation, last_ns) in &mut self.traces {
            let mut ends = deviations.iter().filter(|d| d.kind == DeviationKind::Ended);
            let in_order = ends.any(|d| d.header.generation == *generation);
            let of_life = |s: &&RecordedState| {
                s.header.generation == *generation && s.header.release_ns <= *last_ns
            };
            if !in_order && let Some(state) = self.states.iter().rev().find(of_life) {
                *last_ns = state.header.release_ns;
            }
        }
    }
}

struct Load<'a> {
    role: Role,
    topics: &'a Topics,
    recorded: Recorded,
}

impl Load<'_> {
    fn trace(&mut self, header: &Header) {
        let last_ns = self.recorded.traces.entry(header.generation).or_default();
        *last_ns = header.release_ns.max(*last_ns);
    }
}

impl RecordVisitor for Load<'_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        let own = [topics::LOOP_STATS.info.name, topics::DEVIATION.info.name];
        let Topics { read, written } = self.topics;
        [read.as_slice(), written, &own].concat().contains(&topic.name)
    }

    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        let header = sample.header();
        let role = if let Some(deviation) = any.downcast_ref::<Deviation>() {
            deviation.role
        } else if let Some(stats) = any.downcast_ref::<LoopStats>() {
            if stats.role == self.role {
                self.trace(header);
            }
            stats.role
        } else {
            if self.topics.written.contains(&topic.info.name) {
                self.trace(header);
            }
            self.role
        };
        let about_loops = topic.info.from == Role::Supervisor;
        self.recorded.changed_hands |= header.seat > 0 && !about_loops;
        if role == self.role {
            self.recorded.tapes.push(topic, *sample);
        }
    }

    fn state(&mut self, role: Role, header: &Header, state: &[u8]) {
        if role == self.role {
            self.trace(header);
            self.recorded.states.push(RecordedState { header: *header, bytes: state.to_vec() });
        }
    }
}

/// Loads what a replay of `role` needs: its topics, states, statistics and deviations.
pub(super) fn load(
    flight: &RecordedFlight,
    role: Role,
    topics: &Topics,
) -> Result<Recorded, ReadError> {
    let mut load = Load { role, topics, recorded: Recorded::default() };
    let closing = flight.visit(&mut load)?;
    let mut recorded = load.recorded;
    if !closing.complete
        && let Some((generation, last_ns)) = recorded.traces.pop_last()
    {
        // Behind a cut, what a step had may be missing although what it gave is there: the recorder
        // takes the topics in turn, and a loop may be this far ahead of another.
        if let Some(held_ns) = last_ns.checked_sub(CREDIT_NS) {
            recorded.traces.insert(generation, held_ns);
        }
    }
    recorded.end_at_last_states();
    Ok(Recorded { closing, ..recorded })
}
