//! Topics within one test: several readers per topic, bounded queues that drop their oldest sample,
//! history for late joiners, and an outbox per process so that a mark can lag its samples.

use core::cell::RefCell;
use runtime::graph::READER_CAPACITY;
use runtime::{Sink, Source, StateSink};
use shared_types::wire::{HASH_SEED, hash_bytes};
use shared_types::{Header, LoopStats, Role, Sample, Topic};
use std::any::Any;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

/// Shared by all that runs in the test's single thread.
pub(crate) type Shared<T> = Rc<RefCell<T>>;
/// What a process has sent and no other has seen yet, in the order sent.
pub(crate) type Outbox = Shared<VecDeque<Box<dyn FnOnce()>>>;

pub(crate) fn shared<T>(value: T) -> Shared<T> {
    Rc::new(RefCell::new(value))
}

/// One topic.
struct Hub<T> {
    readers: BTreeMap<usize, VecDeque<T>>,
    history: VecDeque<T>,
    depth: usize,
}

/// Every topic of a flight and what travelled on it.
#[derive(Clone, Default)]
pub(crate) struct Network {
    hubs: Shared<BTreeMap<&'static str, Rc<dyn Any>>>,
    pub(crate) log: Shared<Log>,
}

/// What an observer saw.
#[derive(Debug, Default)]
pub(crate) struct Log {
    /// Hash of each sample by topic, in the order of sequences.
    pub(crate) streams: BTreeMap<&'static str, Vec<u64>>,
    /// Samples that came again with other contents, or out of sequence.
    pub(crate) contradictions: Vec<String>,
    /// Processes restarted.
    pub(crate) restarts: u64,
    /// Samples dropped by full readers.
    pub(crate) overflowed: u64,
    /// Release of each loop statistic by role and sequence.
    pub(crate) stats: BTreeMap<(usize, u64), u64>,
    /// Largest number of samples queued or pending, by topic and consumer.
    pub(crate) peaks: BTreeMap<(&'static str, usize), u64>,
}

impl Log {
    fn note(&mut self, topic: &'static str, header: &Header, hash: u64) {
        let stream = self.streams.entry(topic).or_default();
        let at = usize::try_from(header.sequence).unwrap_or(0).wrapping_sub(1);
        match stream.get(at) {
            Some(&known) if known == hash => {}
            None if at == stream.len() => stream.push(hash),
            _ => self.contradictions.push(format!("{topic} #{}", header.sequence)),
        }
    }
}

/// Everything about a sample that a rerun must repeat: not the host stamps, not the generation.
pub(crate) fn fingerprint<T: Sample>(sample: &T) -> u64 {
    let mut sample = *sample;
    let header = sample.header_mut();
    header.generation = 0;
    header.release_mono_ns = 0;
    header.receive_mono_ns = 0;
    header.start_mono_ns = 0;
    header.publish_mono_ns = 0;
    let mut bytes = vec![0; T::PACKED_SIZE];
    sample.pack(&mut bytes);
    hash_bytes(HASH_SEED, &bytes)
}

impl Network {
    fn hub<T: Sample>(&self, topic: &'static Topic<T>) -> Shared<Hub<T>> {
        let mut hubs = self.hubs.borrow_mut();
        let hub = hubs.entry(topic.info.name).or_insert_with(|| {
            let (readers, history) = (BTreeMap::new(), VecDeque::new());
            Rc::new(RefCell::new(Hub::<T> { readers, history, depth: topic.info.history }))
        });
        Rc::clone(hub).downcast().expect("a topic has one sample type")
    }

    /// A reader for `role`, which replaces its predecessor and gets the history.
    pub(crate) fn reader<T: Sample>(
        &self,
        topic: &'static Topic<T>,
        role: Role,
    ) -> Box<dyn Source<T>> {
        let hub = self.hub(topic);
        let history = hub.borrow().history.clone();
        hub.borrow_mut().readers.insert(role.index(), history);
        Box::new(Reader { hub, role })
    }

    /// A writer of `generation`; what its predecessor kept for late joiners is gone.
    pub(crate) fn writer<T: Sample>(
        &self,
        topic: &'static Topic<T>,
        outbox: &Outbox,
    ) -> Box<dyn Sink<T>> {
        let hub = self.hub(topic);
        hub.borrow_mut().history.clear();
        let log = Rc::clone(&self.log);
        Box::new(Writer { hub, log, outbox: Rc::clone(outbox), name: topic.info.name })
    }

    /// Samples that wait in front of a reader.
    pub(crate) fn queued<T: Sample>(&self, topic: &'static Topic<T>, role: Role) -> u64 {
        self.hub(topic).borrow().readers.get(&role.index()).map_or(0, |q| q.len() as u64)
    }
}

struct Reader<T> {
    hub: Shared<Hub<T>>,
    role: Role,
}

impl<T: Sample> Source<T> for Reader<T> {
    fn receive(&mut self) -> Option<T> {
        self.hub.borrow_mut().readers.get_mut(&self.role.index())?.pop_front()
    }
}

struct Writer<T> {
    hub: Shared<Hub<T>>,
    log: Shared<Log>,
    outbox: Outbox,
    name: &'static str,
}

impl<T: Sample> Sink<T> for Writer<T> {
    fn send(&mut self, sample: &T) {
        let (hub, log, sample) = (Rc::clone(&self.hub), Rc::clone(&self.log), *sample);
        let name = self.name;
        self.outbox.borrow_mut().push_back(Box::new(move || {
            log.borrow_mut().note(name, sample.header(), fingerprint(&sample));
            let hub = &mut *hub.borrow_mut();
            for queue in hub.readers.values_mut() {
                if queue.len() == READER_CAPACITY {
                    queue.pop_front();
                    log.borrow_mut().overflowed += 1;
                }
                queue.push_back(sample);
            }
            if hub.history.len() == hub.depth {
                hub.history.pop_front();
            }
            hub.history.push_back(sample);
        }));
    }
    fn serve_late_joiners(&mut self) {}
}

/// Notes loop statistics.
pub(crate) struct StatsSink {
    pub(crate) log: Shared<Log>,
}

impl Sink<LoopStats> for StatsSink {
    fn send(&mut self, sample: &LoopStats) {
        let mut log = self.log.borrow_mut();
        let key = (sample.role.index(), sample.header.sequence);
        let release_ns = sample.header.release_ns;
        if *log.stats.entry(key).or_insert(release_ns) != release_ns {
            log.contradictions.push(format!("loop statistics {key:?} at {release_ns}"));
        }
    }
    fn serve_late_joiners(&mut self) {}
}

/// Keeps the last published state with its sequence.
pub(crate) struct StateKeeper {
    pub(crate) outbox: Outbox,
    pub(crate) last: Shared<Option<(Header, Vec<u8>)>>,
}

impl StateSink for StateKeeper {
    fn send(&mut self, header: &Header, state: &[u8]) {
        let (last, header, state) = (Rc::clone(&self.last), *header, state.to_vec());
        self.outbox.borrow_mut().push_back(Box::new(move || {
            *last.borrow_mut() = Some((header, state));
        }));
    }
    fn serve_late_joiners(&mut self) {}
}
