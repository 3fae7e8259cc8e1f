//! A loop whose clock is moved by a conductor: what it does when it has its turn, decided by the same code as by the wall
//! clock.

use crate::clock::WallMap;
use crate::delays::{DelayedMarks, Delays};
use crate::executor::{Computed, Executor};
use crate::graph::Graph;
use crate::graph::MarkView;
use crate::pacing::{Next, Pacing, is_timed};
use shared_types::{ClockRecord, Seat};
use std::rc::Rc;
use timing::{Answer, LoopName, Script, TurnKind};

/// Logical time 0 on such a clock: sources work ahead of the start \[ns\].
pub const START_MONO_NS: u64 = 10_000_000_000;

/// From logical time to such a clock.
#[must_use]
pub fn wall() -> WallMap {
    let start = ClockRecord { start_mono_ns: START_MONO_NS, speed: 1.0, ..ClockRecord::default() };
    WallMap::new(&start)
}

/// What there is around a loop at its turn.
#[derive(Debug, Clone, Copy)]
pub struct Around<'a, M> {
    /// What it waits for.
    pub graph: &'a Graph,
    /// How far these have got.
    pub marks: &'a M,
    /// Its seat.
    pub seat: Seat,
    /// Name of its service.
    pub name: &'a str,
    /// It steps no more from here on: the end of the flight, or of its time on the seat \[ns\].
    pub end_ns: u64,
}

/// One loop on such a clock.
#[derive(Debug)]
pub struct TimedLoop {
    script: Rc<Script>,
    delays: Rc<Delays>,
    wall: WallMap,
    /// A step that has been computed and not published.
    computed: Option<Computed>,
}

impl TimedLoop {
    /// A loop that has not had a turn. The script is on this clock, and what is on the way to it is in `delays`.
    #[must_use]
    pub fn new(script: Rc<Script>, delays: Rc<Delays>) -> Self {
        Self { script, delays, wall: wall(), computed: None }
    }

    /// Takes a turn at an instant of the clock \[ns\]; `before_step` sees the loop before it computes.
    pub fn take_turn<M: MarkView>(
        &mut self,
        (at_ns, kind): (u64, TurnKind),
        executor: &mut Executor,
        around: &Around<'_, M>,
        before_step: impl FnOnce(&mut Executor),
    ) -> Answer {
        self.delays.move_to(at_ns);
        match (kind, self.computed.take()) {
            (TurnKind::Publish, Some(computed)) => publish(executor, computed, at_ns),
            _ => self.look((at_ns, kind), executor, around, before_step),
        }
    }

    /// Does what it would do by the wall clock at this instant.
    fn look<M: MarkView>(
        &mut self,
        (at_ns, kind): (u64, TurnKind),
        executor: &mut Executor,
        around: &Around<'_, M>,
        before_step: impl FnOnce(&mut Executor),
    ) -> Answer {
        let Around { graph, seat, name, end_ns, .. } = *around;
        let name = LoopName { role: seat.role, name };
        let release_ns = executor.mark_ns();
        let silent = |next| Answer { next, announced_from_ns: None, mark_ns: release_ns };
        if release_ns >= end_ns {
            return silent(None);
        }
        let is_timed = is_timed(graph, name.role);
        if !is_timed {
            executor.component.receive();
        }
        let marks = DelayedMarks { marks: around.marks, delays: &self.delays, reader: seat };
        let pacing = Pacing { graph, marks: &marks, wall: self.wall, is_timed };
        let begins_ns = |at_ns: u64| self.script.begins_ns(name, at_ns, release_ns);
        match pacing.next(executor, at_ns) {
            Next::Rest(until_ns) => silent(Some((TurnKind::Begin, begins_ns(until_ns)))),
            Next::Listen(until_ns) => {
                let arrival_ns = self.delays.next_arrival_mono_ns(seat);
                let arrival_ns = arrival_ns.filter(|at_ns| !self.script.misses_wake(name, *at_ns));
                let at_ns = begins_ns(until_ns.min(arrival_ns.unwrap_or(u64::MAX)));
                silent(Some((TurnKind::Expire, at_ns)))
            }
            Next::Begin(_) if kind == TurnKind::Look && begins_ns(at_ns) > at_ns => {
                silent(Some((TurnKind::Begin, begins_ns(at_ns))))
            }
            Next::Begin(due_mono_ns) => {
                before_step(executor);
                if is_timed {
                    executor.component.receive();
                }
                if !pacing.begin(executor, at_ns) {
                    // A release that was skipped is final too.
                    return announced(executor, release_ns, at_ns);
                }
                let end_mono_ns = self.script.ends_ns(name, at_ns, release_ns);
                let computed = executor.compute(due_mono_ns, at_ns);
                if end_mono_ns <= at_ns {
                    return publish(executor, computed, at_ns);
                }
                self.computed = Some(computed);
                silent(Some((TurnKind::Publish, end_mono_ns)))
            }
        }
    }
}

fn publish(executor: &mut Executor, computed: Computed, at_ns: u64) -> Answer {
    executor.publish(computed, at_ns);
    announced(executor, computed.release_ns(), at_ns)
}

/// It looks again at once, after the others have been informed how far it has got.
fn announced(executor: &Executor, from_ns: u64, at_ns: u64) -> Answer {
    let next = Some((TurnKind::Look, at_ns));
    Answer { next, announced_from_ns: Some(from_ns), mark_ns: executor.mark_ns() }
}
