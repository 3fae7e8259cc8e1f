//! What happens when a process is lost.

use super::instances::InstanceState;
use super::message::{Action, Now};
use super::reason::{Fault, Reason};
use super::report::{Report, Step};
use super::{Phase, SlotMachine, Useless, step};
use crate::record::Seat;

/// An owner that is lost so soon after it was started again is not started a third time \[ns\]; one that is not trusted
/// never is.
const RELAPSE_NS: u64 = 5_000_000_000;

impl SlotMachine {
    /// A process is gone.
    pub(super) fn died(&mut self, now: Now, seat: Seat, out: &mut Vec<Action>) {
        let state = *self.instances.state(seat);
        self.instances.set(seat, InstanceState::Free);
        match state {
            InstanceState::Free => return,
            InstanceState::Starting(program) | InstanceState::Seated(program, _) => {
                self.lost(now, seat, Fault::Died, now.logical_ns, out);
                self.remember_program(seat, program);
            }
            InstanceState::Leaving(_) => step(out, Step::Left(seat)),
            InstanceState::Dying(program) => self.remember_program(seat, program),
        }
        self.reap(now, seat);
    }

    /// An owner that is to be started again keeps its seat.
    fn remember_program(&mut self, seat: Seat, program: super::Program) {
        if matches!(self.phase, Phase::Ownerless { seat: owner, .. } if owner == seat) {
            self.instances.set(seat, InstanceState::Dying(program));
        }
    }

    /// The dead process has left its seat: what waited for that can go on.
    fn reap(&mut self, now: Now, seat: Seat) {
        match &mut self.phase {
            Phase::Ownerless { seat: owner, at_ns } if *owner == seat => {
                *at_ns = Some(now.logical_ns.saturating_add(self.config.restart_ns));
            }
            Phase::Steady { rejoin_ns: None } => self.settle(now.logical_ns),
            _ => {}
        }
    }

    /// A process is there and of no use.
    pub(super) fn misbehaved(&mut self, now: Now, seat: Seat, fault: Fault, out: &mut Vec<Action>) {
        if matches!(
            self.instances.state(seat),
            InstanceState::Starting(_) | InstanceState::Seated(..)
        ) {
            self.kill(seat, out);
            self.lost(now, seat, fault, now.logical_ns, out);
        } else if matches!(self.instances.state(seat), InstanceState::Leaving(_)) {
            self.kill(seat, out);
        }
    }

    /// The consumer left the owner of `epoch` for the fallback. The owner may still run, as one that commands what is
    /// no number does: it leaves in order, so that what it publishes until then is the same in every flight.
    pub(super) fn failed_over(&mut self, now: Now, epoch: u64, at_ns: u64, out: &mut Vec<Action>) {
        let Some(seat) = self.ledger.owner_of(epoch) else { return };
        // A process that sits there since has nothing to do with it.
        let there = self.instances.is_seated(seat) && self.instances.since(seat) <= epoch;
        if there {
            if self.fallback(seat).is_some() {
                self.dismiss(seat, out);
            } else {
                // By its record it stays the owner, and would not leave.
                self.kill(seat, out);
            }
            self.lost(now, seat, Fault::Silent, at_ns, out);
        }
    }

    /// The monitor found the owner of `epoch` about to lose the vehicle. A fallback commands from
    /// `at_ns` on, and the owner, which still runs, leaves in order: when that is seen changes nothing
    /// in the flight. Without a fallback the owner is dealt with like one that is of no use.
    pub(super) fn tripped(&mut self, now: Now, epoch: u64, at_ns: u64, out: &mut Vec<Action>) {
        let Some(seat) = self.ledger.owner_of(epoch) else { return };
        if self.ledger.owner() != Some(seat)
            || !self.instances.is_seated(seat)
            || self.instances.since(seat) > epoch
        {
            return;
        }
        if self.fallback(seat).is_some() {
            self.dismiss(seat, out);
            self.lost(now, seat, Fault::Tripped, at_ns, out);
        } else if self.useless.is_none() {
            let due_ns = at_ns.saturating_add(self.config.react_ns);
            let epoch = self.ledger.epoch();
            self.useless = Some(Useless { seat, epoch, fault: Fault::Tripped, due_ns });
        }
    }

    /// Nothing watches the owner any more. One that is to be watched leaves in order for a fallback that has proven
    /// itself; without such a one it stays, because it may well be sound.
    pub(super) fn unwatched(&mut self, now: Now, out: &mut Vec<Action>) {
        let owner = self.ledger.owner().filter(|owner| self.is_watched(*owner));
        let Some(seat) = owner.filter(|seat| self.instances.is_seated(*seat)) else { return };
        let heir = self.fallback(seat).filter(|heir| self.is_trusted(*heir));
        // One that is being taken back has not.
        if heir.is_some() && !matches!(self.phase, Phase::Reverting { .. }) {
            self.dismiss(seat, out);
            self.lost(now, seat, Fault::Unwatched, now.logical_ns, out);
        }
    }

    /// The consumer has been on its own for a while.
    pub(super) fn unguided(&mut self, epoch: u64, since_ns: u64, at_ns: u64) {
        let Some(seat) = self.ledger.owner().filter(|_| self.ledger.epoch() == epoch) else {
            return;
        };
        let timeout_ns = self.config.unguided_ns.saturating_add(3 * self.instances.period_ns(seat));
        let alone = self.instances.is_seated(seat) && self.useless.is_none();
        // An owner that has just been given the slot has all its time.
        let since_ns = since_ns.max(self.ledger.effective_ns());
        if alone && at_ns.saturating_sub(since_ns) >= timeout_ns {
            let due_ns = at_ns.saturating_add(self.config.react_ns);
            self.useless = Some(Useless { seat, epoch, fault: Fault::Silent, due_ns });
        }
    }

    /// An owner that gives nothing to follow makes room for one that does, unless things have changed.
    pub(super) fn clear_seat(&mut self, now: Now, useless: Useless, out: &mut Vec<Action>) {
        let Useless { seat, epoch, fault, due_ns } = useless;
        if self.ledger.epoch() == epoch && self.instances.is_seated(seat) {
            self.kill(seat, out);
            self.lost(now, seat, fault, due_ns, out);
        }
    }

    /// A process that was starting or seated is out; its state shows this already.
    fn lost(&mut self, now: Now, seat: Seat, fault: Fault, at_ns: u64, out: &mut Vec<Action>) {
        let stood_by = self.standby.is_some_and(|standby| standby.seat == Some(seat));
        self.forget_standby(seat);
        let was_outgoing = self.outgoing.take_if(|outgoing| outgoing.seat == seat).is_some();
        if stood_by {
            step(out, Step::StandbyLost(seat, fault));
        }
        let owner = self.ledger.owner();
        match self.phase {
            Phase::Ownerless { .. } => {}
            Phase::Joining { seat: candidate, .. } | Phase::Shadowing { seat: candidate, .. }
                if candidate == seat =>
            {
                self.abort(now, seat, Reason::Fault(fault), out);
            }
            // The newest record is already another's; without it there is no window.
            Phase::Flipping { new, old, .. } if old == seat => {
                step(out, Step::FallbackLost { seat, owner: new, fault });
            }
            Phase::Window { new, old, .. } if old == seat => {
                step(out, Step::FallbackLost { seat, owner: new, fault });
                self.commit(now, (new, old), true, out);
            }
            Phase::Reverting { from, .. } if from == seat => {
                self.reverted(now, at_ns, out);
            }
            _ if owner == Some(seat) => self.owner_lost(now, seat, fault, at_ns, out),
            Phase::Steady { .. } if stood_by => {
                self.settle(at_ns);
                self.count_standby_loss(false, out);
                self.republish(now, at_ns, out);
            }
            _ if stood_by || was_outgoing => self.republish(now, at_ns, out),
            _ => {}
        }
    }

    /// Publishes the same owner again, without the process that has been lost.
    fn republish(&mut self, now: Now, at_ns: u64, out: &mut Vec<Action>) {
        if let Some(owner) = self.ledger.owner().filter(|seat| self.instances.is_seated(*seat)) {
            self.publish(now, owner, Some(at_ns), out);
        }
    }

    fn owner_lost(
        &mut self,
        now: Now,
        seat: Seat,
        fault: Fault,
        at_ns: u64,
        out: &mut Vec<Action>,
    ) {
        let heir = self.fallback(seat);
        match self.phase {
            Phase::Joining { seat: candidate, .. } | Phase::Shadowing { seat: candidate, .. } => {
                // No owner is left to compare it with, unless it has been judged before.
                if heir != Some(candidate) {
                    self.kill(candidate, out);
                }
                out.push(Action::Report(Report::Aborted(candidate, Reason::OwnerLost)));
            }
            Phase::Flipping { new, .. } | Phase::Window { new, .. } if new == seat => {
                out.push(Action::Report(Report::Aborted(new, Reason::Fault(fault))));
            }
            Phase::Reverting { to, .. } => {
                out.push(Action::Report(Report::Aborted(to, Reason::Fault(fault))));
            }
            _ => {}
        }
        if let Some(heir) = heir {
            let is_trusted = self.is_trusted(heir);
            self.standby.take_if(|standby| standby.automatic && is_trusted);
            self.forget_standby(heir);
            self.outgoing.take_if(|outgoing| outgoing.seat == heir);
            if !is_trusted {
                self.keep_fallback(None, self.config.standby_shadow_ns, out);
            }
            self.settle(at_ns);
            self.publish(now, heir, Some(at_ns), out);
            step(out, Step::TookOver { seat: heir, from: seat, fault });
        } else {
            let newcomer = self.instances.state(seat).program().filter(|p| *p != self.home);
            if let (Fault::Silent | Fault::Tripped, Some(program)) = (fault, newcomer) {
                // Garbage from its last state would be garbage again.
                self.restarted = Some((program, now.logical_ns));
            }
            self.ledger.outstanding = None;
            self.phase = Phase::Ownerless { seat, at_ns: None };
            step(out, Step::Ownerless(seat, fault));
        }
    }

    /// Its seat is empty and it is time.
    pub(super) fn start_owner(&mut self, now: Now, seat: Seat, out: &mut Vec<Action>) {
        let Some(program) = self.instances.state(seat).program() else { return };
        let before = self.restarted.take().filter(|(restarted, _)| *restarted == program);
        let relapsed = before.is_some_and(|(_, at_ns)| {
            !program.is_trusted || now.logical_ns < at_ns.saturating_add(RELAPSE_NS)
        });
        self.phase = Phase::Ownerless { seat, at_ns: None };
        if relapsed {
            self.untrusted[seat.index()] = false;
            self.instances.set(seat, InstanceState::Starting(self.home));
            step(out, Step::Replaced(seat, self.home));
            out.push(Action::Spawn(seat, self.home));
        } else {
            self.restarted = (program != self.home).then_some((program, now.logical_ns));
            self.instances.set(seat, InstanceState::Starting(program));
            out.push(Action::Restart(seat, program));
        }
    }

    pub(super) fn count_standby_loss(&mut self, refused: bool, out: &mut Vec<Action>) {
        let Some(standby) = &mut self.standby else { return };
        standby.refused = refused;
        if refused && standby.proven {
            return;
        }
        standby.losses += 1;
        // What the gate refuses at first it would refuse again.
        if refused || standby.losses >= self.config.standby_losses_max {
            step(out, Step::StandbyGivenUp(standby.program));
            self.standby = None;
        }
    }
}
