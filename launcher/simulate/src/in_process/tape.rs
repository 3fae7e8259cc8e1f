//! Everything that a flight has published, to take it up again in the middle.

use ::observe::Observer;
use record::read::RecordVisitor;
use runtime::StateHeader;
use runtime::graph::ROLES;
use shared_types::{Deviation, Edge, Header, Role, Sample, Topic, TopicVisitor, topics};
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
    /// A replay of the flight cannot do without it.
    is_kept: bool,
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
        self.add_state(role, header, state, false);
    }
    fn keep_state(&mut self, role: Role, header: &Header, state: &[u8]) {
        let published = self.states.get_mut(role.index()).and_then(|states| {
            let number = |header: &Header| (header.seat, header.generation, header.sequence);
            states.iter_mut().rev().find(|known| number(&known.header) == number(header))
        });
        match published {
            Some(published) => published.is_kept = true,
            None => self.add_state(role, header, state, true),
        }
    }
}

/// A tape is also what a recording is read into.
impl RecordVisitor for Tape {
    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.observe(topic, sample);
    }
    fn reads_states(&self) -> bool {
        true
    }
    fn state(&mut self, role: Role, header: &Header, state: &[u8]) {
        // A recording has none that is not needed.
        self.add_state(role, header, state, true);
    }
}

impl Tape {
    fn add_state(&mut self, role: Role, header: &Header, state: &[u8], is_kept: bool) {
        let head = StateHeader::of(state);
        if let (Some(head), Some(keyframes)) = (head, self.states.get_mut(role.index())) {
            let (header, release_ns) = (*header, head.release_ns);
            keyframes.push(Keyframe { header, release_ns, state: state.to_vec(), is_kept });
        }
    }

    /// Samples of a topic.
    #[must_use]
    pub fn samples<T: Sample>(&self, topic: &'static Topic<T>) -> &[T] {
        let log = self.samples.get(topic.info.name).and_then(|log| log.downcast_ref::<Vec<T>>());
        log.map_or(&[], Vec::as_slice)
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

    /// How many times the process of a role had been restarted by `t_ns`.
    #[must_use]
    pub fn generation_at(&self, role: Role, t_ns: u64) -> u32 {
        let keyframes = self.states.get(role.index()).into_iter().flatten();
        let before = keyframes.take_while(|keyframe| keyframe.release_ns < t_ns);
        before.map(|keyframe| keyframe.header.generation).last().unwrap_or(0)
    }

    /// What one life of a role's process reported about its steps before `t_ns`.
    pub fn reported_by(
        &self,
        role: Role,
        generation: u32,
        t_ns: u64,
    ) -> impl Iterator<Item = &Deviation> {
        self.samples(&topics::DEVIATION).iter().filter(move |deviation| {
            let Header { generation: life, release_ns, .. } = deviation.header;
            deviation.role == role && life == generation && release_ns < t_ns
        })
    }

    /// Shows an observer everything, as [`show_before`](Self::show_before) does.
    pub fn show_all<O: Observer>(&self, observer: &mut O) {
        // What is published ahead, of owners and seats, may be about later instants than any step.
        let mut last = LastRelease { tape: self, t_ns: 0 };
        let Ok(()) = topics::visit_all(&mut last);
        self.show_before(last.t_ns + 1, observer);
    }

    /// Shows an observer everything released before `t_ns`, and the owners of the slots then, topic by topic within
    /// 20 ms, owners first; then the states.
    pub fn show_before<O: Observer>(&self, t_ns: u64, observer: &mut O) {
        // Ownership is published before the first step, also to what begins there.
        let end_ns = t_ns.max(1);
        let observer = &mut *observer;
        let mut show = Show {
            tape: self,
            observer,
            order: BTreeMap::new(),
            of_owners: true,
            from_ns: 0,
            until_ns: 0,
            t_ns,
        };
        while show.from_ns < end_ns {
            show.until_ns = show.from_ns.saturating_add(SHOWN_AT_ONCE_NS).min(end_ns);
            for of_owners in [true, false] {
                show.of_owners = of_owners;
                let Ok(()) = topics::visit_all(&mut show);
            }
            show.from_ns = show.until_ns;
        }
        if observer.wants_states() {
            for (role, keyframes) in Role::STEPPING.into_iter().zip(&self.states) {
                for keyframe in keyframes.iter().take_while(|k| k.release_ns < t_ns) {
                    let Keyframe { header, state, .. } = keyframe;
                    observer.observe_state(role, header, state);
                    if keyframe.is_kept {
                        observer.keep_state(role, header, state);
                    }
                }
            }
        }
    }
}

struct LastRelease<'a> {
    tape: &'a Tape,
    t_ns: u64,
}

impl TopicVisitor for LastRelease<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let samples = self.tape.samples(topic).iter();
        self.t_ns = samples.map(|s| s.header().release_ns).fold(self.t_ns, u64::max);
        Ok(())
    }
}

/// Of each topic, what an observer is shown before it sees the next topic \[ns\]. Observers compare topics by what they keep
/// of the newest samples, which at 10 kHz is no more than 25 ms.
const SHOWN_AT_ONCE_NS: u64 = 20_000_000;

struct Show<'a, O> {
    tape: &'a Tape,
    observer: &'a mut O,
    /// Samples by release, of each topic: several loops may write it, each in an order of its own.
    order: BTreeMap<&'static str, Vec<usize>>,
    /// Whether it is the turn of who owns the slots, which is published ahead, or of all other topics.
    of_owners: bool,
    from_ns: u64,
    until_ns: u64,
    /// Steps from here on are not shown.
    t_ns: u64,
}

impl<O: Observer> TopicVisitor for Show<'_, O> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let is_owner = topic.info.from == Role::Supervisor && topic.info.edge == Edge::Delayed;
        if is_owner != self.of_owners {
            return Ok(());
        }
        let samples = self.tape.samples(topic);
        let released = |index: &usize| samples[*index].header().release_ns;
        let order = self.order.entry(topic.info.name).or_insert_with(|| {
            let mut order: Vec<usize> = (0..samples.len()).collect();
            order.sort_by_key(released);
            order
        });
        let until_ns = if is_owner { self.until_ns } else { self.until_ns.min(self.t_ns) };
        let first = |t_ns: u64| order.partition_point(|index| released(index) < t_ns);
        let shown = first(self.from_ns)..first(until_ns).max(first(self.from_ns));
        for index in &order[shown] {
            self.observer.observe(topic, &samples[*index]);
        }
        Ok(())
    }
}
