//! A clock that the launcher moves: each step when it is this loop's turn.

use super::timing::{Ports, Timing};
use super::{Ending, Process, WAIT_LIMIT};
use crate::graph::Roles;
use crate::ipc::{Order, TurnTaker};
use crate::pacing::take_effect_when_published;
use crate::timed::{self, Around, TimedLoop};
use std::rc::Rc;
use timing::{Answer, TurnKind};

impl Process<'_> {
    pub(super) fn run_timed(
        &mut self,
        timing: &Timing,
        ports: &Ports,
        turns: &TurnTaker,
    ) -> Ending {
        take_effect_when_published(&mut self.executor, &self.graph, timed::wall());
        let mut own = TimedLoop::new(Rc::clone(&timing.script), Rc::clone(&ports.delays));
        loop {
            if let Some(ending) = self.stop_requested() {
                return ending;
            }
            let order = turns.await_order(WAIT_LIMIT);
            self.look_around();
            // One that has flown to the end may be ordered to leave its seat before all may leave.
            let clock = self.read_clock();
            if clock.may_leave.is_set() && self.executor.mark_ns() >= clock.end_ns {
                return Ending::Finished;
            }
            let Some(order) = order else {
                self.serve_again();
                continue;
            };
            let answer = match order.order {
                Order::Leave if self.executor.mark_ns() >= self.leave_ns => {
                    return Ending::Retired;
                }
                Order::LookAround | Order::Leave => {
                    self.serve_again();
                    continue;
                }
                Order::Collect => {
                    ports.collector.collect();
                    None
                }
                Order::CatchUp(until_ns) => Some(self.catch_up(ports, until_ns)),
                Order::Turn(kind, at_ns) => {
                    Some(self.take_turn(&mut own, (timing, ports), (at_ns, kind), clock.end_ns))
                }
            };
            turns.answer(&order, answer);
            if self.executor.mark_ns() >= clock.end_ns {
                self.finish(true);
            }
        }
    }

    fn take_turn(
        &mut self,
        own: &mut TimedLoop,
        (timing, ports): (&Timing, &Ports),
        turn: (u64, TurnKind),
        end_ns: u64,
    ) -> Answer {
        ports.collector.collect();
        self.read_marks(Roles::ALL, &mut Roles::default());
        let around = Around {
            graph: &self.graph,
            marks: &self.marks,
            seat: self.seat,
            name: &timing.name,
            end_ns: end_ns.min(self.leave_ns),
        };
        let answer = own.take_turn(turn, &mut self.executor, &around, |_| ());
        if answer.announced_from_ns.is_some() {
            // The launcher wakes each process when its turn comes.
            self.serve_and_send(answer.mark_ns);
        }
        answer
    }

    /// Runs what the process before it had run after its last state, which takes no time and is judged by no policy.
    fn catch_up(&mut self, ports: &Ports, until_ns: u64) -> Answer {
        let wall = timed::wall();
        ports.collector.collect();
        self.read_marks(Roles::ALL, &mut Roles::default());
        while self.executor.mark_ns() < until_ns {
            let at_ns = wall.mono_ns(self.executor.mark_ns());
            ports.delays.move_to(at_ns);
            self.executor.component.receive();
            let computed = self.executor.compute(at_ns, at_ns);
            self.executor.publish(computed, at_ns);
        }
        let mark_ns = self.executor.mark_ns();
        self.serve_and_send(mark_ns);
        Answer { next: None, announced_from_ns: None, mark_ns }
    }
}
