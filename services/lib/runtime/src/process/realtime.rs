//! The wall clock: each release at its instant, or once its inputs are there or overdue.

use super::{Ending, Process, Timing};
use crate::clock::{WallMap, mono_now_ns, sleep_until};
use crate::graph::Roles;
use crate::pacing::{Next, Pacing, is_timed, take_effect_when_published};
use crate::upkeep::count_stretch;
use core::time::Duration;
use shared_types::Role;

/// Longest rest without a look around \[ns\].
const LOOK_EVERY_NS: u64 = 20_000_000;

impl Process<'_> {
    pub(super) fn run_realtime(&mut self, wall: WallMap, timing: Option<&Timing>) -> Ending {
        take_effect_when_published(&mut self.executor, &self.graph, wall);
        // Connections take a millisecond: they are made in the countdown, not in the first step.
        self.read_marks(Roles::ALL, &mut Roles::default());
        self.executor.component.receive();
        loop {
            let mut ending = None;
            let allocations = count_stretch(&mut || ending = self.pass(wall, timing));
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
    fn pass(&mut self, wall: WallMap, timing: Option<&Timing>) -> Option<Ending> {
        if let Some(ending) = self.stop_requested() {
            if ending == Ending::LauncherGone {
                // No launcher reports that this one has left, and others may stay for longer.
                self.announce(self.executor.mark_ns(), u64::MAX);
            }
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
        let is_timed = is_timed(&self.graph, self.seat.role);
        let (due_mono_ns, start_mono_ns) = self.await_step(wall, is_timed, timing)?;
        let pacing = Pacing { graph: &self.graph, marks: &self.marks, wall, is_timed };
        if pacing.begin(&mut self.executor, start_mono_ns) {
            let release_ns = self.executor.mark_ns();
            let computed = self.executor.compute(due_mono_ns, start_mono_ns);
            if let Some(timing) = timing {
                let at = (start_mono_ns, release_ns);
                self.await_instant(timing.ends_mono_ns(self.seat.role, wall, at));
            }
            self.executor.publish(computed, mono_now_ns());
        }
        // A release that was skipped is final too; the one it was skipped for has its own wait.
        self.announce(before_ns, self.executor.mark_ns());
        None
    }

    /// Waits for what begins the next step, and takes its inputs in; when it was due and when it began \[ns\], or nothing if
    /// it is time to look around first.
    ///
    /// A loop of its own clock begins as soon as it runs, and takes its inputs in as part of the step.
    /// One that is begun by its inputs has them by then.
    fn await_step(
        &mut self,
        wall: WallMap,
        is_timed: bool,
        timing: Option<&Timing>,
    ) -> Option<(u64, u64)> {
        loop {
            if !is_timed {
                self.read_marks(Roles::ALL, &mut Roles::default());
                self.executor.component.receive();
            }
            let now_mono_ns = mono_now_ns();
            let pacing = Pacing { graph: &self.graph, marks: &self.marks, wall, is_timed };
            match pacing.next(&self.executor, now_mono_ns) {
                Next::Rest(due_mono_ns) => {
                    let is_due = self.rest_until(due_mono_ns);
                    // One that is begun by its inputs looks around first: it has them already.
                    if !is_due || !is_timed {
                        return None;
                    }
                }
                Next::Listen(until_mono_ns) => {
                    self.wait(Duration::from_nanos(until_mono_ns - now_mono_ns));
                    return None;
                }
                Next::Begin(due_mono_ns) => {
                    let mut start_mono_ns = now_mono_ns;
                    if let Some(timing) = timing {
                        let at = (now_mono_ns, self.executor.mark_ns());
                        self.await_instant(timing.begins_mono_ns(self.seat.role, wall, at));
                        start_mono_ns = mono_now_ns();
                        if !is_timed {
                            self.read_marks(Roles::ALL, &mut Roles::default());
                            self.executor.component.receive();
                        }
                    }
                    if is_timed {
                        self.executor.component.receive();
                    }
                    return Some((due_mono_ns, start_mono_ns));
                }
            }
        }
    }

    /// Waits until an instant, or until it is asked to stop.
    fn await_instant(&self, mono_ns: u64) {
        while mono_now_ns() < mono_ns && self.stop_requested().is_none() {
            sleep_until(mono_ns.min(mono_now_ns() + LOOK_EVERY_NS));
        }
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
}
