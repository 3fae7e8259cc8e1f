//! The wall clock: each release at its instant, or once its inputs are there or overdue.

use super::{Ending, Process, WAIT_LIMIT};
use crate::clock::{WallMap, mono_now_ns, sleep_until};
use crate::executor::StepStamps;
use crate::graph::{Edge, Graph, Roles};
use crate::output::{Output, OutputVisitor};
use crate::ownership::MarkView as _;
use crate::seat_marks::SeatMarks;
use crate::upkeep::count_stretch;
use core::convert::Infallible;
use core::time::Duration;
use shared_types::{Role, Sample, Topic};

/// Longest rest without a look around \[ns\].
const LOOK_EVERY_NS: u64 = 20_000_000;

impl Process<'_> {
    pub(super) fn run_realtime(&mut self, wall: WallMap) -> Ending {
        let hurry = &mut Hurry { graph: &self.graph, wall };
        let Ok(()) = self.executor.component.visit_outputs(hurry);
        // Connections take a millisecond: they are made in the countdown, not in the first step.
        self.read_marks(Roles::ALL, &mut Roles::default());
        self.executor.component.receive();
        loop {
            let mut ending = None;
            let allocations = count_stretch(&mut || ending = self.pass(&wall));
            self.upkeep.note_allocations(allocations);
            self.upkeep.look(self.executor.mark_ns());
            self.executor.note_costs(self.upkeep.steady, self.upkeep.at_changes);
            if let Some(ending) = ending {
                return ending;
            }
        }
    }

    /// Looks around, rests or waits, and runs the next release if it is time; how the loop ends, once
    /// it does.
    fn pass(&mut self, wall: &WallMap) -> Option<Ending> {
        if let Some(ending) = self.stop_requested() {
            return Some(ending);
        }
        let end_ns = self.read_clock().end_ns;
        self.look_around();
        let before_ns = self.executor.mark_ns();
        if before_ns >= self.leave_ns {
            self.announce(before_ns, u64::MAX);
            return Some(Ending::Retired);
        }
        if before_ns >= end_ns {
            return Some(Ending::Finished);
        }
        let due_mono_ns = self.due_mono_ns(wall);
        let start_mono_ns = self.begin_step(wall, due_mono_ns)?;
        self.executor.apply_miss_policy(wall.logical_ns(start_mono_ns));
        if self.executor.mark_ns() == before_ns {
            self.count_missing_inputs();
            self.executor.run_step(StepStamps {
                release_mono_ns: due_mono_ns,
                start_mono_ns,
                now_mono_ns: mono_now_ns,
            });
        }
        // A release that was skipped is final too; the one it was skipped for has its own wait.
        self.announce(before_ns, self.executor.mark_ns());
        None
    }

    /// Waits for what begins the next step, and takes its inputs in; when it began \[ns\], or nothing if
    /// it is time to look around first.
    ///
    /// A loop of its own clock begins as soon as it runs, and takes its inputs in as part of the step.
    /// One that is begun by its inputs has them by then.
    fn begin_step(&mut self, wall: &WallMap, due_mono_ns: u64) -> Option<u64> {
        if self.is_timed() {
            if !self.rest_until(due_mono_ns) {
                return None;
            }
            let start_mono_ns = mono_now_ns();
            self.executor.component.receive();
            return Some(start_mono_ns);
        }
        if !self.inputs_decided(wall) {
            return None;
        }
        let now_mono_ns = mono_now_ns();
        if now_mono_ns < due_mono_ns {
            // Final before it is due: a release between two releases of the producer.
            sleep_until(due_mono_ns.min(now_mono_ns + LOOK_EVERY_NS));
            return None;
        }
        Some(now_mono_ns)
    }

    /// Rests until a release; false if that is so far ahead that it is time to look around, for a stop
    /// request or an earlier end. The plant meanwhile takes in commands as they arrive, which changes
    /// their stamps and not their effect.
    fn rest_until(&mut self, due_mono_ns: u64) -> bool {
        let limit_mono_ns = mono_now_ns() + LOOK_EVERY_NS;
        let until_mono_ns = due_mono_ns.min(limit_mono_ns);
        if self.seat.role != Role::Plant {
            sleep_until(until_mono_ns);
            return due_mono_ns <= limit_mono_ns;
        }
        loop {
            let left_ns = until_mono_ns.saturating_sub(mono_now_ns());
            if left_ns == 0 {
                return due_mono_ns <= limit_mono_ns;
            }
            if self.listener.wait(Duration::from_nanos(left_ns)) {
                self.executor.component.receive();
            }
        }
    }

    /// Host instant from which the next release may run, before the start for one that works ahead
    /// \[ns\].
    fn due_mono_ns(&self, wall: &WallMap) -> u64 {
        wall.mono_ns_ahead(self.executor.mark_ns(), self.executor.node().lead_ns)
    }

    /// True if the loop's own clock starts its steps; otherwise its inputs do.
    fn is_timed(&self) -> bool {
        let role = self.executor.node().role;
        role == Role::Plant || !self.graph.edges().iter().any(|e| e.to == role && e.deadline_ns > 0)
    }

    /// True once each input that the next release waits for is final or past its deadline; false
    /// after a wait: look around and try again.
    fn inputs_decided(&mut self, wall: &WallMap) -> bool {
        self.read_marks(Roles::ALL, &mut Roles::default());
        self.executor.component.receive();
        let t_ns = self.executor.mark_ns();
        let lead_ns = self.executor.node().lead_ns;
        let role = self.executor.node().role;
        let missing = missing(&self.graph, &self.marks, role, t_ns);
        let deadline_ns = missing.map(|e| e.deadline_ns).max();
        let Some(deadline_ns) = deadline_ns else { return true };
        // A deadline is an instant of logical time: a slower clock stretches it with the flight.
        let until_mono_ns = wall.mono_ns(t_ns.saturating_add(deadline_ns).saturating_sub(lead_ns));
        let now_ns = mono_now_ns();
        if now_ns < until_mono_ns {
            self.wait(Duration::from_nanos(until_mono_ns - now_ns).min(WAIT_LIMIT));
        }
        now_ns >= until_mono_ns
    }

    fn count_missing_inputs(&mut self) {
        let (role, t_ns) = (self.executor.node().role, self.executor.mark_ns());
        let mut missing = missing(&self.graph, &self.marks, role, t_ns).peekable();
        if missing.peek().is_some() {
            self.executor.count_input_deadline_miss(missing);
        }
    }
}

/// Tells the outputs of asap edges of the clock.
struct Hurry<'a> {
    graph: &'a Graph,
    wall: WallMap,
}

impl OutputVisitor for Hurry<'_> {
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

/// Edges that `role` waits for at `t_ns` and that are not final yet.
fn missing<'a>(
    graph: &'a Graph,
    marks: &'a SeatMarks,
    role: Role,
    t_ns: u64,
) -> impl Iterator<Item = &'a Edge> {
    graph
        .edges()
        .iter()
        .filter(move |e| e.to == role && e.deadline_ns > 0 && !e.permits(t_ns, marks.of(e)))
}
