//! Who looks on while a flight is flown.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use observe::Observer;
use shared_types::{Header, Role, Sample, Topic, TopicVisitor, topics};
use std::any::Any;
use std::collections::BTreeMap;
use std::rc::Rc;

/// An observer among those who publish, who may be told to look away.
#[derive(Debug)]
pub(super) struct Audience<O> {
    observer: RefCell<O>,
    looks_away: Cell<bool>,
}

impl<O: Observer> Audience<O> {
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
pub(super) trait Listen<T: Sample> {
    fn alter(&self, topic: &'static Topic<T>, sample: &mut T);
    fn observe(&self, topic: &'static Topic<T>, sample: &T);
}

impl<T: Sample, O: Observer> Listen<T> for Audience<O> {
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
pub(super) trait Overhear {
    fn wants_states(&self) -> bool;
    fn observe_state(&self, role: Role, header: &Header, state: &[u8]);
    fn note(&self, logical_ns: u64, warning: bool, text: &str);
}

impl<O: Observer> Overhear for Audience<O> {
    fn wants_states(&self) -> bool {
        self.observer.borrow().wants_states()
    }

    fn observe_state(&self, role: Role, header: &Header, state: &[u8]) {
        if !self.looks_away.get() {
            self.observer.borrow_mut().observe_state(role, header, state);
        }
    }

    fn note(&self, logical_ns: u64, warning: bool, text: &str) {
        if !self.looks_away.get() {
            self.observer.borrow_mut().note(logical_ns, warning, text);
        }
    }
}

/// An observer with its type forgotten.
#[derive(Clone)]
pub(super) struct Ears {
    /// `Rc<dyn Listen<T>>` by topic name.
    topics: Rc<BTreeMap<&'static str, Box<dyn Any>>>,
    others: Rc<dyn Overhear>,
}

impl Ears {
    pub(super) fn of<O: Observer>(audience: &Rc<Audience<O>>) -> Self {
        let mut collect = Collect { audience, topics: BTreeMap::new() };
        let Ok(()) = topics::visit_all(&mut collect);
        let topics = Rc::new(collect.topics);
        Self { topics, others: Rc::<Audience<O>>::clone(audience) }
    }

    /// Those for one topic.
    pub(super) fn on<T: Sample>(&self, topic: &'static Topic<T>) -> Rc<dyn Listen<T>> {
        let ear = self.topics.get(topic.info.name).and_then(|ear| ear.downcast_ref());
        ear.map_or_else(|| unreachable!("every topic is of the table"), Rc::clone)
    }

    /// Those for everything else.
    pub(super) fn others(&self) -> Rc<dyn Overhear> {
        Rc::clone(&self.others)
    }
}

struct Collect<'a, O> {
    audience: &'a Rc<Audience<O>>,
    topics: BTreeMap<&'static str, Box<dyn Any>>,
}

impl<O: Observer> TopicVisitor for Collect<'_, O> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let ear: Rc<dyn Listen<T>> = Rc::<Audience<O>>::clone(self.audience);
        self.topics.insert(topic.info.name, Box::new(ear));
        Ok(())
    }
}
