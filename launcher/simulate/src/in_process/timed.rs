//! A flight whose loops and samples take the time that a script says: each loop decides as it does by the wall clock,
//! and this clock goes on to the next instant at which one of them has something to do.

use super::delays::{DelayedMarks, Delays};
use super::loops::Loop;
use super::marks::FlightMarks;
use super::observer::ErasedObserver;
use runtime::Graph;
use runtime::clock::WallMap;
use runtime::executor::Computed;
use runtime::pacing::{Next, Pacing, is_timed, take_effect_when_published};
use shared_types::ClockRecord;
use std::rc::Rc;
use timing::{Agenda, Script, Turn, TurnKind};

/// Logical time 0 on this clock: sources work ahead of the start \[ns\].
const START_MONO_NS: u64 = 10_000_000_000;

/// The clock, and whose turn is when.
pub(super) struct TimedClock {
    script: Rc<Script>,
    pub(super) delays: Rc<Delays>,
    agenda: Agenda,
    /// Steps that have been computed and not published, by loop.
    computed: Vec<Option<Computed>>,
    wall: WallMap,
    /// What of the script has not begun, the earliest last: from when \[ns\], and what.
    to_come: Vec<(u64, String)>,
    observer: Rc<dyn ErasedObserver>,
}

/// What else there is of the flight.
pub(super) struct Flying<'a> {
    pub(super) graph: &'a Graph,
    pub(super) loops: &'a mut [Loop],
    pub(super) marks: &'a mut FlightMarks,
    pub(super) end_ns: u64,
    /// The loop whose turn it is.
    pub(super) stepping: &'a mut usize,
}

impl TimedClock {
    /// Before the first turn.
    pub(super) fn new(script: Script, observer: Rc<dyn ErasedObserver>) -> Self {
        let mut to_come = script.told();
        to_come.reverse();
        let script = Rc::new(script.on_clock(START_MONO_NS));
        let start =
            ClockRecord { start_mono_ns: START_MONO_NS, speed: 1.0, ..ClockRecord::default() };
        Self {
            delays: Rc::new(Delays::new(Rc::clone(&script))),
            script,
            agenda: Agenda::default(),
            computed: Vec::new(),
            wall: WallMap::new(&start),
            to_come,
            observer,
        }
    }

    /// Gives each loop its first turn.
    pub(super) fn begin(&mut self, graph: &Graph, loops: &mut [Loop]) {
        for executor in loops.iter_mut().filter_map(|l| l.stepper.executor()) {
            take_effect_when_published(executor, graph, self.wall);
        }
        self.agenda = Agenda::new(loops.len(), 0);
        self.computed = vec![None; loops.len()];
    }

    /// Gives each loop its turns before `t_ns`; all that are left if that is the end of the flight or later.
    pub(super) fn fly_until(&mut self, t_ns: u64, flying: &mut Flying<'_>) {
        let until_mono_ns = if t_ns < flying.end_ns { self.wall.mono_ns(t_ns) } else { u64::MAX };
        while let Some(turn) = self.agenda.next().filter(|turn| turn.at_ns < until_mono_ns) {
            *flying.stepping = turn.index;
            self.delays.move_to(turn.at_ns);
            self.tell_until(turn.at_ns);
            match (turn.kind, self.computed[turn.index].take()) {
                (TurnKind::Publish, Some(computed)) => self.publish(turn, computed, flying),
                _ => self.look(turn, flying),
            }
        }
    }

    /// Tells in the recording what of the script begins by an instant of this clock \[ns\].
    fn tell_until(&mut self, at_mono_ns: u64) {
        let now_ns = self.wall.logical_ns(at_mono_ns);
        while let Some((from_ns, text)) = self.to_come.pop_if(|(from_ns, _)| *from_ns <= now_ns) {
            self.observer.note(from_ns, false, &text);
        }
    }

    /// Lets a loop do what it would do by the wall clock at this instant.
    fn look(&mut self, Turn { at_ns, index, .. }: Turn, flying: &mut Flying<'_>) {
        let Flying { graph, end_ns, .. } = *flying;
        let Some(executor) = flying.loops[index].stepper.executor() else {
            return self.agenda.end(index);
        };
        let (role, release_ns) = (executor.node().role, executor.mark_ns());
        if release_ns >= end_ns {
            return self.agenda.end(index);
        }
        let is_timed = is_timed(graph, role);
        if !is_timed {
            executor.component.receive();
        }
        let marks = DelayedMarks { marks: &*flying.marks, delays: &self.delays, reader: role };
        let pacing = Pacing { graph, marks: &marks, wall: self.wall };
        let begins_ns = |at_ns: u64| self.script.begins_ns(role, at_ns, release_ns);
        match pacing.next(executor, at_ns) {
            Next::Rest(until_ns) => self.agenda.plan(index, TurnKind::Look, begins_ns(until_ns)),
            Next::Listen(until_ns) => {
                let arrival_ns = self.delays.next_arrival_mono_ns(role).unwrap_or(u64::MAX);
                self.agenda.plan(index, TurnKind::Expire, begins_ns(until_ns.min(arrival_ns)));
            }
            Next::Begin(due_mono_ns) => {
                if is_timed {
                    executor.component.receive();
                }
                if !pacing.begin(executor, at_ns) {
                    // A release that was skipped is final too.
                    self.agenda.plan(index, TurnKind::Look, at_ns);
                    return self.announce(at_ns, index, release_ns, flying);
                }
                let computed = executor.compute(due_mono_ns, at_ns);
                let end_mono_ns = self.script.ends_ns(role, at_ns, release_ns);
                if end_mono_ns > at_ns {
                    self.computed[index] = Some(computed);
                    self.agenda.plan(index, TurnKind::Publish, end_mono_ns);
                } else {
                    self.publish(Turn { at_ns, kind: TurnKind::Publish, index }, computed, flying);
                }
            }
        }
    }

    fn publish(
        &mut self,
        Turn { at_ns, index, .. }: Turn,
        computed: Computed,
        flying: &mut Flying<'_>,
    ) {
        let Some(executor) = flying.loops[index].stepper.executor() else { return };
        executor.publish(computed, at_ns);
        self.agenda.plan(index, TurnKind::Look, at_ns);
        self.announce(at_ns, index, computed.release_ns(), flying);
    }

    /// Lets the others know how far a loop has got, and wakes those whose next release this may unblock.
    fn announce(&mut self, at_ns: u64, index: usize, before_ns: u64, flying: &mut Flying<'_>) {
        let Flying { graph, .. } = *flying;
        let (place, generation, mark_ns) = {
            let l = &flying.loops[index];
            (l.place, l.generation, l.stepper.next_ns())
        };
        flying.marks.advance(place, generation, mark_ns);
        for role in graph.wakes(place.role, before_ns, mark_ns) {
            if self.script.misses_wake(role, at_ns) {
                continue;
            }
            for (woken, l) in flying.loops.iter().enumerate().filter(|(_, l)| l.node.role == role) {
                let begins_ns = self.script.begins_ns(role, at_ns, l.stepper.next_ns());
                self.agenda.wake(woken, begins_ns);
            }
        }
    }
}
