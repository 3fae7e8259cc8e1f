//! A flight whose loops and samples take the time that a script sets: each loop decides as it does by the wall clock,
//! and this clock goes on to the next instant at which one of them has something to do.

use super::loops::{Loop, Published};
use super::marks::FlightMarks;
use super::observer::ErasedObserver;
use runtime::Graph;
use runtime::clock::WallMap;
use runtime::delays::Delays;
use runtime::pacing::take_effect_when_published;
use runtime::timed::{self, Around, START_MONO_NS, TimedLoop};
use shared_types::Seat;
use std::rc::Rc;
use swap::FAULT;
use timing::{Agenda, Announcements, Answer, Script, Turn, TurnKind};

/// The clock, and which loop has its turn when.
pub(super) struct TimedClock {
    script: Rc<Script>,
    pub(super) delays: Rc<Delays>,
    /// By [`Seat::number`], as everything about a loop here.
    agenda: Agenda,
    loops: [Option<TimedLoop>; Seat::COUNT],
    wall: WallMap,
    now_mono_ns: u64,
    announcements: Announcements,
    observer: Rc<dyn ErasedObserver>,
}

/// What else there is of the flight.
pub(super) struct Flying<'a> {
    pub(super) graph: &'a Graph,
    pub(super) loops: &'a mut [Loop],
    pub(super) marks: &'a mut FlightMarks,
    pub(super) end_ns: u64,
    /// Place of the loop whose turn it is, among all.
    pub(super) stepping: &'a mut usize,
    /// Others may go on from a loop's state.
    pub(super) keeps_states: bool,
}

/// A loop on its seat by its number; none is without.
fn number(l: &Loop) -> usize {
    l.place.number().unwrap_or(0)
}

impl TimedClock {
    /// Before the first turn.
    pub(super) fn new(script: Script, observer: Rc<dyn ErasedObserver>) -> Self {
        let announcements = script.announcements();
        let script = Rc::new(script.on_clock(START_MONO_NS));
        Self {
            delays: Rc::new(Delays::new(Rc::clone(&script))),
            script,
            agenda: Agenda::for_loops(Seat::COUNT),
            loops: [const { None }; Seat::COUNT],
            wall: timed::wall(),
            now_mono_ns: 0,
            announcements,
            observer,
        }
    }

    /// Gives each loop its turns before `t_ns`; all that are left if that is the end of the flight or later.
    pub(super) fn fly_until(&mut self, t_ns: u64, flying: &mut Flying<'_>) {
        self.admit(flying);
        let until_mono_ns = if t_ns < flying.end_ns { self.wall.mono_ns(t_ns) } else { u64::MAX };
        while let Some(turn) = self.agenda.next().filter(|turn| turn.at_ns < until_mono_ns) {
            let at = flying.loops.iter().position(|l| number(l) == turn.index && l.flies());
            let Some(at) = at else {
                self.agenda.end(turn.index);
                continue;
            };
            *flying.stepping = at;
            self.now_mono_ns = turn.at_ns;
            self.announce_until(turn.at_ns);
            let answer = self.take_turn(turn, flying);
            self.agenda.go_on(turn.index, answer.next);
            if let Some(before_ns) = answer.announced_from_ns {
                self.announce(turn.at_ns, before_ns, flying);
            }
        }
        self.now_mono_ns = self.now_mono_ns.max(self.wall.mono_ns(t_ns.min(flying.end_ns)));
    }

    /// Logical instant of the next turn; none if no loop has one \[ns\].
    pub(super) fn next_turn_ns(&self) -> Option<u64> {
        self.agenda.next().map(|turn| self.wall.logical_ns(turn.at_ns))
    }

    /// Gives a first turn to each loop that has come.
    fn admit(&mut self, flying: &mut Flying<'_>) {
        for l in flying.loops.iter_mut().filter(|l| l.flies()) {
            let index = number(l);
            if !self.agenda.admit(index, l.generation) {
                continue;
            }
            self.agenda.plan(index, TurnKind::Look, self.now_mono_ns);
            if let Some(executor) = l.stepper.executor() {
                take_effect_when_published(executor, flying.graph, self.wall);
            }
            let timed = TimedLoop::new(Rc::clone(&self.script), Rc::clone(&self.delays));
            self.loops[index] = Some(timed);
        }
    }

    /// Writes into the recording what of the script begins by an instant of this clock \[ns\].
    fn announce_until(&mut self, at_mono_ns: u64) {
        let now_ns = self.wall.logical_ns(at_mono_ns);
        while let Some((from_ns, text)) = self.announcements.next_by(now_ns) {
            self.observer.note(from_ns, false, &format!("{FAULT}{text}"));
        }
    }

    /// Lets a loop do what it would do by the wall clock at this instant.
    fn take_turn(&mut self, turn: Turn, flying: &mut Flying<'_>) -> Answer {
        let Flying { graph, end_ns, keeps_states, .. } = *flying;
        let l = &mut flying.loops[*flying.stepping];
        let Loop { stepper, published, name, place, leave_ns, .. } = l;
        let last = Answer { next: None, announced_from_ns: None, mark_ns: stepper.next_ns() };
        let timed = self.loops[turn.index].as_mut();
        let Some((timed, executor)) = timed.zip(stepper.executor()) else { return last };
        let (end_ns, steps) = (end_ns.min(*leave_ns), executor.steps());
        let around = Around { graph, marks: &*flying.marks, seat: *place, name, end_ns };
        let answer = timed.take_turn((turn.at_ns, turn.kind), executor, &around, |executor| {
            if keeps_states && matches!(published, Published::There) {
                *published = Published::Kept(executor.state().map(<[u8]>::to_vec));
            }
        });
        if executor.steps() > steps {
            *published = Published::There;
        }
        answer
    }

    /// Publishes to the others how far a loop has got, and wakes those whose next release this may unblock.
    fn announce(&mut self, at_ns: u64, before_ns: u64, flying: &mut Flying<'_>) {
        let l = &flying.loops[*flying.stepping];
        let (place, generation, mark_ns) = (l.place, l.generation, l.stepper.next_ns());
        flying.marks.advance(place, generation, mark_ns);
        for role in flying.graph.wakes(place.role, before_ns, mark_ns) {
            for l in flying.loops.iter().filter(|l| l.node.role == role) {
                let woken_ns = self.script.woken_ns(l.loop_name(), at_ns, l.stepper.next_ns());
                if let Some(at_ns) = woken_ns {
                    self.agenda.wake(number(l), at_ns);
                }
            }
        }
    }
}
