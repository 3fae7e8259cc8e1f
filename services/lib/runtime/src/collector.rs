//! Takes samples out of ports of limited room, for a loop that may be stopped for longer than these last.

use crate::input::Source;
use core::cell::RefCell;
use shared_types::Sample;
use std::collections::VecDeque;
use std::rc::{Rc, Weak};

/// What has come to the ports of one process and has not been received.
#[derive(Default)]
pub(crate) struct Collector {
    ports: RefCell<Vec<Weak<dyn Collect>>>,
}

impl core::fmt::Debug for Collector {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Collector").field("ports", &self.ports.borrow().len()).finish()
    }
}

trait Collect {
    fn collect(&self);
}

/// A port, and what has been taken out of it.
struct Port<T, S> {
    source: RefCell<S>,
    samples: RefCell<VecDeque<T>>,
}

impl<T: Sample, S: Source<T>> Collect for Port<T, S> {
    fn collect(&self) {
        let mut source = self.source.borrow_mut();
        let mut samples = self.samples.borrow_mut();
        while let Some(sample) = source.receive() {
            samples.push_back(sample);
        }
    }
}

struct CollectedSource<T, S>(Rc<Port<T, S>>);

impl<T: Sample, S: Source<T>> Source<T> for CollectedSource<T, S> {
    fn receive(&mut self) -> Option<T> {
        self.0.collect();
        self.0.samples.borrow_mut().pop_front()
    }
}

impl Collector {
    /// What a port gives, with room for all of it.
    pub(crate) fn source<T: Sample, S: Source<T> + 'static>(
        &self,
        source: S,
    ) -> impl Source<T> + use<T, S> {
        let source = RefCell::new(source);
        let port = Rc::new(Port { source, samples: RefCell::default() });
        let weak: Weak<dyn Collect> = Rc::<Port<T, S>>::downgrade(&port);
        self.ports.borrow_mut().push(weak);
        CollectedSource(port)
    }

    /// Takes out of all ports what has come.
    pub(crate) fn collect(&self) {
        self.ports.borrow().iter().filter_map(Weak::upgrade).for_each(|port| port.collect());
    }
}
