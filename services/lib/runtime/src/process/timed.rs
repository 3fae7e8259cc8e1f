//! A clock that the launcher moves: each step when it is this loop's turn.

use super::{Ending, Process, WAIT_LIMIT};
use crate::collector::Collector;
use crate::delays::Delays;
use crate::graph::Roles;
use crate::ipc::{NumberedOrder, Order, TurnTaker};
use crate::pacing::take_effect_when_published;
use crate::timed::{self, Around, START_MONO_NS, TimedLoop};
use std::rc::Rc;
use timing::Script;

/// What happens to the time of a process's loop and of the samples that it reads.
#[derive(Debug)]
pub struct Timing {
    script: Rc<Script>,
    name: String,
    /// When samples arrive.
    pub(crate) delays: Rc<Delays>,
    /// What has come to the ports.
    pub(crate) collector: Rc<Collector>,
}

impl Timing {
    /// Of a flight's script, for the process of the service `name`.
    #[must_use]
    pub fn new(script: Script, name: &str) -> Self {
        let script = Rc::new(script.on_clock(START_MONO_NS));
        let delays = Rc::new(Delays::new(Rc::clone(&script)));
        Self { script, name: name.to_owned(), delays, collector: Rc::default() }
    }
}

impl Process<'_> {
    pub(super) fn run_timed(&mut self, timing: &Timing, turns: &TurnTaker) -> Ending {
        take_effect_when_published(&mut self.executor, &self.graph, timed::wall());
        let mut own = TimedLoop::new(Rc::clone(&timing.script), Rc::clone(&timing.delays));
        loop {
            if let Some(ending) = self.stop_requested() {
                return ending;
            }
            let Some(order) = turns.await_order(WAIT_LIMIT) else {
                self.look_around();
                self.serve_again();
                if self.has_to_leave() {
                    return Ending::Retired;
                }
                continue;
            };
            self.look_around();
            match order.order {
                Order::Collect => {
                    timing.collector.collect();
                    turns.answer(&order, None);
                }
                Order::LookAround if self.has_to_leave() => return Ending::Retired,
                Order::LookAround => self.serve_again(),
                Order::Turn(kind, at_ns) => {
                    let turn = (kind, at_ns);
                    if let Some(ending) = self.take_turn(&mut own, (timing, turns), &order, turn) {
                        return ending;
                    }
                }
            }
        }
    }

    fn take_turn(
        &mut self,
        own: &mut TimedLoop,
        (timing, turns): (&Timing, &TurnTaker),
        order: &NumberedOrder,
        (kind, at_ns): (timing::TurnKind, u64),
    ) -> Option<Ending> {
        timing.collector.collect();
        self.read_marks(Roles::ALL, &mut Roles::default());
        let end_ns = self.read_clock().end_ns;
        let around = Around {
            graph: &self.graph,
            marks: &self.marks,
            seat: self.seat,
            name: &timing.name,
            end_ns: end_ns.min(self.leave_ns),
        };
        let answer = own.take_turn((at_ns, kind), &mut self.executor, &around, |_| ());
        if answer.announced_from_ns.is_some() {
            // The launcher says who is woken, when that one's turn is.
            self.serve_and_send(answer.mark_ns);
        }
        turns.answer(order, Some(answer));
        if answer.next.is_some() {
            return None;
        }
        Some(if self.has_to_leave() { Ending::Retired } else { Ending::Finished })
    }

    fn has_to_leave(&self) -> bool {
        self.executor.mark_ns() >= self.leave_ns
    }
}
