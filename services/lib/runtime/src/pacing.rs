//! When a loop by the wall clock steps: decided from marks, deadlines and the instant alone, so that the clock behind it may
//! be the host's or a simulated one.

use crate::clock::WallMap;
use crate::executor::Executor;
use crate::graph::MarkView;
use crate::graph::{Edge, Graph};
use crate::output::{Output, OutputVisitor};
use core::convert::Infallible;
use shared_types::{Role, Sample, Topic};

/// Longest wait for a wake-up, after which shared memory is read again: one that is lost costs time and no sample \[ns\].
pub const WAIT_LIMIT_NS: u64 = 20_000_000;

/// What a loop does now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// It rests until this instant of the host clock, whatever arrives \[ns\].
    Rest(u64),
    /// Inputs are not final: it waits until this instant, or until a producer wakes it \[ns\].
    Listen(u64),
    /// It begins the step that was due at this instant of the host clock \[ns\].
    Begin(u64),
}

/// Decides for one loop at one instant.
#[derive(Debug)]
pub struct Pacing<'a, M> {
    /// What it waits for.
    pub graph: &'a Graph,
    /// How far these have got.
    pub marks: &'a M,
    /// From logical time to the host clock.
    pub wall: WallMap,
    /// See [`is_timed`].
    pub is_timed: bool,
}

/// True if the clock of a role's loop starts its steps; otherwise its inputs do.
#[must_use]
pub fn is_timed(graph: &Graph, role: Role) -> bool {
    role == Role::Plant || !graph.edges().iter().any(|e| e.to == role && e.deadline_ns > 0)
}

impl<M: MarkView> Pacing<'_, M> {
    /// What the loop does at an instant of the host clock \[ns\]. One that is begun by its inputs has received what has
    /// arrived by then.
    #[must_use]
    pub fn next(&self, executor: &Executor, now_mono_ns: u64) -> Next {
        let deadline_mono_ns = self.deadline_mono_ns(executor);
        if deadline_mono_ns > now_mono_ns {
            return Next::Listen(deadline_mono_ns.min(now_mono_ns.saturating_add(WAIT_LIMIT_NS)));
        }
        // What is final before it is due is a release between two releases of the producer.
        let due_mono_ns = self.due_mono_ns(executor);
        if due_mono_ns > now_mono_ns { Next::Rest(due_mono_ns) } else { Next::Begin(due_mono_ns) }
    }

    /// Applies the miss policy to a step that begins at an instant of the host clock \[ns\], and counts inputs that are not
    /// final; false if the loop leaves the release out.
    pub fn begin(&self, executor: &mut Executor, start_mono_ns: u64) -> bool {
        let before_ns = executor.mark_ns();
        executor.apply_miss_policy(self.wall.logical_ns(start_mono_ns));
        if executor.mark_ns() != before_ns {
            return false;
        }
        let mut missing = self.missing(executor).peekable();
        if missing.peek().is_some() {
            executor.count_input_deadline_miss(missing);
        }
        true
    }

    /// Host instant from which the next release may run, before the start for a loop that works ahead \[ns\].
    fn due_mono_ns(&self, executor: &Executor) -> u64 {
        self.wall.mono_ns_ahead(executor.mark_ns(), executor.node().lead_ns)
    }

    /// Host instant until which the next release waits for inputs that are not final; 0 if it does not \[ns\].
    fn deadline_mono_ns(&self, executor: &Executor) -> u64 {
        if self.is_timed {
            return 0;
        }
        let deadline_ns = self.missing(executor).map(|e| e.deadline_ns).max();
        // A deadline is an instant of logical time: a slower clock stretches it with the flight.
        deadline_ns.map_or(0, |deadline_ns| {
            let until_ns = executor.mark_ns().saturating_add(deadline_ns);
            self.wall.mono_ns(until_ns.saturating_sub(executor.node().lead_ns))
        })
    }

    /// Edges that the next release waits for and that are not final yet.
    fn missing(&self, executor: &Executor) -> impl Iterator<Item = &Edge> + use<'_, M> {
        let (role, t_ns) = (executor.node().role, executor.mark_ns());
        let edges = self.graph.edges().iter();
        edges.filter(move |e| {
            e.to == role && e.deadline_ns > 0 && !e.permits(t_ns, self.marks.of(e))
        })
    }
}

/// Lets samples of asap edges take effect when they are published, by this clock.
pub fn take_effect_when_published(executor: &mut Executor, graph: &Graph, wall: WallMap) {
    let Ok(()) = executor.component.visit_outputs(&mut Asap { graph, wall });
}

struct Asap<'a> {
    graph: &'a Graph,
    wall: WallMap,
}

impl OutputVisitor for Asap<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        if self.graph.is_asap(&topic.info) {
            output.take_effect_when_published(self.wall);
        }
        Ok(())
    }
}
