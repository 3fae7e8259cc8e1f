//! What the swap protocol wants done, done.

use super::facts::CommandScale;
use super::gatekeeper::{Gatekeeper, Tracks};
use super::{EXIT_TIMEOUT_NS, Expected, SlotContext, Slots, seating};
use crate::FlightError;
use crate::child::{ChildSpec, Launch};
use crate::orders::Executable;
use runtime::StateHeader;
use scenario::candidate::Candidate;
use shared_types::{ClockMode, Flag, Handover, Role, Seat as Place, Slot};
use slot::gate::GateLimits;
use slot::supervisor::{Event, Instance};
use slot::{Action, Program, Seat};

impl Slots {
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

    pub(super) fn carry_out(
        &mut self,
        slot: Slot,
        actions: Vec<Action>,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        actions.into_iter().try_for_each(|action| self.act(slot, action, context))
    }

    /// Expects something of a seat before a timeout.
    fn expect(&mut self, slot: Slot, seat: Seat, what: Expected, context: &SlotContext<'_>) {
        let timeout_ns = if what == Expected::Hello { self.startup_ns } else { EXIT_TIMEOUT_NS };
        if let Some(state) = self.states.get_mut(&slot) {
            state.expected.push((seat, what, context.now_mono_ns.saturating_add(timeout_ns)));
        }
    }

    fn act(
        &mut self,
        slot: Slot,
        action: Action,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let role = slot.role();
        let place = |seat: Seat| Place { role, index: seat.into() };
        match action {
            Action::Spawn(seat, program) => {
                let Some(spec) = self.spec(slot, program) else { return Ok(()) };
                self.orders.seat(slot, seat, program);
                if let Some(state) = self.states.get_mut(&slot) {
                    state.struck.retain(|struck| *struck != seat);
                }
                self.expect(slot, seat, Expected::Hello, context);
                context.posts.spawn(place(seat), spec);
            }
            Action::Restart(seat, _) => {
                self.expect(slot, seat, Expected::Hello, context);
                context.posts.restart(place(seat))?;
            }
            Action::Publish(record) => {
                context.posts.announce(record.to_sample(role));
            }
            Action::HandOver { seat, state_of, join_ns, track_until_ns } => {
                return self.hand_over(slot, (seat, state_of), (join_ns, track_until_ns), context);
            }
            Action::Judge(seat) => {
                let gate = self.states.get(&slot).and_then(|state| state.gate.as_ref());
                if let Some(verdict) = gate.map(Gatekeeper::verdict) {
                    return self.feed(slot, Event::Verdict(seat, verdict.map(Box::new)), context);
                }
            }
            Action::Rehearse(seat) => return self.rehearse(slot, seat, context),
            Action::AwaitExit(seat) => {
                self.expect(slot, seat, Expected::Exit, context);
            }
            Action::Kill(seat) => context.posts.kill(place(seat)),
            Action::Report(report) => self.report(slot, &report),
        }
        Ok(())
    }

    /// Lets the process on a seat begin at an instant \[ns\], from the last state of a seat if it is one of its kind, and
    /// track until another.
    fn hand_over(
        &mut self,
        slot: Slot,
        (seat, state_of): (Seat, Option<Seat>),
        (join_ns, track_until_ns): (u64, u64),
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let role = slot.role();
        let place = |seat: Seat| Place { role, index: seat.into() };

        let instance = self.machines.get(&slot).and_then(|machine| machine.instance(seat));
        let from = state_of.map(place);
        let state = from.and_then(|from| context.posts.last_state(from));
        // One that died before its first state has left that of another that sat there before.
        let is_of_kind =
            |state: &[u8]| instance.is_some_and(|i| StateHeader::has_layout(state, i.layout));
        let state = state.filter(|(_, bytes)| is_of_kind(bytes));
        // From nothing, it first sees what is applied.
        let period_ns = instance.filter(|_| state.is_none()).map_or(0, Instance::period_ns);
        let track_until_ns = track_until_ns.max(join_ns.saturating_add(period_ns));
        let has_state = state.is_some();
        let same = has_state && state_of.is_some_and(|of| of != seat);
        // In realtime a successor of the same kind runs what it has missed, from history.
        let catches_up = same && self.mode != ClockMode::Lockstep;
        let order = Handover {
            join_ns: if catches_up { 0 } else { join_ns },
            track_until_ns,
            has_state: Flag::from(has_state),
            catches_up: Flag::from(catches_up),
            ..Handover::default()
        };
        let seating = seating::joined(&order, from.zip(state.as_ref()), join_ns);
        let state = state.map(|(_, bytes)| bytes).unwrap_or_default();
        context.posts.hand_over(place(seat), order, &state)?;
        self.record_seating(slot, seat, seating, context);
        let tracks = Tracks { needs_setpoint: role == Role::Attitude, until_ns: track_until_ns };
        self.open_gate(slot, seat, has_state, Some(tracks), context);
        Ok(())
    }

    /// Begins to compare a candidate with the owner.
    pub(super) fn open_gate(
        &mut self,
        slot: Slot,
        seat: Seat,
        same_kind: bool,
        tracks: Option<Tracks>,
        context: &SlotContext<'_>,
    ) {
        let Some(machine) = self.machines.get(&slot) else { return };
        let Some(owner) = machine.record().map(|record| record.owner) else { return };
        if machine.candidate() != Some(seat) || owner == seat {
            return;
        }
        let scale = CommandScale::of(slot, &self.vehicle);
        let Some(state) = self.states.get_mut(&slot) else { return };
        let mut limits = if same_kind { GateLimits::SAME_KIND } else { GateLimits::OTHER_KIND };
        if let Some(max_bump) = state.max_bump {
            limits = limits.within(max_bump);
        }
        let patient = self.mode != ClockMode::Lockstep;
        if patient {
            limits = limits.patient();
        }
        let now_ns = context.now.logical_ns;
        let tracks = tracks.filter(|tracks| !same_kind && tracks.until_ns > now_ns);
        let seats = (u32::from(seat), u32::from(owner));
        let gate = Gatekeeper::new(scale, limits, seats, tracks, patient);
        state.gate = Some(gate);
    }
}
