//! Samples by topic with their types forgotten: what was recorded, and what comes out of a replay.

use super::component_topics::Topics;
use super::life_key::LifeKey;
use record::read::{Closing, ReadError, RecordVisitor, RecordedFlight, RecordedState};
use runtime::graph::CREDIT_NS;
use shared_types::{
    Deviation, DeviationKind, Header, LoopStats, Role, Sample, Seating, SeatingKind, Slot, Topic,
    TopicInfo, topics,
};
use std::any::Any;
use std::collections::{BTreeMap, BTreeSet};
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

    /// Adds a sample. No reader may hold the topic's tape meanwhile.
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

/// Where the recorder has lost samples that a role reads: its steps after that had inputs that the file has not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loss {
    /// Name of the topic.
    pub topic: &'static str,
    /// Release of the last sample before those that are missing \[ns\].
    pub after_ns: u64,
}

/// What a recording holds for one role.
#[derive(Debug, Default)]
pub(super) struct Recorded {
    pub(super) tapes: Tapes,
    pub(super) states: Vec<RecordedState>,
    /// Last step that left a trace and can be replayed, of each life \[ns\].
    pub(super) traces: BTreeMap<LifeKey, u64>,
    /// How those began that took a seat in flight.
    pub(super) seatings: BTreeMap<LifeKey, Seating>,
    /// When processes of any role joined: role, seat and generation \[ns\].
    pub(super) joined: BTreeMap<(Role, u32, u32), u64>,
    /// Scenarios that configure one controller alone, by their names.
    pub(super) configs: BTreeMap<String, String>,
    /// Those that left in order.
    pub(super) in_order: BTreeSet<LifeKey>,
    pub(super) closing: Closing,
    /// Where the numbers of each topic that the role reads jump first.
    jumps: BTreeMap<&'static str, u64>,
}

impl Recorded {
    /// The first of what the recorder has lost of the role's inputs.
    pub(super) fn loss(&self) -> Option<Loss> {
        let lost = self.jumps.iter().filter(|(topic, _)| self.has_gaps(topic));
        lost.map(|(topic, after_ns)| Loss { topic, after_ns: *after_ns }).min_by_key(|l| l.after_ns)
    }

    /// Seat and generation of those that took a free seat of a slot in flight, and since when they have had it, as far
    /// as the slot's owner records are among the inputs \[ns\].
    pub(super) fn free_seats_taken(&self, slot: Role) -> Vec<((u32, u32), u64)> {
        let Some(spec) = Slot::of(slot).map(Slot::spec) else { return Vec::new() };
        let records = self.tapes.of(spec.owner);
        let joined = self.joined.iter().filter(|((role, ..), _)| *role == slot);
        let taken = joined.filter_map(|((_, seat, generation), joined_ns)| {
            let index = usize::try_from(*seat).ok()?;
            let (mut was_taken, mut since_ns) = (true, None);
            for record in records.iter() {
                let is_after = record.header.valid_ns > *joined_ns;
                if is_after && was_taken {
                    break;
                }
                let is_taken = record.period_ns.get(index).is_some_and(|period_ns| *period_ns > 0);
                if is_taken != was_taken {
                    since_ns = is_taken.then_some(record.header.valid_ns);
                }
                was_taken = is_taken;
            }
            Some(((*seat, *generation), since_ns?))
        });
        taken.collect()
    }

    /// True if the flight's own audit states that the recorder lost samples of a topic.
    pub(super) fn has_gaps(&self, topic: &str) -> bool {
        let of_topic = |key: &str| key.split_once('#').is_some_and(|(name, _)| name == topic);
        self.closing.audit.iter().any(|(key, tally)| {
            of_topic(key.trim_start_matches('/')) && !tally.contains("\"gaps\":0,")
        })
    }

    /// Finds those that reported how far their inputs had got when they left.
    fn find_ends(&mut self) {
        // At a step the same kind reports the end of a writer in a slot; for other inputs it comes only at the end.
        let of_the_end: BTreeSet<&str> = topics::all()
            .into_iter()
            .filter(|topic| topic.from.seats() == 1)
            .map(|topic| topic.name)
            .collect();
        for deviation in self.tapes.of(&topics::DEVIATION).iter() {
            let life = LifeKey::of_deviation(&deviation.header);
            let last_ns = self.traces.get(&life).copied().unwrap_or(0);
            if deviation.kind == DeviationKind::Ended
                && of_the_end.contains(deviation.input_name())
                && deviation.header.release_ns > last_ns
            {
                self.in_order.insert(life);
            }
        }
    }

    /// Behind a cut, what a step had may be missing although what it gave is there: the recorder takes
    /// the topics in turn, and a loop may be a credit ahead of another.
    fn hold_back(&mut self) {
        let held_ns = self.traces.values().max().and_then(|last| last.checked_sub(CREDIT_NS));
        let Some(held_ns) = held_ns else { return self.traces.clear() };
        for (life, last_ns) in &mut self.traces {
            if *last_ns > held_ns {
                *last_ns = held_ns;
                self.in_order.remove(life);
            }
        }
    }

    /// A process that was killed did not report how far its inputs had got; the last state of its life
    /// shows it, so its life is replayed up to there.
    fn end_at_last_states(&mut self) {
        let open = self.traces.iter_mut().filter(|(life, _)| !self.in_order.contains(*life));
        for (life, last_ns) in open {
            let of_life = |s: &&RecordedState| {
                LifeKey::of(&s.header) == *life && s.header.release_ns <= *last_ns
            };
            if let Some(state) = self.states.iter().rev().find(of_life) {
                *last_ns = state.header.release_ns;
            }
        }
    }
}

struct Load<'a> {
    role: Role,
    topics: &'a Topics,
    recorded: Recorded,
    /// The newest sample of each topic, seat and process.
    newest: BTreeMap<(&'static str, u32, u32), Header>,
}

impl Load<'_> {
    fn trace(&mut self, life: LifeKey, header: &Header) {
        let last_ns = self.recorded.traces.entry(life).or_default();
        *last_ns = header.release_ns.max(*last_ns);
    }

    fn note_jump(&mut self, topic: &'static TopicInfo, header: &Header) {
        // The numbers of two processes have no relation to one another.
        let key = (topic.name, header.seat, header.generation);
        let before = self.newest.get(&key);
        if let Some(before) =
            before.filter(|before| header.sequence > before.sequence.saturating_add(1))
        {
            self.recorded.jumps.entry(topic.name).or_insert(before.release_ns);
        }
        if before.is_none_or(|before| header.sequence > before.sequence) {
            self.newest.insert(key, *header);
        }
    }
}

impl RecordVisitor for Load<'_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        let own = [&topics::LOOP_STATS.info, &topics::DEVIATION.info, &topics::SEATING.info];
        let Topics { read, written } = self.topics;
        let own = own.map(|topic| topic.name);
        [read.as_slice(), written, &own].concat().contains(&topic.name)
    }

    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        let header = sample.header();
        let role = if let Some(seating) = any.downcast_ref::<Seating>() {
            if seating.kind == SeatingKind::Joined {
                let Seating { role, seat, generation, .. } = *seating;
                self.recorded.joined.insert((role, seat, generation), header.valid_ns);
                if role == self.role {
                    self.recorded.seatings.insert(LifeKey { seat, generation }, *seating);
                }
            }
            return;
        } else if let Some(deviation) = any.downcast_ref::<Deviation>() {
            deviation.role
        } else if let Some(stats) = any.downcast_ref::<LoopStats>() {
            if stats.role == self.role {
                self.trace(LifeKey::of_stats(header), header);
            }
            stats.role
        } else {
            if self.topics.read.contains(&topic.info.name) {
                self.note_jump(&topic.info, header);
            }
            if self.topics.written.contains(&topic.info.name) {
                self.trace(LifeKey::of(header), header);
            }
            self.role
        };
        if role == self.role {
            if any.is::<Deviation>() {
                // What a loop reported steers its replay as much as its inputs do.
                self.note_jump(&topic.info, header);
            }
            self.recorded.tapes.push(topic, *sample);
        }
    }

    fn scenario(&mut self, name: &str, text: &str) {
        self.recorded.configs.insert(name.to_owned(), text.to_owned());
    }

    fn reads_states(&self) -> bool {
        true
    }

    fn state(&mut self, role: Role, header: &Header, state: &[u8]) {
        if role == self.role {
            self.trace(LifeKey::of(header), header);
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
    flight.require_memory()?;
    let (recorded, newest) = (Recorded::default(), BTreeMap::new());
    let mut load = Load { role, topics, recorded, newest };
    let closing = flight.visit(&mut load)?;
    closing.require_no_holes(flight.path())?;
    let mut recorded = load.recorded;
    recorded.find_ends();
    if !closing.complete {
        recorded.hold_back();
    }
    recorded.end_at_last_states();
    Ok(Recorded { closing, ..recorded })
}

#[cfg(test)]
mod tests {
    use super::{Load, Loss, Recorded, Topics};
    use record::read::RecordVisitor as _;
    use shared_types::{Header, Role, StateEstimate, topics};
    use std::collections::BTreeMap;

    #[test]
    fn what_the_recorder_lost_of_an_input_is_known_by_the_sample_before_it() {
        let topics = Topics { read: vec!["state_estimate"], written: Vec::new() };
        let (recorded, newest) = (Recorded::default(), BTreeMap::new());
        let mut load = Load { role: Role::Position, topics: &topics, recorded, newest };
        for sequence in [1, 2, 5, 6, 9] {
            let release_ns = sequence * 1_000_000;
            let header = Header { sequence, release_ns, ..Header::default() };
            load.sample(&topics::STATE_ESTIMATE, &StateEstimate { header, ..Default::default() });
        }
        let mut recorded = load.recorded;
        let tally = |gaps: u32| format!("{{\"count\":5,\"gaps\":{gaps},\"repeated\":0}}");
        recorded.closing.audit.insert("/state_estimate#0".to_owned(), tally(0));
        assert_eq!(recorded.loss(), None, "a restarted writer may leave numbers out");
        recorded.closing.audit.insert("/state_estimate#0".to_owned(), tally(4));
        let loss = Loss { topic: "state_estimate", after_ns: 2_000_000 };
        assert_eq!(recorded.loss(), Some(loss));
    }
}
