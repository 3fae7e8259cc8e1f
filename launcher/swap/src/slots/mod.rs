//! The slots of a flight: runs the swap protocol between processes, consumers and requests.
//!
//! The protocol itself is `slot::supervisor`, which knows neither processes nor clocks. This gives it
//! events (hellos, deaths, reports of consumers, time, requests) and does what it wants done.

mod actions;
mod adoption;
mod consumers;
mod events;
mod facts;
mod gatekeeper;
mod ledger;
mod messages;
mod pilot_orders;
mod posts;
mod rehearsal;
mod requests;
mod script;
mod seating;
mod trip_reason;
mod watch;

pub use ledger::write_table;
pub use ledger::{SwapEnd, SwapReport};
pub use posts::Posts;
pub use script::FAULT;
pub use script::Script;
pub use watch::{Seen, SlotWatch};

use crate::FlightError;
use crate::child::ChildSpec;
use crate::orders::{Executable, Machines, Orders};
use consumers::Consumers;
use gatekeeper::Gatekeeper;
use monitor::settings::Fallback;
use rehearsal::{Rehearsing, Underway};
use runtime::Graph;
use scenario::Scenario;
use scenario::candidate::Candidate;
use scenario::orders::Planner;
use shared_types::{ClockMode, Role, Seat as Place, Slot};
use slot::supervisor::{Event, Fault, Now, SlotConfig};
use slot::{Program, SEATS, Seat};
use std::collections::BTreeMap;
use vehicle::VehicleParameters;

/// Wall time that a process may take to leave \[ns\].
const EXIT_TIMEOUT_NS: u64 = 10_000_000_000;

/// A sentence about a slot, for the user who follows the flight.
#[derive(Debug, Clone)]
pub struct News {
    /// What has happened.
    pub text: String,
    /// Something did not go as asked for.
    pub warning: bool,
}

/// What is kept of a slot beside the state machine of its protocol.
#[derive(Debug, Default)]
struct SlotState {
    gate: Option<Gatekeeper>,
    /// The candidate that is being flown ahead.
    rehearsal: Option<Underway>,
    /// How much the candidate may differ, if not as the gate has it.
    max_bump: Option<f64>,
    /// Seats that a process is to leave, or to take, by a wall-clock instant \[ns\].
    expected: Vec<(Seat, Expected, u64)>,
    /// Index of the swap that is going on.
    current: Option<usize>,
    /// By seat, index of the swap by which the process there has come to command.
    commanding: [Option<usize>; SEATS],
    /// Seats whose processes a fault of the script has struck.
    struck: Vec<Seat>,
    /// The seat that the monitor has tripped last, and the epoch of the record by which its process was judged.
    tripped_owner: Option<(Seat, u64)>,
    /// Of the consumer, as far as the protocol has been given it.
    acknowledged: u64,
    refused_epoch: u64,
    failed_over: u64,
    tripped: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expected {
    Hello,
    Exit,
}

/// What of the flight the slots see and act on in one round.
pub struct SlotContext<'a> {
    /// Does what is decided.
    pub posts: &'a mut dyn Posts,
    /// The wiring of the flight.
    pub graph: &'a Graph,
    /// What orders to pilot and injector make of the flight's plan.
    pub orders: &'a mut Planner,
    /// Logical time.
    pub now: Now,
    /// Host time \[ns\].
    pub now_mono_ns: u64,
    /// The flight has reached its end: a process that leaves does so in order.
    pub is_over: bool,
    /// For how long the monitor has not stepped, if that is too long for a new owner to be watched \[ns\].
    pub monitor_silent_ns: Option<u64>,
}

impl core::fmt::Debug for SlotContext<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("SlotContext").field("now", &self.now).finish_non_exhaustive()
    }
}

/// All slots that have processes.
#[derive(Debug)]
pub struct Slots {
    machines: Machines,
    /// What each slot begins with.
    homes: BTreeMap<Slot, Program>,
    states: BTreeMap<Slot, SlotState>,
    consumers: Consumers,
    orders: Orders,
    /// How a service of this executable is started.
    pattern: Option<ChildSpec>,
    vehicle: VehicleParameters,
    rehearsing: Rehearsing,
    config: SlotConfig,
    /// Wall time that a process may take to send its hello \[ns\].
    startup_ns: u64,
    mode: ClockMode,
    /// What came of each swap so far.
    pub reports: Vec<SwapReport>,
    /// What is still to be reported.
    pub news: Vec<News>,
}

impl Slots {
    /// The slots of a flight of `scenario` whose first owners are `specs`, and where others have
    /// `startup_ns` of wall time to send their hello.
    #[must_use]
    pub fn new(
        mode: ClockMode,
        specs: &[(Role, ChildSpec)],
        scenario: &Scenario,
        startup_ns: u64,
    ) -> Self {
        let config = slot_config(mode, scenario);
        let (vehicle, rehearsing) = (scenario.modelled_vehicle(), Rehearsing::of(scenario));
        // Not with the pause that disorder has given the first of them.
        let pattern = specs.first().map(|(_, spec)| ChildSpec { pause_ns: 0, ..spec.clone() });
        let mut orders = Orders::default();
        orders.set_rehearses(rehearsing.is_enabled);
        let takes_turns = mode == ClockMode::Lockstep && !scenario.settings().timing.is_empty();
        orders.set_services_only(takes_turns);
        let (mut machines, mut states) = (Machines::new(), BTreeMap::new());
        let mut homes = BTreeMap::new();
        for slot in Slot::ALL {
            let spec = specs.iter().find(|(role, _)| *role == slot.role());
            let found = spec.and_then(|(_, spec)| Candidate::find(slot, &spec.name).ok());
            let Some(candidate) = found else { continue };
            let program = orders.program(Executable::new(candidate, None));
            orders.seat(slot, Seat::ALL[0], program);
            homes.insert(slot, program);
            machines.insert(slot, slot::SlotMachine::new(config, Seat::ALL[0], program));
            states.insert(slot, SlotState::default());
        }
        let (reports, news) = (Vec::new(), Vec::new());
        Self {
            machines,
            homes,
            states,
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

    fn slot_of(&self, role: Role) -> Option<Slot> {
        self.machines.keys().copied().find(|slot| slot.role() == role)
    }

    /// How far a slot is: its stage, the instance that is under way, and until when \[ns\].
    pub fn progress(&self, role: Role) -> (&'static str, Option<String>, Option<u64>) {
        let slot = self.slot_of(role);
        let machine = slot.and_then(|slot| self.machines.get(&slot));
        let progress = machine.map_or(slot::Progress::Steady, slot::SlotMachine::progress);
        let named = slot.zip(progress.seat()).map(|(slot, seat)| self.orders.name(slot, seat));
        (progress.label(), named, progress.until_ns())
    }

    /// True if a slot of this role has processes of its own.
    #[must_use]
    pub fn has(&self, role: Role) -> bool {
        self.slot_of(role).is_some()
    }

    /// True if the process of a seat is started again in place when it dies: always outside of the slots. Within, only
    /// in lockstep, where time waits for it so that a death from outside leaves no trace, and only the owner or its
    /// fallback.
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

    /// Lockstep: the end of allowed time until the slots have decided \[ns\].
    pub fn cap_ns(&self, allowed_ns: u64) -> u64 {
        let deadlines = self.machines.values().filter_map(slot::SlotMachine::deadline_ns);
        let cap_ns = deadlines.chain(self.departures_ns()).min().unwrap_or(u64::MAX);
        if self.holds_time() { allowed_ns } else { cap_ns }
    }

    /// Lockstep: time stands still until a process has come, or a candidate has been judged.
    #[must_use]
    pub fn holds_time(&self) -> bool {
        let waits = self.machines.values().any(slot::SlotMachine::holds_time);
        self.mode == ClockMode::Lockstep && waits
    }

    /// Instants from which seats with processes that have not gone yet are no longer taken \[ns\]. Time
    /// waits there: which seat is free for the next process must not depend on how long one takes to
    /// end.
    fn departures_ns(&self) -> impl Iterator<Item = u64> + '_ {
        let awaits_exit =
            |state: &SlotState| state.expected.iter().any(|(_, what, _)| *what == Expected::Exit);
        let slots = self.states.iter().filter(move |(_, state)| awaits_exit(state));
        slots.filter_map(|(slot, _)| Some(self.machines.get(slot)?.record()?.effective_ns))
    }

    /// Takes in everything that has happened; call once per round of the launcher's loop.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn tend(&mut self, context: &mut SlotContext<'_>) -> Result<(), FlightError> {
        for seen in context.posts.take_seen() {
            self.see(&seen, context)?;
        }
        for event in context.posts.take_events() {
            self.take_event(&event, context)?;
        }
        self.take_claim(context.now.logical_ns, context)?;
        self.take_rehearsals(context)?;
        for slot in Slot::ALL {
            self.check_timeouts(slot, context)?;
            if slot == Slot::Position && self.is_time_up(slot, context.now) {
                // A window is not closed over what is said against the new owner.
                self.take_claim(u64::MAX, context)?;
            }
            if self.is_time_up(slot, context.now) {
                self.feed(slot, Event::Time, context)?;
            }
        }
        Ok(())
    }

    fn is_time_up(&self, slot: Slot, now: Now) -> bool {
        let deadline_ns = self.machines.get(&slot).and_then(slot::SlotMachine::deadline_ns);
        deadline_ns.is_some_and(|at_ns| at_ns <= now.logical_ns)
    }

    /// Feeds an event to the protocol and does what it wants done.
    fn feed(
        &mut self,
        slot: Slot,
        event: Event,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let Some(machine) = self.machines.get_mut(&slot) else { return Ok(()) };
        let actions = machine.on(context.now, event);
        self.carry_out(slot, actions, context)
    }

    /// Seat that commands a slot by the newest record.
    #[must_use]
    pub fn owner_seat(&self, role: Role) -> Option<u32> {
        let machine = self.slot_of(role).and_then(|slot| self.machines.get(&slot));
        machine?.record().map(|record| record.owner.into())
    }

    /// Seats on which `name` sits, or `NAME@SEAT`; the one that commands comes first.
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

    /// The monitor hangs: owners that are to be watched make room for those that need not be.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn unwatched(&mut self, context: &mut SlotContext<'_>) -> Result<(), FlightError> {
        Slot::ALL.into_iter().try_for_each(|slot| self.feed(slot, Event::Unwatched, context))
    }

    /// A scripted fault: the process on a seat has been stopped, and is to be counted as silent.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn stopped(
        &mut self,
        place: Place,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let (Some(slot), Some(seat)) = (self.slot_of(place.role), Seat::new(place.index)) else {
            return Ok(());
        };
        self.lost(slot, seat, context);
        self.feed(slot, Event::Misbehaved(seat, Fault::Stalled), context)
    }
}

/// How the slots of a flight are supervised.
#[must_use]
fn slot_config(mode: ClockMode, scenario: &Scenario) -> SlotConfig {
    let config = match mode {
        ClockMode::Lockstep => SlotConfig::LOCKSTEP,
        _ => SlotConfig::REALTIME,
    };
    SlotConfig { keeps_fallback: scenario.settings().monitor.fallback == Fallback::Auto, ..config }
}
