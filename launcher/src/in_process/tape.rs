//! Everything that a flight has published, to take it up again in the middle.

use super::Observer;
use runtime::graph::ROLES;
use runtime::service::StateHeader;
use shared_types::wire::Value as _;
use shared_types::{Author, Header, OwnerRecord, Role, Sample, Topic, TopicVisitor, topics};
use std::any::Any;
use std::collections::BTreeMap;
use std::convert::Infallible;

/// Samples by topic and states by role, each in the order published.
#[derive(Default)]
pub struct Tape {
    /// `Vec<T>` by topic name.
    samples: BTreeMap<&'static str, Box<dyn Any + Send + Sync>>,
    /// By [`Role::index`].
    states: [Vec<Keyframe>; ROLES],
}

/// One published state.
struct Keyframe {
    header: Header,
    release_ns: u64,
    state: Vec<u8>,
}

impl core::fmt::Debug for Tape {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Tape").field("topics", &self.samples.keys()).finish_non_exhaustive()
    }
}

impl Observer for Tape {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let log = self.samples.entry(topic.info.name).or_insert_with(|| Box::new(Vec::<T>::new()));
        if let Some(log) = log.downcast_mut::<Vec<T>>() {
            log.push(*sample);
        }
    }
    fn wants_states(&self) -> bool {
        true
    }
    fn observe_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        let head = state.get(..StateHeader::PACKED_SIZE).map(StateHeader::unpack);
        if let (Some(head), Some(keyframes)) = (head, self.states.get_mut(role.index())) {
            let (header, release_ns) = (*header, head.release_ns);
            keyframes.push(Keyframe { header, release_ns, state: state.to_vec() });
        }
    }
}

impl Tape {
    /// Samples of a topic.
    #[must_use]
    pub fn samples<T: Sample>(&self, topic: &'static Topic<T>) -> &[T] {
        let log = self.samples.get(topic.info.name).and_then(|log| log.downcast_ref::<Vec<T>>());
        log.map_or(&[], Vec::as_slice)
    }

    /// The sample of this sequence; for topics with one producer.
    pub(super) fn at<T: Sample>(&self, topic: &'static Topic<T>, sequence: u64) -> Option<&T> {
        self.waiting(topic, sequence.saturating_sub(1), u64::MAX)
            .next()
            .filter(|sample| sample.header().sequence == sequence)
    }

    /// Samples that come after `sequence` and were released before `before_ns`; for topics with one
    /// producer.
    pub(super) fn waiting<T: Sample>(
        &self,
        topic: &'static Topic<T>,
        sequence: u64,
        before_ns: u64,
    ) -> impl Iterator<Item = &T> {
        let samples = self.samples(topic);
        let first = samples.partition_point(|s| s.header().sequence <= sequence);
        samples[first..].iter().take_while(move |s| s.header().release_ns < before_ns)
    }

    /// State of a role after its last keyframe before `t_ns`; none before its first.
    #[must_use]
    pub fn last_state_before(&self, role: Role, t_ns: u64) -> Option<&[u8]> {
        let keyframes = self.states.get(role.index())?;
        let after = keyframes.partition_point(|keyframe| keyframe.release_ns < t_ns);
        Some(keyframes[after.checked_sub(1)?].state.as_slice())
    }

    /// Who owned a slot at `t_ns`, as the samples of its owner are signed.
    pub(super) fn owner_at(&self, slot: Role, t_ns: u64) -> Option<Author> {
        let topic =
            if slot == Role::Attitude { &topics::ATTITUDE_OWNER } else { &topics::POSITION_OWNER };
        let records: &[OwnerRecord] = self.samples(topic);
        let mut in_effect = records.iter().filter(|record| record.header.valid_ns <= t_ns);
        in_effect.next_back().or(records.first()).map(|record| record.owner)
    }

    /// Shows an observer everything released before `t_ns`, and who owned the slots then, topic by
    /// topic within each second, so that what compares topics has little to keep; then the states.
    pub fn show_before<O: Observer>(&self, t_ns: u64, observer: &mut O) {
        let mut show = Show { tape: self, observer, shown: BTreeMap::new(), until_ns: 0 };
        loop {
            show.until_ns = show.until_ns.saturating_add(1_000_000_000).min(t_ns);
            let Ok(()) = topics::visit_all(&mut show);
            if show.until_ns >= t_ns {
                break;
            }
        }
        if observer.wants_states() {
            for (role, keyframes) in Role::STEPPING.into_iter().zip(&self.states) {
                for keyframe in keyframes.iter().take_while(|k| k.release_ns < t_ns) {
                    observer.observe_state(role, &keyframe.header, &keyframe.state);
                }
            }
        }
    }
}

struct Show<'a, O> {
    tape: &'a Tape,
    observer: &'a mut O,
    /// Samples shown so far, by topic name.
    shown: BTreeMap<&'static str, usize>,
    until_ns: u64,
}

impl<O: Observer> TopicVisitor for Show<'_, O> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let shown = self.shown.entry(topic.info.name).or_default();
        let rest = &self.tape.samples(topic)[*shown..];
        let sample: &dyn Any = &T::default();
        // Ownership is told before the first step.
        let from_start = u64::from(sample.is::<OwnerRecord>());
        let due = |s: &&T| s.header().release_ns < self.until_ns.saturating_add(from_start);
        for sample in rest.iter().take_while(due) {
            self.observer.observe(topic, sample);
            *shown += 1;
        }
        Ok(())
    }
}
