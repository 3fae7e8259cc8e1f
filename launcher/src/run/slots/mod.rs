//! The slots of a flight: runs the swap protocol between processes, consumers and requests.
//!
//! The protocol itself is `slot::supervisor`, which knows neither processes nor clocks. This gives it
//! events (hellos, deaths, what consumers say, time, requests) and does what it wants done.

mod facts;
mod gatekeeper;
mod ledger;
mod script;
mod watch;
mod words;

pub use ledger::SwapReport;
pub(super) use ledger::write_table;
pub(super) use script::Script;
pub(super) use watch::SlotWatch;

use super::child::ChildSpec;
use super::supervisor::{FlightError, PostEvent, Supervisor};
use super::tap::Tap;
use facts::{axes, command_latency_ns, millihertz};
use gatekeeper::Gatekeeper;
use ledger::seconds;
use runtime::Graph;
use runtime::ipc::Bus;
use shared_types::{ClockMode, Flag, Handover, Role, Seat as Place};
use slot::gate::GateLimits;
use slot::record::{Seat, author_on};
use slot::supervisor::{
    Action, Event, Fault, Instance, Now, Outcome, Program, Report, Request, Slot,
    SlotConfig, Step, Target,
};
use watch::Seen;
use words::{Names, words};

/// Wall time that a process may take to leave, or to say hello \[ns\].
const PATIENCE_NS: u64 = 10_000_000_000;

/// A sentence about a slot, for whoever follows the flight.
#[derive(Debug, Clone)]
pub(super) struct News {
    pub(super) slot: Role,
    pub(super) text: String,
    /// Something did not go as asked for.
    pub(super) warning: bool,
    /// Exit code for whoever asked, once there is nothing more to come.
    pub(super) ends: Option<u8>,
}

/// How much a candidate may differ, if not as the gate has it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Limits {
    /// Largest disagreement over the largest command.
    pub(super) max_bump: Option<f64>,
}

/// One slot and what is going on in it.
struct Managed {
    role: Role,
    slot: Slot,
    gate: Option<Gatekeeper>,
    limits: Limits,
    programs: [Option<Program>; shared_types::SEATS],
    /// Seats that somebody is to leave, or to take, by a wall-clock instant \[ns\].
    expected: Vec<(Seat, Expected, u64)>,
    /// Index of the swap that is going on.
    current: Option<usize>,
    /// Of the consumer, as far as it has been told to the protocol.
    acknowledged: u64,
    refused_epoch: u64,
    fell_over: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expected {
    Hello,
    Exit,
}

/// What the slots may use.
pub(super) struct Means<'a> {
    pub(super) bus: &'a Bus,
    pub(super) graph: &'a Graph,
    pub(super) supervisor: &'a mut Supervisor,
    pub(super) tap: &'a mut Tap,
    pub(super) now: Now,
    pub(super) now_mono_ns: u64,
    /// The flight has reached its end: whoever leaves does so in order.
    pub(super) is_over: bool,
}

/// All slots that have processes.
pub(super) struct Slots {
    slots: Vec<Managed>,
    programs: Vec<ChildSpec>,
    u_max: Vec<(Role, [f64; 4])>,
    mode: ClockMode,
    pub(super) reports: Vec<SwapReport>,
    pub(super) news: Vec<News>,
}

impl Slots {
    /// The slots of a flight whose first owners are `specs`; `u_max` is the largest command of each.
    pub(super) fn new(
        mode: ClockMode,
        specs: &[(Role, ChildSpec)],
        u_max: Vec<(Role, [f64; 4])>,
    ) -> Self {
        let config = match mode {
            ClockMode::Lockstep => SlotConfig::LOCKSTEP,
            _ => SlotConfig::REALTIME,
        };
        let mut all = Self {
            slots: Vec::new(),
            programs: Vec::new(),
            u_max,
            mode,
            reports: Vec::new(),
            news: Vec::new(),
        };
        for (role, spec) in specs.iter().filter(|(role, _)| role.seats() > 1) {
            let program = all.program(spec.clone());
            let mut programs = [None; shared_types::SEATS];
            programs[0] = Some(program);
            all.slots.push(Managed {
                role: *role,
                slot: Slot::new(config, Seat::ALL[0], program),
                gate: None,
                limits: Limits::default(),
                programs,
                expected: Vec::new(),
                current: None,
                acknowledged: 0,
                refused_epoch: 0,
                fell_over: 0,
            });
        }
        all
    }

    /// The place of a program in the list.
    pub(super) fn program(&mut self, spec: ChildSpec) -> Program {
        let known = self.programs.iter().position(|known| known.is_same_program(&spec));
        let index = known.unwrap_or_else(|| {
            self.programs.push(spec);
            self.programs.len() - 1
        });
        Program(u32::try_from(index).unwrap_or(u32::MAX))
    }

    fn spec(&self, program: Program) -> Option<&ChildSpec> {
        self.programs.get(usize::try_from(program.0).ok()?)
    }

    /// True if a slot of this role has processes of its own.
    pub(super) fn has(&self, role: Role) -> bool {
        self.slots.iter().any(|managed| managed.role == role)
    }

    /// Lockstep: whoever commands, or is about to, is started again in place when it dies, and time
    /// waits for it, so that a death from outside leaves no trace.
    pub(super) fn keeps(&self, place: Place) -> bool {
        let Some(managed) = self.slots.iter().find(|m| m.role == place.role) else { return true };
        let record = managed.slot.record();
        let named = record.is_some_and(|r| {
            u32::from(r.owner) == place.index
                || r.fallback.is_some_and(|seat| u32::from(seat) == place.index)
        });
        self.mode == ClockMode::Lockstep && named
    }

    /// Lockstep: the end of allowed time until the slots have had their say \[ns\].
    pub(super) fn cap_ns(&self, allowed_ns: u64) -> u64 {
        let held = self.slots.iter().any(|managed| managed.slot.holds_time());
        let deadlines = self.slots.iter().filter_map(|managed| managed.slot.deadline_ns());
        let cap_ns = deadlines.min().unwrap_or(u64::MAX);
        if held { allowed_ns } else { cap_ns }
    }

    /// Asks for something in a slot.
    pub(super) fn request(
        &mut self,
        role: Role,
        request: Request,
        limits: Limits,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let Some(index) = self.slots.iter().position(|managed| managed.role == role) else {
            return Ok(());
        };
        let busy = self.slots[index].current.is_some();
        if let Request::Swap(target, _) = request
            && !busy
        {
            let to = match target {
                Target::New(program) => self.name(program),
                Target::Seated(seat) => self.name_on(index, seat),
            };
            let from = self.owner_name(index);
            self.reports.push(SwapReport::new(role, &from, &to, means.now.logical_ns));
            self.slots[index].current = Some(self.reports.len() - 1);
            self.slots[index].limits = limits;
        }
        self.tell(index, Event::Request(request), means)
    }

    /// Takes in everything that has happened; call once per round of the launcher's loop.
    pub(super) fn tend(&mut self, means: &mut Means<'_>) -> Result<(), FlightError> {
        let seen = means.tap.consumers.slot_watch.as_mut().map(SlotWatch::take);
        for seen in seen.unwrap_or_default() {
            self.see(&seen, means)?;
        }
        for event in means.supervisor.take_events() {
            self.hear(&event, means)?;
        }
        for index in 0..self.slots.len() {
            self.lose_patience(index, means)?;
            let due = |managed: &Managed| {
                managed.slot.deadline_ns().is_some_and(|at_ns| at_ns <= means.now.logical_ns)
            };
            if due(&self.slots[index]) {
                self.tell(index, Event::Time, means)?;
            }
        }
        Ok(())
    }

    fn hear(&mut self, event: &PostEvent, means: &mut Means<'_>) -> Result<(), FlightError> {
        let place = event.place();
        let Some(index) = self.slots.iter().position(|m| m.role == place.role) else {
            return Ok(());
        };
        let Some(seat) = Seat::new(place.index) else { return Ok(()) };
        self.slots[index].expected.retain(|(expected, ..)| *expected != seat);
        match event {
            PostEvent::Joined { layout, period_ns, .. } => {
                let latency_ns = command_latency_ns(means.graph, place.role);
                let instance = Instance {
                    author: author_on(place.index),
                    layout: *layout,
                    millihertz: millihertz(means.graph, place.role, *period_ns),
                    latency_ns,
                };
                self.tell(index, Event::Ready(seat, instance), means)
            }
            PostEvent::Gone { .. } if means.is_over => Ok(()),
            PostEvent::Gone { obituary, .. } => {
                if let Some(obituary) = obituary {
                    self.say(index, obituary.clone(), true, None);
                }
                self.tell(index, Event::Died(seat), means)
            }
        }
    }

    fn see(&mut self, seen: &Seen, means: &mut Means<'_>) -> Result<(), FlightError> {
        let role = match seen {
            Seen::Command(command) => command.slot,
            Seen::Obeys { slot, .. } | Seen::Missed { slot, .. } => *slot,
        };
        let Some(index) = self.slots.iter().position(|managed| managed.role == role) else {
            return Ok(());
        };
        match *seen {
            Seen::Command(command) => {
                let gate = self.slots[index].gate.as_mut();
                if let Some(Err(refusal)) = gate.map(|gate| gate.take(&command))
                    && let Some(seat) = self.slots[index].slot.candidate()
                {
                    return self.tell(index, Event::Verdict(seat, Err(refusal)), means);
                }
                Ok(())
            }
            Seen::Missed { seat, steps, at_ns, .. } => {
                if let Some(gate) = &mut self.slots[index].gate {
                    gate.missed(seat, steps, at_ns);
                }
                Ok(())
            }
            Seen::Obeys { by_seat, obeyed, .. } => {
                // Of several attitude controllers the one that commands decides whom it obeys.
                if role == Role::Position && self.owner_seat(Role::Attitude) != Some(by_seat) {
                    return Ok(());
                }
                let managed = &mut self.slots[index];
                if obeyed.refused_epoch > managed.refused_epoch {
                    managed.refused_epoch = obeyed.refused_epoch;
                    let epoch = obeyed.refused_epoch;
                    self.tell(index, Event::RecordRefused { epoch }, means)?;
                }
                let managed = &mut self.slots[index];
                if obeyed.epoch > managed.acknowledged
                    && let Some(seat) = Seat::new(obeyed.seat)
                {
                    managed.acknowledged = obeyed.epoch;
                    let (epoch, at_ns) = (obeyed.epoch, obeyed.at_ns);
                    self.tell(index, Event::Acknowledged { epoch, seat, at_ns }, means)?;
                }
                let managed = &mut self.slots[index];
                if obeyed.failed_over && obeyed.epoch > managed.fell_over {
                    managed.fell_over = obeyed.epoch;
                    let (epoch, at_ns) = (obeyed.epoch, obeyed.at_ns);
                    self.tell(index, Event::FellOver { epoch, at_ns }, means)?;
                }
                Ok(())
            }
        }
    }

    /// Whoever takes too long to come or to go is dealt with.
    fn lose_patience(&mut self, index: usize, means: &mut Means<'_>) -> Result<(), FlightError> {
        let now_mono_ns = means.now_mono_ns;
        let late = |(_, _, by_ns): &(Seat, Expected, u64)| *by_ns < now_mono_ns;
        while let Some(at) = self.slots[index].expected.iter().position(late) {
            let (seat, what, _) = self.slots[index].expected.swap_remove(at);
            let fault = if what == Expected::Hello { Fault::NeverReady } else { Fault::Stalled };
            self.tell(index, Event::Misbehaved(seat, fault), means)?;
        }
        Ok(())
    }

    /// Gives an event to the protocol and does what it wants done.
    fn tell(
        &mut self,
        index: usize,
        event: Event,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let actions = self.slots[index].slot.on(means.now, event);
        for action in actions {
            self.act(index, action, means)?;
        }
        Ok(())
    }

    fn act(
        &mut self,
        index: usize,
        action: Action,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let role = self.slots[index].role;
        let place = |seat: Seat| Place { role, index: seat.into() };
        let by_ns = means.now_mono_ns.saturating_add(PATIENCE_NS);
        match action {
            Action::Spawn(seat, program) => {
                let Some(spec) = self.spec(program).cloned() else { return Ok(()) };
                self.slots[index].programs[seat.index()] = Some(program);
                self.slots[index].expected.push((seat, Expected::Hello, by_ns));
                means.supervisor.spawn(means.bus, place(seat), spec)?;
            }
            Action::Restart(seat, _) => {
                self.slots[index].expected.push((seat, Expected::Hello, by_ns));
                means.supervisor.restart(place(seat), means.now_mono_ns)?;
            }
            Action::Publish(record) => {
                means.supervisor.announce(record.to_sample(role), means.tap);
            }
            Action::HandOver { seat, state_of, join_ns, track_until_ns } => {
                let state = state_of.and_then(|of| means.tap.last_state(place(of)));
                let same = state_of.is_some_and(|of| of != seat);
                // In realtime a successor of the same kind runs what it has missed, from history.
                let catches_up = same && self.mode != ClockMode::Lockstep;
                let order = Handover {
                    join_ns: if catches_up { 0 } else { join_ns },
                    track_until_ns,
                    has_state: Flag::from(state.is_some()),
                    catches_up: Flag::from(catches_up),
                };
                means.supervisor.hand_over(place(seat), order, state.unwrap_or_default());
                self.open_gate(index, seat, state_of.is_some(), track_until_ns, means);
            }
            Action::Judge(seat) => {
                let gate = self.slots[index].gate.as_ref();
                if let Some(verdict) = gate.map(Gatekeeper::verdict) {
                    return self.tell(index, Event::Verdict(seat, verdict.map(Box::new)), means);
                }
            }
            Action::AwaitExit(seat) => {
                self.slots[index].expected.push((seat, Expected::Exit, by_ns));
            }
            Action::Kill(seat) => means.supervisor.kill(place(seat)),
            Action::Report(report) => self.report(index, report),
        }
        Ok(())
    }

    /// Begins to compare a candidate with the owner.
    fn open_gate(
        &mut self,
        index: usize,
        seat: Seat,
        same_kind: bool,
        track_until_ns: u64,
        means: &Means<'_>,
    ) {
        let managed = &self.slots[index];
        let Some(owner) = managed.slot.record().map(|record| record.owner) else { return };
        if managed.slot.candidate() != Some(seat) || owner == seat {
            return;
        }
        let u_max = self.u_max.iter().find(|(role, _)| *role == managed.role);
        let axes = axes(managed.role, &u_max.map_or([1.0; 4], |(_, u_max)| *u_max));
        let mut limits = if same_kind { GateLimits::SAME_KIND } else { GateLimits::OTHER_KIND };
        if let Some(max_bump) = managed.limits.max_bump {
            limits.tracking = max_bump;
            limits.free_rms = max_bump;
            limits.free_peak = limits.free_peak.max(max_bump);
        }
        let tracks = !same_kind && track_until_ns > means.now.logical_ns;
        let who = (u32::from(seat), u32::from(owner));
        let gate = Gatekeeper::new(axes, limits, who, (tracks, track_until_ns));
        self.slots[index].gate = Some(gate);
    }

    fn report(&mut self, index: usize, report: Report) {
        let current = self.slots[index].current;
        match report {
            Report::Refused(reason) => {
                self.end(index, &reason.to_string(), false);
                self.say(index, format!("refused: {reason}"), true, Some(reason.exit_code()));
            }
            Report::Aborted(seat, reason) => {
                let name = self.name_on(index, seat);
                self.end(index, &reason.to_string(), false);
                let text = format!("{name} on {seat} is out: {reason}");
                self.say(index, text, true, Some(reason.exit_code()));
            }
            Report::Done(seat, outcome) => {
                let name = self.name_on(index, seat);
                let words = match outcome {
                    Outcome::Swapped => "commands; the rollback window is over",
                    Outcome::RolledBack => "commands again, rolled back as asked",
                    Outcome::DryRun => "passed the gate; nothing was changed (dry run)",
                    Outcome::StandsBy => "stands by as the fallback",
                    Outcome::Retired => "leaves",
                };
                self.end(index, words, true);
                self.say(index, format!("{name} on {seat} {words}"), false, Some(0));
            }
            Report::Step(step) => {
                if let Some(report) = current.and_then(|current| self.reports.get_mut(current)) {
                    match &step {
                        Step::Joined { same_kind, at_ns, .. } => {
                            report.joined_s = Some(seconds(*at_ns));
                            report.same_kind = Some(*same_kind);
                        }
                        Step::Flipped { epoch, at_ns, .. } => {
                            report.flipped_s = Some(seconds(*at_ns));
                            report.epoch = Some(*epoch);
                        }
                        _ => {}
                    }
                }
                if let Step::FlipsAt { at_ns, .. } = step
                    && let Some(gate) = &mut self.slots[index].gate
                {
                    gate.flips_at(at_ns);
                }
                let names = Names {
                    on: &|seat| format!("{} on {seat}", self.name_on(index, seat)),
                    of: &|program| self.name(program),
                };
                let (text, warning) = words(&step, &names);
                self.say(index, text, warning, None);
            }
        }
    }

    /// Writes down how what was going on ended.
    fn end(&mut self, index: usize, outcome: &str, done: bool) {
        let managed = &mut self.slots[index];
        let gate = managed.gate.take();
        let Some(report) = managed.current.take().and_then(|at| self.reports.get_mut(at)) else {
            return;
        };
        if let Some(gate) = &gate {
            report.measured(gate);
        }
        outcome.clone_into(&mut report.outcome);
        report.done = done;
    }

    fn say(&mut self, index: usize, text: String, warning: bool, ends: Option<u8>) {
        let slot = self.slots[index].role;
        self.news.push(News { slot, text, warning, ends });
    }

    fn name(&self, program: Program) -> String {
        self.spec(program).map_or_else(|| "somebody".to_owned(), |spec| spec.name.clone())
    }

    fn name_on(&self, index: usize, seat: Seat) -> String {
        let program = self.slots[index].programs[seat.index()];
        program.map_or_else(|| "somebody".to_owned(), |program| self.name(program))
    }

    fn owner_name(&self, index: usize) -> String {
        let owner = self.slots[index].slot.record().map(|record| record.owner);
        owner.map_or_else(String::new, |seat| self.name_on(index, seat))
    }

    /// Seat that commands a slot by the newest record.
    pub(super) fn owner_seat(&self, role: Role) -> Option<u32> {
        let managed = self.slots.iter().find(|managed| managed.role == role)?;
        managed.slot.record().map(|record| record.owner.into())
    }

    /// Seats of a slot on which `name` sits, the owner's first.
    pub(super) fn seats_of(&self, name: &str) -> Vec<Place> {
        let mut places = Vec::new();
        for (index, managed) in self.slots.iter().enumerate() {
            let named =
                |seat: &Seat| managed.slot.is_taken(*seat) && self.name_on(index, *seat) == name;
            let seats = Seat::ALL.into_iter().filter(named);
            places.extend(seats.map(|seat| Place { role: managed.role, index: seat.into() }));
        }
        places.sort_by_key(|place| self.owner_seat(place.role) != Some(place.index));
        places
    }

    /// A scripted fault: the process on a seat has been stopped, and is to be counted as silent.
    pub(super) fn stopped(
        &mut self,
        place: Place,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let index = self.slots.iter().position(|managed| managed.role == place.role);
        let (Some(index), Some(seat)) = (index, Seat::new(place.index)) else { return Ok(()) };
        self.tell(index, Event::Misbehaved(seat, Fault::Stalled), means)
    }

    /// Nothing is going on in any slot.
    pub(super) fn are_quiet(&self) -> bool {
        self.slots.iter().all(|managed| managed.slot.is_quiet())
    }

    /// The flight is over: what is still going on ends as it is.
    pub(super) fn finish(&mut self) {
        for index in 0..self.slots.len() {
            self.end(index, "the flight ended before it did", false);
        }
    }
}
