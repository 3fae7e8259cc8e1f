//! A flight whose loops and samples take the time that a script says: each loop decides as it does by the wall clock,
//! and this clock goes on to the next instant at which one of them has something to do.

use super::delays::{DelayedMarks, Delays};
use super::loops::{Loop, Published};
use super::marks::FlightMarks;
use super::observer::ErasedObserver;
use runtime::Graph;
use runtime::clock::WallMap;
use runtime::executor::Computed;
use runtime::pacing::{Next, Pacing, is_timed, take_effect_when_published};
use shared_types::{ClockRecord, Seat};
use std::rc::Rc;
use swap::FAULT;
use timing::{Agenda, Script, Turn, TurnKind, Who};

/// Logical time 0 on this clock: sources work ahead of the start \[ns\].
const START_MONO_NS: u64 = 10_000_000_000;

/// The clock, and whose turn is when.
pub(super) struct TimedClock {
    script: Rc<Script>,
    pub(super) delays: Rc<Delays>,
    /// By [`Seat::number`], as all that is told of a loop here.
    agenda: Agenda,
    /// Steps that have been computed and not published.
    computed: [Option<Computed>; Seat::COUNT],
    /// Generation of the loop on a seat.
    there: [Option<u32>; Seat::COUNT],
    wall: WallMap,
    now_mono_ns: u64,
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
        let mut to_come = script.told();
        to_come.reverse();
        let script = Rc::new(script.on_clock(START_MONO_NS));
        let start =
            ClockRecord { start_mono_ns: START_MONO_NS, speed: 1.0, ..ClockRecord::default() };
        Self {
            delays: Rc::new(Delays::new(Rc::clone(&script))),
            script,
            agenda: Agenda::for_loops(Seat::COUNT),
            computed: [None; Seat::COUNT],
            there: [None; Seat::COUNT],
            wall: WallMap::new(&start),
            now_mono_ns: 0,
            to_come,
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
            self.delays.move_to(turn.at_ns);
            self.tell_until(turn.at_ns);
            match (turn.kind, self.computed[turn.index].take()) {
                (TurnKind::Publish, Some(computed)) => self.publish(turn, computed, flying),
                _ => self.look(turn, flying),
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
            let (index, generation) = (number(l), l.generation);
            if self.there[index].replace(generation) == Some(generation) {
                continue;
            }
            if let Some(executor) = l.stepper.executor() {
                take_effect_when_published(executor, flying.graph, self.wall);
            }
            self.computed[index] = None;
            self.agenda.plan(index, TurnKind::Look, self.now_mono_ns);
        }
    }

    /// Tells in the recording what of the script begins by an instant of this clock \[ns\].
    fn tell_until(&mut self, at_mono_ns: u64) {
        let now_ns = self.wall.logical_ns(at_mono_ns);
        while let Some((from_ns, text)) = self.to_come.pop_if(|(from_ns, _)| *from_ns <= now_ns) {
            self.observer.note(from_ns, false, &format!("{FAULT}{text}"));
        }
    }

    /// Lets a loop do what it would do by the wall clock at this instant.
    fn look(&mut self, turn: Turn, flying: &mut Flying<'_>) {
        let Turn { at_ns, index, kind } = turn;
        let Flying { graph, end_ns, keeps_states, .. } = *flying;
        let l = &mut flying.loops[*flying.stepping];
        let (leave_ns, reader) = (l.leave_ns, l.place);
        let Loop { stepper, published, name, .. } = l;
        let who = Who { role: reader.role, name: name.as_str() };
        let Some(executor) = stepper.executor() else { return self.agenda.end(index) };
        let release_ns = executor.mark_ns();
        if release_ns >= end_ns.min(leave_ns) {
            return self.agenda.end(index);
        }
        let is_timed = is_timed(graph, who.role);
        if !is_timed {
            executor.component.receive();
        }
        let marks = DelayedMarks { marks: &*flying.marks, delays: &self.delays, reader };
        let pacing = Pacing { graph, marks: &marks, wall: self.wall, is_timed };
        let begins_ns = |at_ns: u64| self.script.begins_ns(who, at_ns, release_ns);
        match pacing.next(executor, at_ns) {
            Next::Rest(until_ns) => self.agenda.plan(index, TurnKind::Begin, begins_ns(until_ns)),
            Next::Listen(until_ns) => {
                let arrival_ns = self.delays.next_arrival_mono_ns(reader);
                let arrival_ns = arrival_ns.filter(|at_ns| !self.script.misses_wake(who, *at_ns));
                let at_ns = begins_ns(until_ns.min(arrival_ns.unwrap_or(u64::MAX)));
                self.agenda.plan(index, TurnKind::Expire, at_ns);
            }
            Next::Begin(_) if kind == TurnKind::Look && begins_ns(at_ns) > at_ns => {
                self.agenda.plan(index, TurnKind::Begin, begins_ns(at_ns));
            }
            Next::Begin(due_mono_ns) => {
                if keeps_states && matches!(published, Published::There) {
                    *published = Published::Kept(executor.state().map(<[u8]>::to_vec));
                }
                if is_timed {
                    executor.component.receive();
                }
                if !pacing.begin(executor, at_ns) {
                    // A release that was skipped is final too.
                    self.agenda.plan(index, TurnKind::Look, at_ns);
                    return self.announce(at_ns, release_ns, flying);
                }
                let end_mono_ns = self.script.ends_ns(who, at_ns, release_ns);
                let computed = executor.compute(due_mono_ns, at_ns);
                if end_mono_ns > at_ns {
                    self.computed[index] = Some(computed);
                    self.agenda.plan(index, TurnKind::Publish, end_mono_ns);
                } else {
                    self.publish(turn, computed, flying);
                }
            }
        }
    }

    fn publish(&mut self, turn: Turn, computed: Computed, flying: &mut Flying<'_>) {
        let Turn { at_ns, index, .. } = turn;
        let l = &mut flying.loops[*flying.stepping];
        l.published = Published::There;
        let Some(executor) = l.stepper.executor() else { return };
        executor.publish(computed, at_ns);
        self.agenda.plan(index, TurnKind::Look, at_ns);
        self.announce(at_ns, computed.release_ns(), flying);
    }

    /// Lets the others know how far a loop has got, and wakes those whose next release this may unblock.
    fn announce(&mut self, at_ns: u64, before_ns: u64, flying: &mut Flying<'_>) {
        let l = &flying.loops[*flying.stepping];
        let (place, generation, mark_ns) = (l.place, l.generation, l.stepper.next_ns());
        flying.marks.advance(place, generation, mark_ns);
        for role in flying.graph.wakes(place.role, before_ns, mark_ns) {
            let woken = flying.loops.iter().filter(|l| l.node.role == role);
            for l in woken.filter(|l| !self.script.misses_wake(l.who(), at_ns)) {
                let begins_ns = self.script.begins_ns(l.who(), at_ns, l.stepper.next_ns());
                self.agenda.wake(number(l), begins_ns);
            }
        }
    }
}
