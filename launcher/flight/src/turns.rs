//! The turns of a flight whose loops and samples take the time that a script sets: one loop at a time, on a clock that
//! goes on to the next instant at which one of them has something to do.

use runtime::Graph;
use runtime::clock::{WallMap, mono_now_ns};
use runtime::graph::READER_CAPACITY;
use runtime::ipc::{Bus, NumberedAnswer, NumberedOrder, Order, PortError, TurnGiver};
use runtime::timed::{self, START_MONO_NS};
use shared_types::{Role, Seat};
use std::time::Duration;
use timing::{Agenda, LoopName, Script, Turn, TurnKind};

/// Most turns between two looks of the launcher: what they publish fits into its rings.
const TURNS_MAX: u32 = 100;
/// After so many turns of others a loop takes what has come out of its ports, which have room for more than twice as much:
/// a turn publishes one sample of a topic at most.
const COLLECT_AFTER: u64 = 400;
const _: () = assert!(2 * COLLECT_AFTER < READER_CAPACITY as u64);
/// Longest wait for an answer between two looks of the launcher \[ns\].
const ANSWER_WAIT_NS: u64 = 1_000_000;

/// A loop that takes part.
#[derive(Debug, Clone)]
pub(super) struct Participant {
    pub(super) seat: Seat,
    pub(super) generation: u32,
    /// Name of its service.
    pub(super) name: String,
    /// It goes on from the last state of the process before it, as if that had not gone.
    pub(super) goes_on: bool,
}

impl Participant {
    fn number(&self) -> usize {
        self.seat.number().unwrap_or(0)
    }

    fn loop_name(&self) -> LoopName<'_> {
        LoopName { role: self.seat.role, name: &self.name }
    }
}

/// An order that has not been answered.
#[derive(Debug, Clone, Copy)]
struct Awaited {
    seat: Seat,
    order: NumberedOrder,
    /// The turn, if it is one.
    turn: Option<Turn>,
}

/// What is known of a loop on a seat.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    mark_ns: u64,
    /// Turns of all when it had its last order.
    turns: u64,
    /// When it began the step that it has not published \[ns\].
    begun_ns: Option<u64>,
    /// It goes on for a process before it, and has not run what that one had.
    is_behind: bool,
}

/// Which loop has its turn when.
pub(super) struct Turns {
    script: Script,
    giver: TurnGiver,
    /// By [`Seat::number`], as everything about a loop here.
    agenda: Agenda,
    known: [Known; Seat::COUNT],
    awaited: Option<Awaited>,
    /// The seat whose pipe had no room for an order.
    refused: Option<Seat>,
    wall: WallMap,
    now_mono_ns: u64,
    /// Turns that have been taken.
    taken: u64,
    orders: u32,
}

impl Turns {
    /// Before the first turn; creates what turns are given through.
    ///
    /// # Errors
    /// [`PortError`].
    pub(super) fn create(bus: &Bus, script: Script) -> Result<Self, PortError> {
        bus.create_turns()?;
        Ok(Self {
            script: script.on_clock(START_MONO_NS),
            giver: TurnGiver::open(bus)?,
            agenda: Agenda::for_loops(Seat::COUNT),
            known: [Known::default(); Seat::COUNT],
            awaited: None,
            refused: None,
            wall: timed::wall(),
            now_mono_ns: 0,
            taken: 0,
            orders: 0,
        })
    }

    /// Turns that have been taken: a flight that stands still is known by that.
    pub(super) fn taken(&self) -> u64 {
        self.taken
    }

    /// How far a loop has got, as it has reported \[ns\].
    pub(super) fn mark_ns(&self, seat: Seat) -> u64 {
        seat.number().map_or(0, |number| self.known[number].mark_ns)
    }

    /// Seat of the process that an answer is awaited from, or that takes no orders out of its pipe.
    pub(super) fn awaited(&self) -> Option<Seat> {
        self.awaited.map(|awaited| awaited.seat).or(self.refused)
    }

    /// Logical instant of the next turn; none if no loop has one \[ns\].
    pub(super) fn next_turn_ns(&self) -> Option<u64> {
        self.agenda.next().map(|turn| self.wall.logical_ns(turn.at_ns))
    }

    /// Logical time now \[ns\].
    pub(super) fn now_ns(&self) -> u64 {
        self.wall.logical_ns(self.now_mono_ns)
    }

    /// Has a process look which others have come and gone, or leave if its time is over.
    pub(super) fn nudge(&mut self, participant: &Participant, leaves: bool) {
        let order = if leaves { Order::Leave } else { Order::LookAround };
        let order = self.numbered(order, participant.generation);
        // One that has no room for it has not been looking at its orders anyway.
        let _ = self.giver.give(participant.number(), order);
    }

    fn numbered(&mut self, order: Order, generation: u32) -> NumberedOrder {
        self.orders = self.orders.wrapping_add(1);
        NumberedOrder { order, generation, number: self.orders }
    }

    /// Gives each loop its turns before `t_ns`, all that are left if that is the end of the flight or later; true once
    /// they have been taken, and false if it is time to look around before.
    pub(super) fn give_until(
        &mut self,
        t_ns: u64,
        end_ns: u64,
        graph: &Graph,
        participants: &[Participant],
    ) -> bool {
        for participant in participants {
            let (number, generation) = (participant.number(), participant.generation);
            if self.agenda.admit(number, generation) {
                self.admit(number, participant.goes_on);
            }
        }
        let until_mono_ns = if t_ns < end_ns { self.wall.mono_ns(t_ns) } else { u64::MAX };
        let most = self.taken + u64::from(TURNS_MAX);
        loop {
            if !self.take_answer(graph, participants) || self.taken >= most {
                return false;
            }
            let by_number = |number| participants.iter().find(|p| p.number() == number);
            let Some(turn) = self.agenda.next().filter(|turn| turn.at_ns < until_mono_ns) else {
                self.now_mono_ns = self.now_mono_ns.max(self.wall.mono_ns(t_ns.min(end_ns)));
                return true;
            };
            let Some(participant) = by_number(turn.index) else {
                self.agenda.end(turn.index);
                continue;
            };
            let behind = participants.iter().find(|p| self.known[p.number()].is_behind);
            // One that has had its last turn needs no more samples.
            let overdue = participants.iter().find(|p| {
                let turns = self.known[p.number()].turns;
                self.taken - turns > COLLECT_AFTER && self.agenda.of(p.number()).is_some()
            });
            let given = if let Some(behind) = behind {
                let until_ns = self.known[behind.number()].mark_ns;
                self.give(behind, Order::CatchUp(until_ns), None)
            } else if let Some(overdue) = overdue {
                self.give(overdue, Order::Collect, None)
            } else {
                self.now_mono_ns = turn.at_ns;
                self.give(participant, Order::Turn(turn.kind, turn.at_ns), Some(turn))
            };
            if !given {
                return false;
            }
        }
    }

    /// A process has come. One that goes on for the one before it has the turn that this one would have had, and begins what
    /// this one had begun when this one did.
    fn admit(&mut self, number: usize, goes_on: bool) {
        let before = self.known[number];
        if !goes_on || before.mark_ns == 0 {
            self.known[number] = Known { turns: self.taken, ..Known::default() };
            self.agenda.plan(number, TurnKind::Look, self.now_mono_ns);
            return;
        }
        self.known[number] = Known { turns: self.taken, is_behind: true, ..before };
        if let Some(at_ns) = before.begun_ns {
            self.agenda.plan(number, TurnKind::Begin, at_ns);
        } else if self.agenda.of(number).is_none() {
            self.agenda.plan(number, TurnKind::Look, self.now_mono_ns);
        }
    }

    /// A process has run what the one before it had run. If that one had published a step and died before it could
    /// report it, the others are notified now.
    fn take_up(
        &mut self,
        mark_ns: u64,
        graph: &Graph,
        (participant, participants): (&Participant, &[Participant]),
    ) {
        let number = participant.number();
        let known = &mut self.known[number];
        let before_ns = core::mem::replace(&mut known.mark_ns, mark_ns);
        known.is_behind = false;
        if mark_ns > before_ns {
            known.begun_ns = None;
            let at_ns = self.now_mono_ns;
            self.agenda.plan(number, TurnKind::Look, at_ns);
            let woken = graph.wakes(participant.seat.role, before_ns, mark_ns);
            self.wake(woken, at_ns, participants);
        }
    }

    fn give(&mut self, to: &Participant, order: Order, turn: Option<Turn>) -> bool {
        let order = self.numbered(order, to.generation);
        let is_given = self.giver.give(to.number(), order);
        self.refused = (!is_given).then_some(to.seat);
        if is_given {
            self.awaited = Some(Awaited { seat: to.seat, order, turn });
        }
        is_given
    }

    /// Takes in the answer that is awaited, if one is; false if it has not come in [`ANSWER_WAIT_NS`].
    pub(super) fn take_answer(&mut self, graph: &Graph, participants: &[Participant]) -> bool {
        let Some(Awaited { seat, order, turn }) = self.awaited else { return true };
        let is_there = |p: &&Participant| (p.seat, p.generation) == (seat, order.generation);
        let Some(participant) = participants.iter().find(is_there) else {
            // Its process has gone; whatever comes in its place gets a turn of its own.
            self.awaited = None;
            return true;
        };
        let number = participant.number();
        let give_up_ns = mono_now_ns() + ANSWER_WAIT_NS;
        let answer = loop {
            let left_ns = give_up_ns.saturating_sub(mono_now_ns());
            let answer = self.giver.await_answer(Duration::from_nanos(left_ns));
            let is_meant = |answer: &NumberedAnswer| {
                (answer.seat, answer.generation, answer.number)
                    == (number, order.generation, order.number)
            };
            match answer {
                Some(answer) if is_meant(&answer) => break answer.answer,
                None if left_ns == 0 => return false,
                _ => {}
            }
        };
        self.awaited = None;
        self.known[number].turns = self.taken;
        if let (Some(turn), Some(answer)) = (turn, answer) {
            self.taken += 1;
            let is_amid_a_step = matches!(answer.next, Some((TurnKind::Publish, _)));
            let begun_ns = is_amid_a_step.then_some(turn.at_ns);
            let (mark_ns, turns) = (answer.mark_ns, self.taken);
            self.known[number] = Known { mark_ns, turns, begun_ns, is_behind: false };
            self.agenda.go_on(number, answer.next);
            if let Some(before_ns) = answer.announced_from_ns {
                let woken = graph.wakes(participant.seat.role, before_ns, mark_ns);
                self.wake(woken, turn.at_ns, participants);
            }
        } else if let Some(answer) = answer {
            self.take_up(answer.mark_ns, graph, (participant, participants));
        }
        true
    }

    /// Wakes the loops of these roles at an instant of the clock \[ns\].
    fn wake(
        &mut self,
        roles: impl Iterator<Item = Role>,
        at_ns: u64,
        participants: &[Participant],
    ) {
        for role in roles {
            for woken in participants.iter().filter(|p| p.seat.role == role) {
                let number = woken.number();
                let mark_ns = self.known[number].mark_ns;
                if let Some(at_ns) = self.script.woken_ns(woken.loop_name(), at_ns, mark_ns) {
                    self.agenda.wake(number, at_ns);
                }
            }
        }
    }
}
