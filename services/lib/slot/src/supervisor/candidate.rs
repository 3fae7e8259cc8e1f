//! The way of a candidate: joining, shadowing, the gate, the flip, the window.

use super::instances::{Instance, InstanceState};
use super::message::{Action, Now, Rehearsed, SwapTerms};
use super::reason::{Reason, RehearsalRefusal};
use super::report::{Outcome, Report, Step};
use super::{Clock, Goal, Outgoing, Phase, SlotMachine, Stage, Standby, step};
use crate::gate::{GateFigures, Refusal};
use crate::record::Seat;

/// Another kind runs free for half of its window, but no longer than this: nothing acts on its integrals,
/// and a controller that does not look at what is applied would wind them up \[ns\].
const FREE_MAX_NS: u64 = 2_000_000_000;

impl SlotMachine {
    /// A process has connected: the candidate, or the owner that was started again.
    pub(super) fn ready(
        &mut self,
        now: Now,
        seat: Seat,
        instance: Instance,
        out: &mut Vec<Action>,
    ) {
        let InstanceState::Starting(program) = *self.instances.state(seat) else { return };
        self.instances.seat(seat, program, instance, self.ledger.epoch() + 1);
        match self.phase {
            Phase::Ownerless { seat: expected, .. } if expected == seat => {
                let first = self.ledger.newest().is_none();
                // What another build or program has left is of no use to it.
                let before = self.ledger.in_force.filter(|(in_force, _)| *in_force == seat);
                let alike = before.is_none_or(|(_, before)| before.layout == instance.layout);
                if !self.is_trusted(seat) {
                    self.keep_fallback(None, self.config.standby_shadow_ns, out);
                }
                self.settle(now.logical_ns);
                self.publish(now, seat, None, out);
                if !first {
                    let join_ns = self.join_ns(now, seat);
                    let state_of = alike.then_some(seat);
                    // From nothing, it first sees what is applied.
                    let tracking_ns = if alike { 0 } else { instance.period_ns() };
                    let track_until_ns = join_ns.saturating_add(tracking_ns);
                    out.push(Action::HandOver { seat, state_of, join_ns, track_until_ns });
                }
                step(out, Step::Commands(seat));
            }
            Phase::Joining { seat: expected, goal } if expected == seat => {
                self.begin_shadow(now, seat, &instance, goal, out);
            }
            _ => self.kill(seat, out),
        }
    }

    /// When a new process begins: with the record that seats it, just written. In realtime at one of
    /// its effective instants, so that a window of whole periods ends at one, and the flip need not
    /// wait for the next.
    fn join_ns(&self, now: Now, seat: Seat) -> u64 {
        match self.config.clock {
            Clock::Lockstep => now.allowed_ns,
            Clock::Realtime => {
                let at_ns = self.ledger.effective_ns();
                let instance = self.instances.instance(seat);
                instance.map_or(at_ns, |instance| instance.effective_at_or_after(at_ns))
            }
        }
    }

    fn begin_shadow(
        &mut self,
        now: Now,
        seat: Seat,
        instance: &Instance,
        goal: Goal,
        out: &mut Vec<Action>,
    ) {
        let Some(owner) = self.ledger.owner() else { return };
        let same_kind = self.instances.layout(owner) == Some(instance.layout);
        self.publish(now, owner, None, out);
        let join_ns = self.join_ns(now, seat);
        let shadow_ns = goal.shadow_ns();
        let free_ns = (shadow_ns - shadow_ns / 2).min(FREE_MAX_NS);
        let tracking_ns = if same_kind { 0 } else { shadow_ns - free_ns };
        let track_until_ns = join_ns.saturating_add(tracking_ns);
        let stage = if same_kind { Stage::Free } else { Stage::Tracking };
        let until_ns = join_ns.saturating_add(goal.shadow_ns());
        self.phase = Phase::Shadowing { seat, goal, track_until_ns, until_ns, stage };
        let state_of = same_kind.then_some(owner);
        out.push(Action::HandOver { seat, state_of, join_ns, track_until_ns });
        step(out, Step::Joined { seat, same_kind, at_ns: join_ns });
    }

    pub(super) fn run_free(&mut self, out: &mut Vec<Action>) {
        if let Phase::Shadowing { seat, stage, .. } = &mut self.phase {
            *stage = Stage::Free;
            step(out, Step::RunsFree(*seat));
        }
    }

    pub(super) fn ask(&mut self, out: &mut Vec<Action>) {
        if let Phase::Shadowing { seat, stage, .. } = &mut self.phase {
            *stage = Stage::Judged;
            out.push(Action::Judge(*seat));
        }
    }

    /// Takes the gate's verdict. One that lets the candidate through counts only when asked for.
    pub(super) fn verdict(
        &mut self,
        now: Now,
        judged: Seat,
        verdict: Result<Box<GateFigures>, Refusal>,
        out: &mut Vec<Action>,
    ) {
        let Phase::Shadowing { seat, goal, stage, .. } = self.phase else { return };
        if seat != judged {
            return;
        }
        let asked = stage == Stage::Judged;
        let force = matches!(goal, Goal::Swap(order) if order.force);
        match verdict {
            Ok(figures) if asked => step(out, Step::Passed(seat, figures)),
            Err(refusal) if force && refusal.yields_to_force() => {
                if !asked {
                    return;
                }
                step(out, Step::Forced(seat, refusal));
            }
            Err(refusal) => return self.abort(now, seat, Reason::Gate(refusal), out),
            Ok(_) => return,
        }
        if goal.is_rehearsed() {
            self.rehearse(seat, false, out);
        } else {
            self.passed(now, seat, goal, out);
        }
    }

    /// Has the candidate flown ahead from now on.
    fn rehearse(&mut self, seat: Seat, again: bool, out: &mut Vec<Action>) {
        if let Phase::Shadowing { stage, .. } = &mut self.phase {
            *stage = Stage::Rehearsing { again };
            step(out, Step::Rehearses(seat, again));
            out.push(Action::Rehearse(seat));
        }
    }

    /// The candidate has been flown ahead. An answer about a flight that is past is asked for once
    /// more: where the first took too long the second may find the machine idle, a third would not.
    pub(super) fn rehearsed(
        &mut self,
        now: Now,
        flown: Seat,
        rehearsed: Rehearsed,
        out: &mut Vec<Action>,
    ) {
        let Phase::Shadowing { seat, goal, stage: Stage::Rehearsing { again }, .. } = self.phase
        else {
            return;
        };
        if seat != flown {
            return;
        }
        let age_ns = now.logical_ns.saturating_sub(rehearsed.from_ns);
        let old = age_ns > self.config.rehearsal_ns;
        let verdict = match rehearsed.verdict {
            Ok(_) if (old || rehearsed.left_tube) && !again => {
                return self.rehearse(seat, true, out);
            }
            Ok(_) if old => Err(RehearsalRefusal::NotRehearsed(format!(
                "it took {:.1} s of flight, twice; the answer may be {:.1} s old",
                age_ns as f64 * 1e-9,
                self.config.rehearsal_ns as f64 * 1e-9
            ))),
            Ok(_) if rehearsed.left_tube => Err(RehearsalRefusal::NotRehearsed(
                "the owner itself leaves the tube, twice: wait for quieter flight".to_owned(),
            )),
            verdict => verdict,
        };
        let force = matches!(goal, Goal::Swap(order) if order.force);
        match verdict {
            Ok(outcome) => step(out, Step::Rehearsed(seat, outcome)),
            Err(refusal) if force => step(out, Step::RehearsalForced(seat, refusal)),
            Err(refusal) => return self.abort(now, seat, Reason::Rehearsal(refusal), out),
        }
        self.passed(now, seat, goal, out);
    }

    fn passed(&mut self, now: Now, seat: Seat, goal: Goal, out: &mut Vec<Action>) {
        let Some(owner) = self.ledger.owner() else { return };
        match goal {
            Goal::Swap(order) if order.dry_run => {
                out.push(Action::Report(Report::Done(seat, Outcome::DryRun)));
                if self.standby.is_some_and(|standby| standby.seat == Some(seat)) {
                    self.settle(now.logical_ns);
                } else {
                    self.send_away(now, seat, out);
                }
            }
            Goal::Swap(order) => self.flip(now, owner, seat, order, out),
            Goal::Standby { .. } => {
                if let Some(standby) = &mut self.standby {
                    standby.seat = Some(seat);
                    standby.losses = 0;
                    standby.proven = true;
                    standby.refused = false;
                }
                self.settle(now.logical_ns);
                self.publish(now, owner, None, out);
                out.push(Action::Report(Report::Done(seat, Outcome::StandsBy)));
            }
        }
    }

    fn flip(&mut self, now: Now, old: Seat, new: Seat, order: SwapTerms, out: &mut Vec<Action>) {
        self.forget_standby(new);
        self.outgoing.take_if(|outgoing| outgoing.seat == new);
        let epoch = self.ledger.epoch() + 1;
        self.untrusted[new.index()] = order.force;
        if !self.is_trusted(new) && !self.config.keeps_fallback && self.standby.is_none() {
            step(out, Step::WithoutFallback(new));
        }
        let least_ns = order.rollback_ns.max(self.instances.period_ns(new)).max(1);
        let ends_ns = now.allowed_ns.saturating_add(least_ns);
        self.phase = Phase::Flipping { new, old, epoch, order, ends_ns };
        self.publish(now, new, None, out);
        let at_ns = self.ledger.effective_ns();
        step(out, Step::FlipsAt { seat: new, epoch, at_ns });
    }

    /// The window is over: the new owner stays. The old one leaves, that of one that is trusted once this has been
    /// confirmed, unless it is to be the fallback of one that is not trusted; which it is not if it is to leave.
    pub(super) fn commit(
        &mut self,
        now: Now,
        (new, old): (Seat, Seat),
        may_stay: bool,
        out: &mut Vec<Action>,
    ) {
        out.push(Action::Report(Report::Done(new, Outcome::Swapped)));
        let Phase::Window { until_ns, order, .. } = self.phase else { return };
        if let Some(before) = self.outgoing {
            self.dismiss(before.seat, out);
        }
        let stays = if self.is_trusted(new) {
            self.drop_automatic_standby(out);
            false
        } else if may_stay {
            let last = Some(old).filter(|old| self.is_trusted(*old));
            self.keep_fallback(last, order.shadow_ns, out)
        } else {
            self.give_up_untrusted_standby(out);
            false
        };
        self.settle(until_ns.min(now.logical_ns));
        if stays {
            step(out, Step::FallbackStays { seat: old, owner: new });
        } else if may_stay && self.is_trusted(new) && self.instances.is_seated(old) {
            let epoch = self.ledger.epoch() + 1;
            let until_ns = now.logical_ns;
            self.outgoing = Some(Outgoing { seat: old, epoch, is_confirmed: false, until_ns });
        } else {
            self.dismiss(old, out);
        }
        self.publish(now, new, None, out);
        let effective_ns = self.ledger.effective_ns();
        if let Some(outgoing) = &mut self.outgoing {
            outgoing.until_ns = effective_ns.saturating_add(self.config.close_ns);
        }
    }

    /// The fallback of a window that is over leaves, if the end of the window has been confirmed.
    pub(super) fn send_fallback_away(&mut self, now: Now, out: &mut Vec<Action>) {
        let candidate = self.candidate();
        let Some(Outgoing { seat, is_confirmed, until_ns, .. }) = &mut self.outgoing else {
            return;
        };
        let seat = *seat;
        // It may be the next candidate.
        if !*is_confirmed || candidate == Some(seat) {
            *until_ns = now.logical_ns.saturating_add(self.config.close_ns.max(1));
            return;
        }
        self.dismiss(seat, out);
        if let Some(owner) = self.ledger.owner().filter(|owner| self.instances.is_seated(*owner)) {
            self.publish(now, owner, None, out);
        }
    }

    /// Sees to it that an owner that is not trusted has a fallback that is: the standby that is there; or `last`, the
    /// owner before it, which stays then; or the program that the flight began with, which joins. True if `last` stays.
    pub(super) fn keep_fallback(
        &mut self,
        last: Option<Seat>,
        shadow_ns: u64,
        out: &mut Vec<Action>,
    ) -> bool {
        if !self.config.keeps_fallback {
            return false;
        }
        let last = last.filter(|last| self.instances.is_seated(*last));
        self.give_up_untrusted_standby(out);
        let is_there = self.standby.is_some_and(|standby| standby.seat.is_some());
        if is_there || last.is_none() && self.standby.is_some() {
            return false;
        }
        let program = last.and_then(|last| self.instances.state(last).program());
        self.standby = Some(Standby {
            program: program.unwrap_or(self.home),
            shadow_ns,
            rehearse: false,
            automatic: true,
            seat: last,
            losses: 0,
            proven: true,
            refused: false,
        });
        last.is_some()
    }

    /// Of two that are not trusted, neither is the other's fallback.
    fn give_up_untrusted_standby(&mut self, out: &mut Vec<Action>) {
        let keeps_fallback = self.config.keeps_fallback;
        let untrusted = |standby: &mut Standby| keeps_fallback && !standby.program.is_trusted;
        let Some(standby) = self.standby.take_if(untrusted) else { return };
        step(out, Step::StandbyUntrusted(standby.program));
        if let Some(seat) = standby.seat {
            self.dismiss(seat, out);
        }
    }

    /// Sends a standby away that is there for an owner that no longer commands.
    pub(super) fn drop_automatic_standby(&mut self, out: &mut Vec<Action>) {
        if let Some(standby) = self.standby.take_if(|standby| standby.automatic)
            && let Some(seat) = standby.seat
        {
            self.dismiss(seat, out);
        }
    }

    /// Names the old owner again, with the new one, which is healthy, as its fallback until then.
    pub(super) fn revert(
        &mut self,
        now: Now,
        from: Seat,
        to: Seat,
        asked: bool,
        out: &mut Vec<Action>,
    ) {
        let epoch = self.ledger.epoch() + 1;
        self.phase = Phase::Reverting { from, to, epoch, asked };
        self.publish(now, to, None, out);
        step(out, Step::FlipsAt { seat: to, epoch, at_ns: self.ledger.effective_ns() });
    }

    /// The old owner commands again.
    pub(super) fn reverted(&mut self, now: Now, at_ns: u64, out: &mut Vec<Action>) {
        let Phase::Reverting { from, to, asked, .. } = self.phase else { return };
        if asked {
            out.push(Action::Report(Report::Done(to, Outcome::RolledBack)));
        }
        self.settle(at_ns);
        self.dismiss(from, out);
        self.publish(now, to, None, out);
    }

    /// Nothing comes of the candidate; if it is healthy it may leave by itself.
    pub(super) fn abort(&mut self, now: Now, seat: Seat, reason: Reason, out: &mut Vec<Action>) {
        let standby = matches!(
            self.phase,
            Phase::Joining { goal: Goal::Standby { .. }, .. }
                | Phase::Shadowing { goal: Goal::Standby { .. }, .. }
        );
        if standby {
            let refused = matches!(reason, Reason::Gate(_) | Reason::Rehearsal(_));
            self.count_standby_loss(refused, out);
        }
        out.push(Action::Report(Report::Aborted(seat, reason)));
        self.forget_standby(seat);
        self.send_away(now, seat, out);
    }

    /// Back to rest without `seat`.
    fn send_away(&mut self, now: Now, seat: Seat, out: &mut Vec<Action>) {
        self.settle(now.logical_ns);
        let Some(owner) = self.ledger.owner() else { return };
        match self.instances.state(seat) {
            InstanceState::Seated(..) => {
                self.dismiss(seat, out);
                self.publish(now, owner, None, out);
            }
            InstanceState::Starting(_) => self.kill(seat, out),
            _ => {}
        }
    }

    /// Its seat is to be left; the record that states this must follow.
    pub(super) fn dismiss(&mut self, seat: Seat, out: &mut Vec<Action>) {
        self.outgoing.take_if(|outgoing| outgoing.seat == seat);
        if let InstanceState::Seated(program, _) = *self.instances.state(seat) {
            self.instances.set(seat, InstanceState::Leaving(program));
            out.push(Action::AwaitExit(seat));
        }
    }

    pub(super) fn kill(&mut self, seat: Seat, out: &mut Vec<Action>) {
        if let Some(program) = self.instances.state(seat).program() {
            self.instances.set(seat, InstanceState::Dying(program));
            out.push(Action::Kill(seat));
        }
    }

    pub(super) fn forget_standby(&mut self, seat: Seat) {
        if let Some(standby) = self.standby.as_mut().filter(|standby| standby.seat == Some(seat)) {
            standby.seat = None;
        }
    }
}
