//! A clock that the launcher moves: each step when it is this loop's turn.

use super::{Ending, Process, WAIT_LIMIT};
use crate::clock::WallMap;
use crate::collector::Collector;
use crate::delays::Delays;
use crate::graph::Roles;
use crate::ipc::{Order, TurnTaker};
use crate::pacing::take_effect_when_published;
use crate::timed::{self, Around, START_MONO_NS, TimedLoop};
use shared_types::Role;
use std::rc::Rc;
use timing::{Answer, Script, TurnKind, Who};

/// What happens to the time of a process's loop and of the samples that it reads.
#[derive(Debug)]
pub struct Timing {
    script: Rc<Script>,
    name: String,
    /// None by the wall clock.
    pub(crate) ports: Option<Ports>,
}

/// How samples come to a loop whose clock the launcher moves.
#[derive(Debug, Clone)]
pub(crate) struct Ports {
    /// When samples arrive.
    pub(crate) delays: Rc<Delays>,
    /// What has come to the ports.
    pub(crate) collector: Rc<Collector>,
}

impl Timing {
    /// Of a flight's script, for the process of the service `name`: on a clock that the launcher moves, or by the wall
    /// clock, by which the loop waits as long as its steps are to take.
    #[must_use]
    pub fn new(script: Script, name: &str, by_the_wall: bool) -> Self {
        let name = name.to_owned();
        if by_the_wall {
            return Self { script: Rc::new(script), name, ports: None };
        }
        let script = Rc::new(script.on_clock(START_MONO_NS));
        let delays = Rc::new(Delays::new(Rc::clone(&script)));
        Self { script, name, ports: Some(Ports { delays, collector: Rc::default() }) }
    }

    /// By the wall clock: when a step begins that may begin at an instant \[ns\], for a release.
    pub(super) fn begins_mono_ns(&self, role: Role, wall: WallMap, at: (u64, u64)) -> u64 {
        later(wall, at, |at_ns, release_ns| {
            self.script.begins_ns(self.who(role), at_ns, release_ns)
        })
    }

    /// By the wall clock: when a step is over that began at an instant \[ns\], for a release.
    pub(super) fn ends_mono_ns(&self, role: Role, wall: WallMap, at: (u64, u64)) -> u64 {
        later(wall, at, |at_ns, release_ns| self.script.ends_ns(self.who(role), at_ns, release_ns))
    }

    fn who(&self, role: Role) -> Who<'_> {
        Who { role, name: &self.name }
    }
}

/// An instant that the script puts off by logical time, put off as long by the wall clock.
fn later(wall: WallMap, at: (u64, u64), put_off: impl Fn(u64, u64) -> u64) -> u64 {
    let (at_mono_ns, release_ns) = at;
    let at_ns = wall.logical_ns(at_mono_ns);
    let by_ns = put_off(at_ns, release_ns).saturating_sub(at_ns);
    at_mono_ns.saturating_add(wall.mono_ns(by_ns).saturating_sub(wall.mono_ns(0)))
}

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
            // One that has flown to the end may be told to leave its seat before all may leave.
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
            // The launcher says who is woken, when that one's turn is.
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
