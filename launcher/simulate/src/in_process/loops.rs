//! The loops of a flight in one process: components in executors, and processes.

use super::InProcessError;
use super::checkpoint::Checkpoint;
use super::observer::ErasedObserver;
use super::outside::OutsideLoop;
use super::stepper::{InstanceMark, Stepper};
use super::wires::Wires;
use replay::Course;
use runtime::executor::StateSink;
use runtime::{Component, Executor, Graph, Node, Place};
use shared_types::{Header, Role, Seat};
use std::rc::Rc;
use swap::PostEvent;
use timing::LoopName;

/// Shows states to the observer.
struct StateTap {
    role: Role,
    observer: Rc<dyn ErasedObserver>,
}

impl StateSink for StateTap {
    fn wants(&self, header: &Header) -> bool {
        self.observer.wants_state(self.role, header)
    }
    fn send(&mut self, header: &Header, state: &[u8]) {
        self.observer.observe_state(self.role, header, state);
    }
    fn serve_late_joiners(&mut self) {}
}

/// Makes a loop of a component.
pub(super) struct Connect<'a> {
    pub(super) graph: &'a Graph,
    pub(super) node: Node,
    pub(super) place: Seat,
    pub(super) generation: u32,
    /// Name of the service.
    pub(super) name: &'a str,
    pub(super) wires: &'a mut Wires,
    pub(super) from: Option<&'a Checkpoint>,
}

impl Connect<'_> {
    /// Connects its ports and takes it to where the flight is.
    pub(super) fn connect(self, component: Component) -> Result<Loop, InProcessError> {
        let Self { node, place: seat, generation, .. } = self;
        let place = Place { seat: seat.index, generation };
        // From a predecessor's state of another kind it tracks.
        let taken_over = self.from.and_then(|from| from.taken_over(node.role, &component));
        let state = self.from.and_then(|checkpoint| checkpoint.state(node.role));
        let (state, tracks) = (taken_over.as_deref().or(state), taken_over.is_some());
        let mut executor = Executor::new(component, node, place);
        self.wires.connect(self.graph, &mut executor);
        let observer = self.wires.observer();
        if observer.wants_states() {
            executor.connect_state(Box::new(StateTap { role: self.node.role, observer }));
        }
        if let Some(checkpoint) = self.from {
            let role = self.node.role;
            let restored = state.map_or(Ok(()), |state| executor.take_up(state));
            restored.map_err(|error| InProcessError::Restore { role: role.label(), error })?;
            if let Some(at_ns) = checkpoint.exact_ns() {
                executor.continue_at(at_ns);
            }
            if tracks {
                let first_ns = executor.mark_ns();
                executor.join_at(first_ns, first_ns + 1);
            }
        }
        Ok(Loop {
            node,
            place: seat,
            generation,
            name: self.name.to_owned(),
            period_ns: node.rate.period_ns(),
            waits: false,
            leave_ns: u64::MAX,
            stepper: Box::new(executor),
            course: Course::default(),
            published: Published::There,
        })
    }
}

/// One loop of the flight.
pub(super) struct Loop {
    pub(super) node: Node,
    /// Its seat, and how many have had that before.
    pub(super) place: Seat,
    pub(super) generation: u32,
    /// Name of the service; of a process nothing needs it.
    pub(super) name: String,
    pub(super) period_ns: u64,
    /// It has been started in flight and not been given where to begin, has been stopped, or has failed.
    pub(super) waits: bool,
    /// From then on the seat is no longer its \[ns\].
    pub(super) leave_ns: u64,
    pub(super) stepper: Box<dyn Stepper>,
    /// What it goes through again; nothing in a flight of its own.
    pub(super) course: Course,
    /// From what another can go on.
    pub(super) published: Published,
}

/// The state after a loop's last published step.
pub(super) enum Published {
    /// It is there still.
    There,
    /// It has gone on from there; none if it had not published any step.
    Kept(Option<Vec<u8>>),
}

impl Loop {
    /// A process that has sent its hello and not been given where to begin.
    pub(super) fn outside(
        (node, place, generation): (Node, Seat, u32),
        process: OutsideLoop,
    ) -> Self {
        let period_ns = process.period_ns();
        let (stepper, course) = (Box::new(process), Course::default());
        let (waits, leave_ns) = (true, u64::MAX);
        let (name, published) = (String::new(), Published::There);
        Self {
            node,
            place,
            generation,
            name,
            period_ns,
            waits,
            leave_ns,
            stepper,
            course,
            published,
        }
    }

    /// How far it has got.
    pub(super) fn mark(&self) -> InstanceMark {
        let Self { place, generation, period_ns, .. } = *self;
        InstanceMark { place, generation, period_ns, mark_ns: self.stepper.next_ns() }
    }

    /// The state after its last published step, from which another may go on.
    pub(super) fn state(&mut self) -> Option<Vec<u8>> {
        match &self.published {
            Published::There => self.stepper.state(),
            Published::Kept(state) => state.clone(),
        }
    }

    /// What a script of times may name.
    pub(super) fn loop_name(&self) -> LoopName<'_> {
        LoopName { role: self.place.role, name: &self.name }
    }

    pub(super) fn flies(&self) -> bool {
        !self.waits
    }

    /// It is there, and may be given where to begin.
    pub(super) fn joined(&self) -> PostEvent {
        let layout = self.stepper.layout();
        PostEvent::Joined { place: self.place, layout, period_ns: self.period_ns }
    }
}
