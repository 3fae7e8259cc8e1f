//! The loops of a flight in one process, step by step.

use super::checkpoint::Checkpoint;
use super::director::Director;
use super::loops::{Connect, Loop};
use super::marks::FlightMarks;
use super::observer::SampleTaps;
use super::posts::InProcessHost;
use super::stepper::{InstanceMark, StepContext};
use super::timed::{Flying, TimedClock};
use super::wires::Wires;
use super::{Conclusion, InProcessError, Outside, PerfectState, StateSource};
use core::cell::RefCell;
use runtime::Graph;
use runtime::graph::{CREDIT_NS, ROLES};
use scenario::Scenario;
use scenario::services::Assignment;
use shared_types::{Role, Seat, Slot};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use swap::SlotWatch;

/// A clock for the stamps of samples that will not be read.
fn no_clock() -> u64 {
    0
}

/// A flight in progress, whatever observes it: [`InProcess`](super::InProcess) adds the observer.
pub struct Kernel {
    pub(super) graph: Graph,
    pub(super) loops: Vec<Loop>,
    pub(super) marks: FlightMarks,
    /// Changes the owners of slots, if they change.
    director: Option<Box<Director>>,
    end_ns: u64,
    /// The time that loops and samples take, if a script sets it.
    timed: Option<Box<TimedClock>>,
    now_mono_ns: fn() -> u64,
    /// The loop that is being stepped.
    stepping: usize,
    /// How far every loop has got, published to processes; kept for its room.
    instances: Vec<InstanceMark>,
}

impl core::fmt::Debug for Kernel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Kernel").field("marks", &self.marks).finish_non_exhaustive()
    }
}

impl Kernel {
    /// Before its first step, or at a checkpoint.
    pub(super) fn build(
        scenario: &Scenario,
        state: StateSource,
        taps: SampleTaps,
        (from, outside): (Option<&Checkpoint>, &Outside),
    ) -> Result<Self, InProcessError> {
        let graph = scenario.graph()?;
        let assignment = Assignment::of(scenario.settings());
        let timing = scenario.timing();
        // By a script of times too: an owner that takes its time may be given up by its consumers.
        let scripted = scenario.settings().is_more_than_states() && from.is_none();
        let watch =
            scripted.then(|| Rc::new(RefCell::new(SlotWatch::new(&scenario.modelled_vehicle()))));
        if timing.is_some() && from.is_some() {
            return Err(InProcessError::TimingResumed);
        }
        let timed = timing.map(|script| Box::new(TimedClock::new(script, taps.others())));
        let delays = timed.as_ref().map(|timed| Rc::clone(&timed.delays));
        let mut wires = Wires::new(taps, watch.clone(), delays);
        let mut loops = Vec::new();
        for &node in graph.nodes() {
            let place = Seat::first(node.role);
            let generation = from.map_or(0, |checkpoint| checkpoint.generation(node.role));
            let wires = &mut wires;
            let component = match (state, node.role) {
                (StateSource::Truth, Role::Estimator) => PerfectState::component(),
                (_, role) => components::build(&assignment, role, scenario).map_err(|error| {
                    InProcessError::Component { role: role.label(), error: error.to_string() }
                })?,
            };
            let name = assignment.name(node.role);
            let connect = Connect { graph: &graph, node, place, generation, name, wires, from };
            loops.push(connect.connect(component)?);
        }
        for slot in Slot::ALL {
            // Otherwise the slot's own machine decides which process begins.
            let by_director = scripted && graph.node(slot.role()).is_some();
            if from.is_none() && !by_director {
                wires.own(&graph, slot);
            }
        }
        let (mut marks, mut director) = (FlightMarks::Plain([0; ROLES]), None);
        if let Some(watch) = watch {
            marks = FlightMarks::Seats(Box::default());
            let host = InProcessHost::new(scenario, wires, watch, outside);
            director = Some(Box::new(Director::new(host, &graph, &loops)?));
        }
        Ok(Self {
            timed,
            graph,
            loops,
            marks,
            director,
            end_ns: scenario.duration_ns(),
            now_mono_ns: no_clock,
            stepping: 0,
            instances: Vec::new(),
        })
    }

    /// Stamps samples by this clock from now on \[ns\]; without it all host stamps are 0.
    pub fn stamp_by(&mut self, now_mono_ns: fn() -> u64) {
        self.now_mono_ns = now_mono_ns;
    }

    /// Runs every release before `t_ns` and the end of the flight: each loop in turn as far as the
    /// others permit, as processes do.
    ///
    /// # Errors
    /// No step may run although the flight is not over, or a step panicked.
    pub fn fly_until(&mut self, t_ns: u64) -> Result<(), InProcessError> {
        // What a panic leaves behind is looked at, and never stepped again.
        let flown = catch_unwind(AssertUnwindSafe(|| {
            loop {
                self.fly_allowed(t_ns);
                if !self.direct(t_ns)? {
                    return Ok(());
                }
            }
        }));
        if let Ok(Err(error)) = flown {
            return Err(error);
        }
        if let Err(panic) = flown {
            let l = &self.loops[self.stepping];
            let t_s = l.stepper.next_ns() as f64 / 1e9;
            let message = panic_message(panic.as_ref());
            return Err(InProcessError::Panicked { role: l.node.role.label(), t_s, message });
        }
        if self.timed.is_some() {
            // A loop that is late is behind for a reason.
            return Ok(());
        }
        let flying = self.loops.iter().filter(|l| l.flies());
        let slowest = flying.min_by_key(|l| l.stepper.next_ns());
        let behind = slowest.filter(|l| l.stepper.next_ns() < t_ns.min(self.end_ns));
        behind.map_or(Ok(()), |l| {
            let t_s = l.stepper.next_ns() as f64 / 1e9;
            Err(InProcessError::Stuck { t_s, role: l.node.role.label() })
        })
    }

    /// Runs all that may run before `t_ns` without a change of hands.
    fn fly_allowed(&mut self, t_ns: u64) {
        let until_ns =
            self.director.as_ref().map_or(t_ns, |director| director.allowed_ns.min(t_ns));
        let Self { graph, loops, marks, end_ns, stepping, timed, director, .. } = self;
        let (end_ns, keeps_states) = (*end_ns, director.is_some());
        if let Some(timed) = timed {
            let flying = &mut Flying { graph, loops, marks, end_ns, stepping, keeps_states };
            timed.fly_until(until_ns, flying);
        } else {
            while self.fly_interval(t_ns) {}
        }
    }

    /// Runs each loop as far as it may go now; false if none may.
    fn fly_interval(&mut self, t_ns: u64) -> bool {
        let allowed_ns = self.allowed_ns(t_ns);
        let mut moved = false;
        for index in 0..self.loops.len() {
            let Loop { node, leave_ns, waits, .. } = &self.loops[index];
            if *waits {
                continue;
            }
            let allowed_ns = allowed_ns.min(*leave_ns);
            let open_until_ns = self.graph.open_until_ns(node, &self.marks, allowed_ns);
            while self.mark_ns(index) < open_until_ns && self.step_within(index, allowed_ns) {
                moved = true;
            }
        }
        moved
    }

    /// Lets those leave that have to, and does what is due in the slots once all that is allowed has been
    /// flown; false if nothing comes of it. What is due at `t_ns` itself is left to the caller that flies on.
    fn direct(&mut self, t_ns: u64) -> Result<bool, InProcessError> {
        let Some(director) = &mut self.director else { return Ok(false) };
        if director.reap(&self.graph, &mut self.loops, &mut self.marks, self.end_ns)? {
            return Ok(true);
        }
        if director.retire(&mut self.loops, &mut self.marks) {
            return Ok(true);
        }
        if t_ns < self.end_ns && director.allowed_ns >= t_ns {
            return Ok(false);
        }
        let more = director.go_on(&self.graph, &mut self.loops, &mut self.marks, self.end_ns)?;
        // Time waits for a loop that has just been ordered to leave.
        if more || director.retire(&mut self.loops, &mut self.marks) {
            return Ok(true);
        }
        // One that takes time gets there only if time goes on.
        let turn_ns = self.timed.as_ref().and_then(|timed| timed.next_turn_ns());
        let Some(turn_ns) = turn_ns.filter(|_| director.allowed_ns < self.end_ns) else {
            return Ok(false);
        };
        director.allowed_ns = turn_ns.max(director.allowed_ns).saturating_add(1).min(self.end_ns);
        Ok(true)
    }

    fn allowed_ns(&self, t_ns: u64) -> u64 {
        if let Some(director) = &self.director {
            return director.allowed_ns.min(self.end_ns).min(t_ns);
        }
        let slowest_ns = self.loops.iter().map(|l| l.stepper.next_ns()).min().unwrap_or(0);
        slowest_ns.saturating_add(CREDIT_NS).min(self.end_ns).min(t_ns)
    }

    /// Publishes the totals of every loop: the last samples of a flight.
    pub fn finish(&mut self) {
        for one in self.loops.iter_mut().filter(|l| l.flies()) {
            one.stepper.finish();
        }
    }

    /// What came of the slots, at the end.
    pub fn conclude(&mut self) -> Conclusion {
        let Some(director) = &mut self.director else { return Conclusion::default() };
        let (swaps, notices) = (director.reports(), core::mem::take(&mut director.notices));
        let orders = core::mem::take(&mut director.orders.reports);
        let (recovered, exits) = (director.recovered, core::mem::take(director.exits()));
        Conclusion { swaps, orders, notices, recovered, exits }
    }

    /// Loops whose next step may run and lies before `t_ns` and the end of the flight. In whatever
    /// order they are stepped, the flight is the same.
    pub fn runnable(&self, t_ns: u64) -> impl Iterator<Item = usize> + '_ {
        let allowed_ns = self.allowed_ns(t_ns);
        (0..self.loops.len()).filter(move |&index| {
            let Loop { node, waits, leave_ns, .. } = &self.loops[index];
            let allowed_ns = allowed_ns.min(*leave_ns);
            !waits && self.graph.runnable(node, self.mark_ns(index), &self.marks, allowed_ns)
        })
    }

    /// Runs the next release of a loop that [`runnable`](Self::runnable) named.
    pub fn step(&mut self, index: usize) {
        let next_ns = self.mark_ns(index);
        self.step_within(index, next_ns.saturating_add(1));
    }

    /// Runs the next release of a loop, and whatever else a process may run before `allowed_ns`; false if
    /// the process has failed.
    fn step_within(&mut self, index: usize, allowed_ns: u64) -> bool {
        self.stepping = index;
        self.instances.clear();
        if self.loops[index].stepper.is_outside() {
            let flying = self.loops.iter().filter(|l| l.flies());
            self.instances.extend(flying.map(Loop::mark));
        }
        let (now_mono_ns, instances) = (self.now_mono_ns, self.instances.as_slice());
        let one = &mut self.loops[index];
        let done = one.stepper.step(&StepContext { now_mono_ns, allowed_ns, instances });
        one.waits |= !done;
        one.course.prepare(&mut *one.stepper);
        self.marks.advance(one.place, one.generation, one.stepper.next_ns());
        done
    }

    /// Next release of a loop \[ns\].
    #[must_use]
    pub fn mark_ns(&self, index: usize) -> u64 {
        self.loops[index].stepper.next_ns()
    }

    /// Next release of each loop \[ns\].
    #[must_use]
    pub fn marks_ns(&self) -> Vec<(Role, u64)> {
        self.loops.iter().map(|l| (l.node.role, l.stepper.next_ns())).collect()
    }

    /// Role of a loop.
    #[must_use]
    pub fn role(&self, index: usize) -> Role {
        self.loops[index].node.role
    }

    /// Instant through which every loop is complete \[ns\].
    #[must_use]
    pub fn flown_ns(&self) -> u64 {
        let flying = self.loops.iter().filter(|l| l.flies());
        flying.map(|l| l.stepper.next_ns()).min().unwrap_or(0).min(self.end_ns)
    }
}

/// The message of a panic.
fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}
