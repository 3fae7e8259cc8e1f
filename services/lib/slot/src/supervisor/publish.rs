//! How a record's instant is chosen, and what makes it be written again.

use super::ledger::Outstanding;
use super::message::{Action, Now};
use super::reason::Reason;
use super::report::{Report, Step};
use super::{Clock, Phase, SlotMachine, step};
use crate::record::{Record, Seat};

impl SlotMachine {
    /// The first instant that no consumer can have decided by the time a record arrives, and not
    /// before an answer to what happened at `at_ns` is due.
    fn first_open_ns(&self, now: Now, owner: Seat, at_ns: Option<u64>, tries: u32) -> u64 {
        let open_ns = match self.config.clock {
            Clock::Lockstep => {
                let answer_ns = at_ns.map_or(0, |at_ns| at_ns.saturating_add(self.config.react_ns));
                now.allowed_ns.max(answer_ns)
            }
            Clock::Realtime => {
                let old_ns = self.ledger.owner().map_or(0, |seat| self.instances.period_ns(seat));
                let slower_ns = old_ns.max(self.instances.period_ns(owner));
                // Further ahead each time, or a machine that is always slow would always be too late.
                // With one and a half periods a launcher that wakes half a period late loses nothing.
                let ahead_ns = slower_ns.saturating_mul(3 * u64::from(tries)) / 2;
                now.logical_ns.saturating_add(ahead_ns)
            }
        };
        // Instants never go back, so the newest record decides about each of them.
        open_ns.max(self.ledger.effective_ns())
    }

    /// Writes a record with the members of now. If the owner changes, from an effective instant of
    /// the new one on.
    pub(super) fn publish(
        &mut self,
        now: Now,
        owner: Seat,
        at_ns: Option<u64>,
        out: &mut Vec<Action>,
    ) {
        self.publish_again(now, owner, at_ns, 1, out);
    }

    fn publish_again(
        &mut self,
        now: Now,
        owner: Seat,
        at_ns: Option<u64>,
        tries: u32,
        out: &mut Vec<Action>,
    ) {
        let open_ns = self.first_open_ns(now, owner, at_ns, tries);
        let effective_ns = match (self.ledger.in_force, self.instances.instance(owner)) {
            // Nothing has flown yet.
            _ if self.ledger.newest().is_none() => now.allowed_ns,
            // One that was started again has no command to flip at: its samples count from now on.
            (Some((seat, _)), Some(instance)) if seat != owner => {
                instance.effective_at_or_after(open_ns.saturating_add(self.margin_ns()))
            }
            _ => open_ns,
        };
        let layout_in_force = self.ledger.in_force.map(|(_, instance)| instance.layout);
        let layout = self.instances.layout(owner).or(layout_in_force);
        let record = Record {
            epoch: self.ledger.epoch() + 1,
            owner,
            fallback: self.fallback(owner),
            effective_ns,
            period_ns: self.instances.periods_ns(),
            watched: self.is_watched(owner),
            kind_changed: layout_in_force.is_some() && layout != layout_in_force,
        };
        let until_ns = effective_ns.saturating_add(self.config.acknowledge_ns.max(1));
        self.ledger.write(record, Outstanding { until_ns, tries });
        out.push(Action::Publish(record));
    }

    /// Whether the monitor judges `owner`: around its own flip, and for as long as it is not trusted.
    pub(super) fn is_watched(&self, owner: Seat) -> bool {
        let is_new = match self.phase {
            Phase::Flipping { new, .. } | Phase::Window { new, .. } => new == owner,
            _ => false,
        };
        is_new || !self.is_trusted(owner)
    }

    fn margin_ns(&self) -> u64 {
        match self.config.clock {
            Clock::Lockstep => self.config.margin_ns,
            Clock::Realtime => 0,
        }
    }

    /// The seat that is to take over from `owner`: around a flip the other one of the two, the fallback of a window that is
    /// over for as long as it is there, else the standby.
    pub(super) fn fallback(&self, owner: Seat) -> Option<Seat> {
        let other = match self.phase {
            Phase::Flipping { new, old, .. } | Phase::Window { new, old, .. } => {
                Some(if owner == new { old } else { new })
            }
            Phase::Reverting { from, .. } => Some(from),
            _ => None,
        };
        let outgoing = self.outgoing.map(|outgoing| outgoing.seat);
        let standby = self.standby.and_then(|standby| standby.seat);
        let fit = |seat: &Seat| *seat != owner && self.instances.is_seated(*seat);
        [other, outgoing, standby].into_iter().flatten().find(fit)
    }

    /// Writes the newest record again for a later instant, as things are now. A flip that is never
    /// confirmed is taken back.
    pub(super) fn try_again(&mut self, now: Now, out: &mut Vec<Action>) {
        let Some(owner) = self.ledger.owner() else { return };
        let tries = self.ledger.outstanding.map_or(1, |outstanding| outstanding.tries) + 1;
        match self.phase {
            // Its next record is the one that gives it the slot again.
            Phase::Ownerless { .. } => self.ledger.outstanding = None,
            Phase::Flipping { new, old, .. } if tries > self.config.tries_max => {
                let reason = Reason::NotAcknowledged(self.config.tries_max);
                out.push(Action::Report(Report::Aborted(new, reason)));
                if self.instances.is_seated(old) {
                    self.revert(now, new, old, false, out);
                } else {
                    // There is no way back; the record goes on being written.
                    if !self.is_trusted(new) {
                        self.keep_fallback(None, self.config.standby_shadow_ns, out);
                    }
                    self.settle(now.logical_ns);
                    self.publish(now, new, None, out);
                }
            }
            _ => {
                self.publish_again(now, owner, None, tries, out);
                step(out, Step::TriedAgain { epoch: self.ledger.epoch(), tries });
            }
        }
    }

    /// The consumer has put a record into effect.
    pub(super) fn acknowledged(
        &mut self,
        now: Now,
        epoch: u64,
        seat: Seat,
        at_ns: u64,
        out: &mut Vec<Action>,
    ) {
        if let Some(instance) = self.instances.instance(seat) {
            self.ledger.in_force = Some((seat, *instance));
        }
        if epoch == self.ledger.epoch() {
            self.ledger.outstanding = None;
        }
        if let Some(outgoing) =
            self.outgoing.as_mut().filter(|it| !it.is_confirmed && it.epoch <= epoch)
        {
            // A record that came late is in effect since then.
            let until_ns = at_ns.saturating_add(self.config.close_ns);
            outgoing.until_ns = outgoing.until_ns.max(until_ns);
            outgoing.is_confirmed = true;
        }
        match self.phase {
            Phase::Flipping { new, old, epoch: from, order, .. } if epoch >= from => {
                // The consumer reports it at its next step; its record states from when on.
                let record = self.ledger.newest().filter(|record| record.epoch == epoch);
                let since_ns = record.map_or(at_ns, |record| record.effective_ns.min(at_ns));
                step(out, Step::Flipped { seat: new, epoch, at_ns: since_ns });
                let until_ns = at_ns.saturating_add(order.rollback_ns);
                self.phase = Phase::Window { new, old, until_ns, order };
                if !self.instances.is_seated(old) {
                    self.commit(now, (new, old), true, out);
                }
            }
            Phase::Reverting { epoch: since, .. } if epoch >= since => {
                self.reverted(now, at_ns, out);
            }
            _ => {}
        }
    }
}
