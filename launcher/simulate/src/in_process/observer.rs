//! The observers of a flight while it is flown.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use observe::Observer;
use shared_types::{Header, Role, Sample, Topic, TopicVisitor, topics};
use std::any::Any;
use std::collections::BTreeMap;
use std::rc::Rc;

/// An observer that all publishers share, and that may be switched off.
#[derive(Debug)]
pub(super) struct SharedObserver<O> {
    observer: RefCell<O>,
    looks_away: Cell<bool>,
}

impl<O: Observer> SharedObserver<O> {
    pub(super) fn new(observer: O) -> Self {
        Self { observer: RefCell::new(observer), looks_away: Cell::new(false) }
    }

    /// What is published is not shown to it, or is again.
    pub(super) fn look_away(&self, looks_away: bool) {
        self.looks_away.set(looks_away);
    }

    pub(super) fn with<R>(&self, look: impl FnOnce(&mut O) -> R) -> R {
        look(&mut self.observer.borrow_mut())
    }
}

/// What an observer is shown of one topic, with the type of the observer forgotten: otherwise the compiler
/// would make a copy of the whole flight for each.
pub(super) trait SampleTap<T: Sample> {
    fn alter(&self, topic: &'static Topic<T>, sample: &mut T);
    fn observe(&self, topic: &'static Topic<T>, sample: &T);
}

impl<T: Sample, O: Observer> SampleTap<T> for SharedObserver<O> {
    fn alter(&self, topic: &'static Topic<T>, sample: &mut T) {
        self.observer.borrow_mut().alter(topic, sample);
    }

    fn observe(&self, topic: &'static Topic<T>, sample: &T) {
        if !self.looks_away.get() {
            self.observer.borrow_mut().observe(topic, sample);
        }
    }
}

/// What it is shown besides.
pub(super) trait ErasedObserver {
    fn wants_states(&self) -> bool;
    fn wants_state(&self, role: Role, header: &Header) -> bool;
    fn observe_state(&self, role: Role, header: &Header, state: &[u8]);
    fn keep_state(&self, role: Role, header: &Header, state: &[u8]);
    fn note(&self, logical_ns: u64, warning: bool, text: &str);
}

impl<O: Observer> ErasedObserver for SharedObserver<O> {
    fn wants_states(&self) -> bool {
        self.observer.borrow().wants_states()
    }

    fn wants_state(&self, role: Role, header: &Header) -> bool {
        !self.looks_away.get() && self.observer.borrow().wants_state(role, header)
    }

    fn observe_state(&self, role: Role, header: &Header, state: &[u8]) {
        if !self.looks_away.get() {
            self.observer.borrow_mut().observe_state(role, header, state);
        }
    }

    fn keep_state(&self, role: Role, header: &Header, state: &[u8]) {
        if !self.looks_away.get() {
            self.observer.borrow_mut().keep_state(role, header, state);
        }
    }

    fn note(&self, logical_ns: u64, warning: bool, text: &str) {
        if !self.looks_away.get() {
            self.observer.borrow_mut().note(logical_ns, warning, text);
        }
    }
}

/// What an observer is shown of a flight: a tap for each topic, and everything else.
#[derive(Clone)]
pub(super) struct SampleTaps {
    /// `Rc<dyn SampleTap<T>>` by topic name.
    topics: Rc<BTreeMap<&'static str, Box<dyn Any>>>,
    others: Rc<dyn ErasedObserver>,
}

impl SampleTaps {
    pub(super) fn of<O: Observer>(shared: &Rc<SharedObserver<O>>) -> Self {
        let mut collect = Collect { shared, topics: BTreeMap::new() };
        let Ok(()) = topics::visit_all(&mut collect);
        let topics = Rc::new(collect.topics);
        Self { topics, others: Rc::<SharedObserver<O>>::clone(shared) }
    }

    /// Those for one topic.
    pub(super) fn on<T: Sample>(&self, topic: &'static Topic<T>) -> Rc<dyn SampleTap<T>> {
        let tap = self.topics.get(topic.info.name).and_then(|tap| tap.downcast_ref());
        tap.map_or_else(|| unreachable!("every topic is of the table"), Rc::clone)
    }

    /// Those for everything else.
    pub(super) fn others(&self) -> Rc<dyn ErasedObserver> {
        Rc::clone(&self.others)
    }
}

struct Collect<'a, O> {
    shared: &'a Rc<SharedObserver<O>>,
    topics: BTreeMap<&'static str, Box<dyn Any>>,
}

impl<O: Observer> TopicVisitor for Collect<'_, O> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let tap: Rc<dyn SampleTap<T>> = Rc::<SharedObserver<O>>::clone(self.shared);
        self.topics.insert(topic.info.name, Box::new(tap));
        Ok(())
    }
}
