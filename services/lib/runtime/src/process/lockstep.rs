//! Simulated time: whole intervals as soon as they are permitted.

use super::{Ending, Process, WAIT_LIMIT};
use crate::clock::mono_now_ns;
use crate::executor::StepStamps;
use crate::graph::Roles;

impl Process<'_> {
    pub(super) fn run_lockstep(&mut self) -> Ending {
        let mut clock = self.read_clock();
        let mut moved = Roles::ALL;
        let quiet_limit_ns = self.graph.quiet_limit_ns(self.seat.role);
        loop {
            if let Some(ending) = self.stop_requested() {
                return ending;
            }
            let before_ns = self.executor.mark_ns();
            // Time never ends before what was once allowed, so an older record is as good until then.
            if before_ns >= clock.allowed_ns.min(clock.end_ns) || self.timed_out {
                clock = self.read_clock();
                // Whatever was decided before time was allowed is known from here on.
                self.look_around();
            }
            if before_ns >= self.leave_ns {
                self.announce(before_ns, u64::MAX);
                return Ending::Retired;
            }
            let allowed_ns = clock.allowed_ns.min(clock.end_ns).min(self.leave_ns);
            let node = *self.executor.node();
            // What is known of a mark holds until it moves, so a wait looks at those alone that hold the step back.
            let held_by = self.graph.held_by(&node, before_ns, &self.marks);
            self.read_marks(held_by, &mut moved);
            let mut open_until_ns = before_ns;
            if self.graph.runnable(&node, before_ns, &self.marks, allowed_ns) {
                // Marks first, samples second: what a mark promises is then certainly here.
                self.read_marks(Roles::ALL, &mut moved);
                self.executor.component.parts().receive_if_moved(moved);
                moved = Roles::default();
                open_until_ns = self.graph.open_until_ns(&node, &self.marks, allowed_ns);
            }
            while self.executor.mark_ns() < open_until_ns {
                self.executor.run_step(StepStamps::at_once(mono_now_ns));
            }
            let after_ns = self.executor.mark_ns();
            if after_ns >= clock.end_ns {
                return Ending::Finished;
            }
            if after_ns > before_ns {
                if core::mem::take(&mut self.timed_out) {
                    self.executor.count_rescued_wait();
                }
                // What was decided before time was allowed has arrived, and nothing decided since takes effect earlier.
                let known_ns = allowed_ns.min(after_ns.saturating_add(quiet_limit_ns));
                if quiet_limit_ns > 0 {
                    self.quiet_until_ns = self.executor.quiet_until_ns(known_ns);
                }
                self.serve_and_send(after_ns);
                self.wake_lockstep(before_ns, after_ns);
            } else {
                self.wait(WAIT_LIMIT);
                if self.timed_out {
                    moved = Roles::ALL;
                }
            }
        }
    }
}
