//! Slots that are found in flight: as the last record has them, with the processes that are still there.

use super::consumers::Consumers;
use super::facts::{command_latency_ns, millihertz};
use super::rehearsal::Rehearsing;
use super::{Machines, SlotContext, SlotState, Slots, slot_config};
use crate::child::{ChildSpec, Launch};
use crate::orders::{Executable, Orders};
use crate::{FlightError, PostNote};
use scenario::Scenario;
use scenario::candidate::Candidate;
use scenario::services::Assignment;
use shared_types::{ClockMode, OwnerRecord, Seat as Place, Slot};
use slot::record::Record;
use slot::supervisor::Instance;
use slot::{Program, SEATS, Seat};
use std::collections::BTreeMap;

impl Slots {
    /// No slots yet; services are started as those in `posts` have been.
    #[must_use]
    pub fn none_yet(posts: &[PostNote], scenario: &Scenario, startup_ns: u64) -> Self {
        let is_service = |spec: &&ChildSpec| matches!(spec.launch, Launch::Service { .. });
        let pattern = posts.iter().map(|post| &post.spec).find(is_service);
        let rehearsing = Rehearsing::of(scenario);
        let mut orders = Orders::default();
        orders.set_rehearses(rehearsing.is_enabled);
        let assignment = Assignment::of(scenario.settings());
        let homes = Slot::ALL.map(|slot| {
            let candidate = Candidate::Service(assignment.name(slot.role()));
            (slot, orders.program(Executable::new(candidate, None)))
        });
        Self {
            machines: Machines::new(),
            homes: BTreeMap::from(homes),
            states: BTreeMap::new(),
            consumers: Consumers::default(),
            orders,
            pattern: pattern.map(|spec| ChildSpec { pause_ns: 0, ..spec.clone() }),
            vehicle: scenario.modelled_vehicle(),
            rehearsing,
            config: slot_config(ClockMode::Realtime, scenario),
            startup_ns,
            mode: ClockMode::Realtime,
            reports: Vec::new(),
            news: Vec::new(),
        }
    }

    /// Goes on with a slot from its last record. `posts` gives what was started for which seat,
    /// `living` which processes are there, with layout and period \[ns\].
    ///
    /// # Errors
    /// [`FlightError`] if a process that is missing cannot be started.
    pub fn take_over(
        &mut self,
        record: &OwnerRecord,
        posts: &[PostNote],
        living: &[(Place, u64, u64)],
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let Some(slot) = Slot::ALL.into_iter().find(|slot| slot.role() == record.slot) else {
            return Ok(());
        };
        let mut programs: [Option<Program>; SEATS] = [None; SEATS];
        for post in posts.iter().filter(|post| post.place().role == slot.role()) {
            let Some(seat) = Seat::new(post.seat) else { continue };
            let Some(executable) = executable(slot, &post.spec) else { continue };
            let program = self.orders.program(executable);
            self.orders.seat(slot, seat, program);
            programs[seat.index()] = Some(program);
        }
        let Some(record) = Record::read(record) else { return Ok(()) };
        // Without a process to command it a slot does not change hands: the pilot holds it.
        let Some(owner) = programs[record.owner.index()] else { return Ok(()) };
        let mut seated = [None; SEATS];
        for &(place, layout, period_ns) in living {
            let Some(seat) = Seat::new(place.index).filter(|_| place.role == slot.role()) else {
                continue;
            };
            let instance = Instance {
                layout,
                millihertz: millihertz(context.graph, place.role, period_ns),
                latency_ns: command_latency_ns(context.graph, place.role),
            };
            seated[seat.index()] = programs[seat.index()].map(|program| (program, instance));
        }
        let config = self.config;
        let home = self.homes.get(&slot).copied().unwrap_or(owner);
        let (machine, actions) =
            slot::SlotMachine::adopt(config, context.now, &record, [owner, home], seated);
        self.machines.insert(slot, machine);
        self.states.insert(slot, SlotState::default());
        self.carry_out(slot, actions, context)
    }
}

/// What a process was started from.
fn executable(slot: Slot, spec: &ChildSpec) -> Option<Executable> {
    let (candidate, config) = match &spec.launch {
        Launch::Service { config } => (Candidate::find(slot, &spec.name).ok()?, config),
        Launch::Foreign { config, .. } => (Candidate::Executable(spec.executable.clone()), config),
    };
    Some(Executable::new(candidate, config.clone()))
}
