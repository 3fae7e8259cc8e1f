//! The slots of a flight: runs the swap protocol between processes, consumers and requests.
//!
//! The protocol itself is `slot::supervisor`, which knows neither processes nor clocks. This gives it
//! events (hellos, deaths, what consumers say, time, requests) and does what it wants done.

mod adoption;
mod consumers;
mod events;
mod facts;
mod gatekeeper;
mod given;
mod ledger;
mod posts;
mod rehearsal;
mod script;
mod seating;
mod telling;
mod trip;
mod watch;

pub use ledger::write_table;
pub use ledger::{SwapEnd, SwapReport};
pub use posts::Posts;
pub use script::FAULT;
pub use script::Script;
pub use watch::{Seen, SlotWatch};

use crate::FlightError;
use crate::child::{ChildSpec, Launch};
use crate::orders::{Executable, Machines, Ordered, Orders};
use consumers::Consumers;
use facts::Yardstick;
use gatekeeper::{Gatekeeper, Tracks};
use monitor::settings::Fallback;
use protocol::control::server::Answer;
use protocol::control::{Reply, Request as Asked};
use rehearsal::{Rehearsing, Underway};
use runtime::Graph;
use scenario::Scenario;
use scenario::candidate::{Candidate, Slot};
use scenario::orders::Planner;
use shared_types::{ClockMode, Flag, Handover, Role, Seat as Place};
use slot::gate::GateLimits;
use slot::supervisor::{Event, Fault, Now, SlotConfig};
use slot::{Action, Program, Report, Request, SEATS, Seat, Target};
use std::collections::BTreeMap;
use vehicle::VehicleParameters;

/// Wall time that a process may take to leave \[ns\].
const PATIENCE_NS: u64 = 10_000_000_000;

/// A sentence about a slot, for whoever follows the flight.
#[derive(Debug, Clone)]
pub struct News {
    /// What has happened.
    pub text: String,
    /// Something did not go as asked for.
    pub warning: bool,
}

/// What goes on around one slot's state machine.
#[derive(Debug, Default)]
struct Around {
    gate: Option<Gatekeeper>,
    /// The candidate that is being flown ahead.
    rehearsal: Option<Underway>,
    /// How much the candidate may differ, if not as the gate has it.
    max_bump: Option<f64>,
    /// Seats that somebody is to leave, or to take, by a wall-clock instant \[ns\].
    expected: Vec<(Seat, Expected, u64)>,
    /// Index of the swap that is going on.
    current: Option<usize>,
    /// By seat, index of the swap by which the process there has come to command.
    commanding: [Option<usize>; SEATS],
    /// Seats whose processes a fault of the script has struck.
    struck: Vec<Seat>,
    /// Of the consumer, as far as it has been told to the protocol.
    acknowledged: u64,
    refused_epoch: u64,
    fell_over: u64,
    tripped: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expected {
    Hello,
    Exit,
}

/// What the slots may use.
pub struct Means<'a> {
    /// Who does what is decided.
    pub posts: &'a mut dyn Posts,
    /// The wiring of the flight.
    pub graph: &'a Graph,
    /// What orders to pilot and injector make of the flight's plan.
    pub orders: &'a mut Planner,
    /// Logical time.
    pub now: Now,
    /// Host time \[ns\].
    pub now_mono_ns: u64,
    /// The flight has reached its end: whoever leaves does so in order.
    pub is_over: bool,
}

impl core::fmt::Debug for Means<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Means").field("now", &self.now).finish_non_exhaustive()
    }
}

/// All slots that have processes.
#[derive(Debug)]
pub struct Slots {
    machines: Machines,
    around: BTreeMap<Slot, Around>,
    consumers: Consumers,
    orders: Orders,
    /// How a service of this executable is started.
    pattern: Option<ChildSpec>,
    vehicle: VehicleParameters,
    rehearsing: Rehearsing,
    config: SlotConfig,
    /// Wall time that a process may take to say hello \[ns\].
    startup_ns: u64,
    mode: ClockMode,
    /// What came of each swap so far.
    pub reports: Vec<SwapReport>,
    /// What is still to be told.
    pub news: Vec<News>,
}

impl Slots {
    /// The slots of a flight of `scenario` whose first owners are `specs`, and where others have
    /// `startup_ns` of wall time to say hello.
    #[must_use]
    pub fn new(
        mode: ClockMode,
        specs: &[(Role, ChildSpec)],
        scenario: &Scenario,
        startup_ns: u64,
    ) -> Self {
        let config = slot_config(mode, scenario);
        let (vehicle, rehearsing) = (scenario.modelled_vehicle(), Rehearsing::of(scenario));
        let pattern = specs.first().map(|(_, spec)| spec.clone());
        let mut orders = Orders::default();
        orders.set_rehearses(rehearsing.is_enabled);
        let (mut machines, mut around) = (Machines::new(), BTreeMap::new());
        for slot in Slot::ALL {
            let spec = specs.iter().find(|(role, _)| *role == slot.role());
            let found = spec.and_then(|(_, spec)| Candidate::find(slot, &spec.name).ok());
            let Some(candidate) = found else { continue };
            let program = orders.program(Executable::new(candidate, None));
            orders.seat(slot, Seat::ALL[0], program);
            machines.insert(slot, slot::Slot::new(config, Seat::ALL[0], program));
            around.insert(slot, Around::default());
        }
        let (reports, news) = (Vec::new(), Vec::new());
        Self {
            machines,
            around,
            consumers: Consumers::default(),
            orders,
            pattern,
            vehicle,
            rehearsing,
            config,
            startup_ns,
            mode,
            reports,
            news,
        }
    }

    /// How a program is started.
    fn spec(&self, slot: Slot, program: Program) -> Option<ChildSpec> {
        let Executable { candidate, config, .. } = self.orders.executable(program)?;
        let pattern = self.pattern.clone()?;
        let name = candidate.name().to_owned();
        let config = config.clone();
        Some(match candidate {
            Candidate::Service(_) => {
                ChildSpec { name, launch: Launch::Service { config }, ..pattern }
            }
            Candidate::Executable(path) => {
                let launch = Launch::Foreign { slot, config };
                ChildSpec { name, executable: path.clone(), launch, ..pattern }
            }
        })
    }

    fn slot_of(&self, role: Role) -> Option<Slot> {
        self.machines.keys().copied().find(|slot| slot.role() == role)
    }

    /// How far a slot is: its stage, the instance that is under way, and until when \[ns\].
    pub fn progress(&self, role: Role) -> (&'static str, Option<String>, Option<u64>) {
        let slot = self.slot_of(role);
        let machine = slot.and_then(|slot| self.machines.get(&slot));
        let progress = machine.map_or(slot::Progress::Steady, slot::Slot::progress);
        let named = slot.zip(progress.seat()).map(|(slot, seat)| self.orders.name(slot, seat));
        (progress.label(), named, progress.until_ns())
    }

    /// True if a slot of this role has processes of its own.
    #[must_use]
    pub fn has(&self, role: Role) -> bool {
        self.slot_of(role).is_some()
    }

    /// Lockstep: whoever commands, or is about to, is started again in place when it dies, and time
    /// waits for it, so that a death from outside leaves no trace.
    #[must_use]
    pub fn keeps(&self, place: Place) -> bool {
        let machine = self.slot_of(place.role).and_then(|slot| self.machines.get(&slot));
        let Some(machine) = machine else { return true };
        let named = machine.record().is_some_and(|r| {
            u32::from(r.owner) == place.index
                || r.fallback.is_some_and(|seat| u32::from(seat) == place.index)
        });
        self.mode == ClockMode::Lockstep && named
    }

    /// Lockstep: the end of allowed time until the slots have had their say \[ns\].
    pub fn cap_ns(&self, allowed_ns: u64) -> u64 {
        let held = self.machines.values().any(slot::Slot::holds_time);
        let deadlines = self.machines.values().filter_map(slot::Slot::deadline_ns);
        let cap_ns = deadlines.chain(self.departures_ns()).min().unwrap_or(u64::MAX);
        if held { allowed_ns } else { cap_ns }
    }

    /// Instants from which seats are no longer taken whose processes have not gone yet \[ns\]. Time
    /// waits there: which seat is free for the next process must not depend on how long one takes to
    /// end.
    fn departures_ns(&self) -> impl Iterator<Item = u64> + '_ {
        let awaits_exit =
            |around: &Around| around.expected.iter().any(|(_, what, _)| *what == Expected::Exit);
        let slots = self.around.iter().filter(move |(_, around)| awaits_exit(around));
        slots.filter_map(|(slot, _)| Some(self.machines.get(slot)?.record()?.effective_ns))
    }

    /// Takes an order from outside, and answers it in the course of time.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn order(
        &mut self,
        asked: &Asked,
        answer: Answer,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        if let Asked::Order { order } = asked {
            self.give(order, &answer, means);
            return Ok(());
        }
        match self.orders.understand(asked, &self.machines) {
            Ok(None) => Ok(()),
            Ok(Some(ordered)) => self.request(&ordered, Some(answer), means),
            Err(refusal) => {
                answer.send(Reply::Refused(refusal));
                Ok(())
            }
        }
    }

    /// Takes an order of the script.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn script(&mut self, asked: &Asked, means: &mut Means<'_>) -> Result<(), FlightError> {
        match self.orders.understand(asked, &self.machines) {
            Ok(None) => Ok(()),
            Ok(Some(ordered)) => self.request(&ordered, None, means),
            Err(refusal) => {
                if let Asked::Swap(order) = asked
                    && let Some(slot) = Slot::named(&order.slot)
                {
                    let mut report =
                        SwapReport::new(slot, "", &order.to, means.now.logical_ns, true);
                    report.refuse(&refusal.text);
                    self.reports.push(report);
                }
                self.say(refusal.text, true);
                Ok(())
            }
        }
    }

    fn request(
        &mut self,
        ordered: &Ordered,
        answer: Option<Answer>,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let slot = ordered.slot;
        let (Some(machine), Some(around)) =
            (self.machines.get_mut(&slot), self.around.get_mut(&slot))
        else {
            return Ok(());
        };
        let from = machine.record().map(|record| record.owner);
        let actions = machine.on(means.now, Event::Request(ordered.request));
        let refused =
            actions.iter().any(|action| matches!(action, Action::Report(Report::Refused(_))));
        if let Request::Swap(target, _) = ordered.request {
            if around.current.is_none() || refused {
                let to = match target {
                    Target::New(program) => {
                        let executable = self.orders.executable(program);
                        executable.map_or("?", |e| e.candidate.name()).to_owned()
                    }
                    Target::Seated(seat) => self.orders.name(slot, seat),
                };
                let from = from.map_or(String::new(), |seat| self.orders.name(slot, seat));
                let at_ns = means.now.logical_ns;
                self.reports.push(SwapReport::new(slot, &from, &to, at_ns, answer.is_none()));
            }
            if refused {
                self.end_last(&actions);
            } else {
                around.current = Some(self.reports.len() - 1);
                around.max_bump = ordered.max_bump;
            }
        }
        if ordered.skips_rehearsal && !refused {
            self.skip_rehearsal(slot);
        }
        let (is_answered, told) = (answer.is_some(), self.news.len());
        if let Some(answer) = answer {
            self.orders.follow(ordered, &self.machines, &actions, answer);
        }
        self.carry_out(slot, actions, means)?;
        if refused && is_answered {
            // Whoever asked knows, and the flight is none the worse for it.
            self.news.iter_mut().skip(told).for_each(|news| news.warning = false);
        }
        if let (Request::Swap(Target::Seated(seat), _), Some(owner), false) =
            (ordered.request, from, refused)
        {
            // It has been there all along, and is handed nothing.
            let alike = self.machines.get(&slot).is_some_and(|m| m.are_alike(owner, seat));
            self.open_gate(slot, seat, alike, None, means);
        }
        Ok(())
    }

    /// Takes in everything that has happened; call once per round of the launcher's loop.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn tend(&mut self, means: &mut Means<'_>) -> Result<(), FlightError> {
        for seen in means.posts.take_seen() {
            self.see(&seen, means)?;
        }
        for event in means.posts.take_events() {
            self.hear(&event, means)?;
        }
        self.take_rehearsals(means)?;
        for slot in Slot::ALL {
            self.lose_patience(slot, means)?;
            let deadline_ns = self.machines.get(&slot).and_then(slot::Slot::deadline_ns);
            if deadline_ns.is_some_and(|at_ns| at_ns <= means.now.logical_ns) {
                self.tell(slot, Event::Time, means)?;
            }
        }
        Ok(())
    }

    /// Gives an event to the protocol and does what it wants done.
    fn tell(&mut self, slot: Slot, event: Event, means: &mut Means<'_>) -> Result<(), FlightError> {
        let Some(machine) = self.machines.get_mut(&slot) else { return Ok(()) };
        let actions = machine.on(means.now, event);
        self.carry_out(slot, actions, means)
    }

    fn carry_out(
        &mut self,
        slot: Slot,
        actions: Vec<Action>,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        actions.into_iter().try_for_each(|action| self.act(slot, action, means))
    }

    /// Expects something of a seat before patience is over.
    fn expect(&mut self, slot: Slot, seat: Seat, what: Expected, means: &Means<'_>) {
        let patience_ns = if what == Expected::Hello { self.startup_ns } else { PATIENCE_NS };
        if let Some(around) = self.around.get_mut(&slot) {
            around.expected.push((seat, what, means.now_mono_ns.saturating_add(patience_ns)));
        }
    }

    fn act(
        &mut self,
        slot: Slot,
        action: Action,
        means: &mut Means<'_>,
    ) -> Result<(), FlightError> {
        let role = slot.role();
        let place = |seat: Seat| Place { role, index: seat.into() };
        match action {
            Action::Spawn(seat, program) => {
                let Some(spec) = self.spec(slot, program) else { return Ok(()) };
                self.orders.seat(slot, seat, program);
                if let Some(around) = self.around.get_mut(&slot) {
                    around.struck.retain(|struck| *struck != seat);
                }
                self.expect(slot, seat, Expected::Hello, means);
                means.posts.spawn(place(seat), spec);
            }
            Action::Restart(seat, _) => {
                self.expect(slot, seat, Expected::Hello, means);
                means.posts.restart(place(seat))?;
            }
            Action::Publish(record) => {
                means.posts.announce(record.to_sample(role));
            }
            Action::HandOver { seat, state_of, join_ns, track_until_ns } => {
                let from = state_of.map(place);
                let state = from.and_then(|from| means.posts.last_state(from));
                let same = state_of.is_some_and(|of| of != seat);
                // In realtime a successor of the same kind runs what it has missed, from history.
                let catches_up = same && self.mode != ClockMode::Lockstep;
                let order = Handover {
                    join_ns: if catches_up { 0 } else { join_ns },
                    track_until_ns,
                    has_state: Flag::from(state.is_some()),
                    catches_up: Flag::from(catches_up),
                };
                let seating = seating::joined(&order, from.zip(state.as_ref()), join_ns);
                let state = state.map(|(_, bytes)| bytes).unwrap_or_default();
                means.posts.hand_over(place(seat), order, &state)?;
                self.tell_seating(slot, seat, seating, means);
                let tracks =
                    Tracks { needs_setpoint: role == Role::Attitude, until_ns: track_until_ns };
                self.open_gate(slot, seat, state_of.is_some(), Some(tracks), means);
            }
            Action::Judge(seat) => {
                let gate = self.around.get(&slot).and_then(|around| around.gate.as_ref());
                if let Some(verdict) = gate.map(Gatekeeper::verdict) {
                    return self.tell(slot, Event::Verdict(seat, verdict.map(Box::new)), means);
                }
            }
            Action::Rehearse(seat) => return self.rehearse(slot, seat, means),
            Action::AwaitExit(seat) => {
                self.expect(slot, seat, Expected::Exit, means);
            }
            Action::Kill(seat) => means.posts.kill(place(seat)),
            Action::Report(report) => self.report(slot, &report),
        }
        Ok(())
    }

    /// Begins to compare a candidate with the owner.
    fn open_gate(
        &mut self,
        slot: Slot,
        seat: Seat,
        same_kind: bool,
        tracks: Option<Tracks>,
        means: &Means<'_>,
    ) {
        let Some(machine) = self.machines.get(&slot) else { return };
        let Some(owner) = machine.record().map(|record| record.owner) else { return };
        if machine.candidate() != Some(seat) || owner == seat {
            return;
        }
        let yardstick = Yardstick::of(slot.role(), &self.vehicle);
        let Some(around) = self.around.get_mut(&slot) else { return };
        let mut limits = if same_kind { GateLimits::SAME_KIND } else { GateLimits::OTHER_KIND };
        if let Some(max_bump) = around.max_bump {
            limits = limits.within(max_bump);
        }
        let patient = self.mode != ClockMode::Lockstep;
        if patient {
            limits = limits.patient();
        }
        let now_ns = means.now.logical_ns;
        let tracks = tracks.filter(|tracks| !same_kind && tracks.until_ns > now_ns);
        let who = (u32::from(seat), u32::from(owner));
        let gate = Gatekeeper::new(yardstick, limits, who, tracks, patient);
        around.gate = Some(gate);
    }

    /// Seat that commands a slot by the newest record.
    #[must_use]
    pub fn owner_seat(&self, role: Role) -> Option<u32> {
        let machine = self.slot_of(role).and_then(|slot| self.machines.get(&slot));
        machine?.record().map(|record| record.owner.into())
    }

    /// Seats on which `name` sits, or `NAME@SEAT`; who commands comes first.
    #[must_use]
    pub fn seats_of(&self, name: &str) -> Vec<Place> {
        let mut places = Vec::new();
        for (slot, machine) in &self.machines {
            let named = |seat: &Seat| {
                let full = self.orders.name(*slot, *seat);
                let bare = full.rsplit_once('@').map(|(bare, _)| bare);
                machine.is_taken(*seat) && (full == name || bare == Some(name))
            };
            let seats = Seat::ALL.into_iter().filter(named);
            places.extend(seats.map(|seat| Place { role: slot.role(), index: seat.into() }));
        }
        places.sort_by_key(|place| self.owner_seat(place.role) != Some(place.index));
        places
    }

    /// A scripted fault: the process on a seat has been stopped, and is to be counted as silent.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn stopped(&mut self, place: Place, means: &mut Means<'_>) -> Result<(), FlightError> {
        let (Some(slot), Some(seat)) = (self.slot_of(place.role), Seat::new(place.index)) else {
            return Ok(());
        };
        self.lost(slot, seat, means);
        self.tell(slot, Event::Misbehaved(seat, Fault::Stalled), means)
    }
}

/// How the slots of a flight are supervised.
#[must_use]
fn slot_config(mode: ClockMode, scenario: &Scenario) -> SlotConfig {
    let config = match mode {
        ClockMode::Lockstep => SlotConfig::LOCKSTEP,
        _ => SlotConfig::REALTIME,
    };
    SlotConfig { keeps_fallback: scenario.settings().watch.fallback == Fallback::Auto, ..config }
}
