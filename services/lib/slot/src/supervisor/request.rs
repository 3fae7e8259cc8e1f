//! What users and scripts ask for.

use super::instances::{InstanceState, Program};
use super::message::{Action, Now, Request, SwapTerms, Target};
use super::reason::Reason;
use super::report::{Outcome, Report};
use super::{Goal, Phase, SlotMachine, Stage, Standby};
use crate::record::Seat;

impl SlotMachine {
    pub(super) fn request(&mut self, now: Now, request: Request, out: &mut Vec<Action>) {
        let done = match request {
            Request::Swap(target, order) => self.swap(now, target, order, out),
            Request::Rollback => self.roll_back(now, out),
            Request::Retire(seat) => self.retire(now, seat, out),
            Request::Standby(program, shadow_ns, rehearse) => {
                self.stand_by(program, shadow_ns, rehearse, out)
            }
        };
        if let Err(reason) = done {
            out.push(Action::Report(Report::Refused(reason)));
        }
    }

    /// Nothing else may be going on.
    fn be_at_rest(&self) -> Result<(), Reason> {
        match self.phase {
            Phase::Steady { .. } => Ok(()),
            Phase::Ownerless { seat, .. } => Err(Reason::Ownerless(seat)),
            Phase::Joining { seat, .. } | Phase::Shadowing { seat, .. } => Err(Reason::Busy(seat)),
            Phase::Flipping { new, .. } | Phase::Window { new, .. } => Err(Reason::Busy(new)),
            Phase::Reverting { from, .. } => Err(Reason::Busy(from)),
        }
    }

    fn swap(
        &mut self,
        now: Now,
        target: Target,
        order: SwapTerms,
        out: &mut Vec<Action>,
    ) -> Result<(), Reason> {
        self.be_at_rest()?;
        let goal = Goal::Swap(order);
        match target {
            Target::New(program) => self.spawn(program, goal, out),
            Target::Seated(seat) if self.ledger.owner() == Some(seat) => {
                Err(Reason::AlreadyOwns(seat))
            }
            Target::Seated(seat) if !self.instances.is_seated(seat) => {
                Err(Reason::VacantSeat(seat))
            }
            Target::Seated(seat) => {
                // It has been shadowing all along, on its own.
                let track_until_ns = now.logical_ns;
                let until_ns = now.logical_ns.saturating_add(order.shadow_ns);
                let stage = Stage::Free;
                self.phase = Phase::Shadowing { seat, goal, track_until_ns, until_ns, stage };
                Ok(())
            }
        }
    }

    fn spawn(&mut self, program: Program, goal: Goal, out: &mut Vec<Action>) -> Result<(), Reason> {
        let seat = self.instances.free().ok_or(Reason::NoFreeSeat)?;
        self.untrusted[seat.index()] = false;
        self.instances.set(seat, InstanceState::Starting(program));
        self.phase = Phase::Joining { seat, goal };
        out.push(Action::Spawn(seat, program));
        Ok(())
    }

    fn roll_back(&mut self, now: Now, out: &mut Vec<Action>) -> Result<(), Reason> {
        match self.phase {
            Phase::Flipping { new, old, .. } | Phase::Window { new, old, .. }
                if self.instances.is_seated(old) =>
            {
                out.push(Action::Report(Report::Aborted(new, Reason::RolledBack)));
                self.revert(now, new, old, true, out);
                Ok(())
            }
            Phase::Joining { seat, .. } | Phase::Shadowing { seat, .. } => {
                Err(Reason::NotInCommand(seat))
            }
            _ => Err(Reason::NothingToRollBack),
        }
    }

    fn retire(&mut self, now: Now, seat: Seat, out: &mut Vec<Action>) -> Result<(), Reason> {
        if !matches!(
            self.instances.state(seat),
            InstanceState::Seated(..) | InstanceState::Starting(_)
        ) {
            return Err(Reason::VacantSeat(seat));
        }
        match self.phase {
            Phase::Ownerless { seat: owner, .. } if owner == seat => {
                return Err(Reason::OwnsTheSlot(seat));
            }
            Phase::Joining { seat: candidate, goal }
            | Phase::Shadowing { seat: candidate, goal, .. }
                if candidate == seat =>
            {
                // A standby that is sent away shall not come back.
                let stays = |standby: &Standby| {
                    standby.seat != Some(seat) && !matches!(goal, Goal::Standby { .. })
                };
                self.standby = self.standby.filter(stays);
                self.abort(now, seat, Reason::Retired, out);
            }
            _ if self.ledger.owner() == Some(seat) => return Err(Reason::OwnsTheSlot(seat)),
            Phase::Window { new, old, .. } if old == seat => {
                self.commit(now, (new, old), false, out);
            }
            // It leaves by itself in a moment.
            Phase::Reverting { from, .. } if from == seat => {}
            Phase::Flipping { new, .. } => return Err(Reason::Busy(new)),
            _ => {
                self.standby = self.standby.filter(|standby| standby.seat != Some(seat));
                self.dismiss(seat, out);
                if let Some(owner) =
                    self.ledger.owner().filter(|seat| self.instances.is_seated(*seat))
                {
                    self.publish(now, owner, None, out);
                }
            }
        }
        out.push(Action::Report(Report::Done(seat, Outcome::Retired)));
        Ok(())
    }

    fn stand_by(
        &mut self,
        program: Program,
        shadow_ns: u64,
        rehearse: bool,
        out: &mut Vec<Action>,
    ) -> Result<(), Reason> {
        if let Some(seat) = self.standby.and_then(|standby| standby.seat) {
            return Err(Reason::StandbyExists(seat));
        }
        self.be_at_rest()?;
        if let Some(owner) = self.ledger.owner().filter(|owner| !self.is_trusted(*owner))
            && !program.is_trusted
        {
            return Err(Reason::UntrustedStandby(owner));
        }
        self.spawn(program, Goal::Standby { shadow_ns, rehearse }, out)?;
        self.standby = Some(Standby {
            program,
            shadow_ns,
            rehearse,
            automatic: false,
            seat: None,
            losses: 0,
            proven: false,
            refused: false,
        });
        Ok(())
    }

    /// The standby that is wanted and missing; without a free seat, when there is one.
    pub(super) fn start_standby(&mut self, out: &mut Vec<Action>) {
        self.phase = Phase::Steady { rejoin_ns: None };
        if let Some(Standby { program, shadow_ns, rehearse, seat: None, proven, .. }) = self.standby
        {
            // What has stood by once need not be flown ahead again.
            let goal = Goal::Standby { shadow_ns, rehearse: rehearse && !proven };
            // A seat that is being left becomes free with a death, which comes back here.
            let _ = self.spawn(program, goal, out);
        }
    }
}
