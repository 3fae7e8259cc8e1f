//! What a mere observer of the plant would expect of it, and what it finds broken.

use super::{Broken, LATENCY, Process, World};
use slot::{Command, Record, Seat, Source};

impl World {
    /// Compares what the plant does with what a mere observer would expect.
    pub(super) fn judge(&mut self, choice: Option<(Seat, Source, Command)>) {
        let at = |t: u64| self.accepted.iter().find(|record| record.effective_ns <= t).copied();
        let Some(record) = at(self.t) else { return };
        self.tripped = self.carried(self.tripped, &record);
        // What silence has done lasts for an epoch, what a trip has done for as long as the trip.
        if self.latched > 0 && (self.latched == record.epoch || self.tripped == record.epoch) {
            self.latched = record.epoch;
        } else {
            self.latched = 0;
        }
        match choice {
            Some((seat, Source::Fallback, _)) => {
                self.latched = record.epoch;
                self.given_up[record.owner.index()] = true;
                if record.fallback != Some(seat) || !record.is_taken(seat) {
                    self.broken = Some(Broken::WrongWriter);
                }
            }
            Some((seat, _, command)) => {
                if self.latched == record.epoch {
                    self.broken = Some(Broken::Unlatched);
                }
                if self.tripped == record.epoch && seat == record.owner {
                    self.broken = Some(Broken::TripForgotten);
                }
                // Around a flip it may be what was followed before, while it is valid.
                let then = at(command.effective_ns);
                let owned = then.is_some_and(|then| then.owner == seat && then.is_taken(seat));
                let stood_in = then.is_some_and(|then| {
                    then.epoch < record.epoch && then.fallback == Some(seat) && then.is_taken(seat)
                });
                if !owned && !stood_in {
                    self.broken = Some(Broken::WrongWriter);
                }
            }
            None => {
                let is_out = [self.latched, self.tripped].contains(&record.epoch);
                let owner = !is_out && self.spoke(&record, record.owner);
                if owner || record.fallback.is_some_and(|seat| self.spoke(&record, seat)) {
                    self.broken = Some(Broken::Missed);
                }
            }
        }
    }

    /// What was so in `epoch` is so under `record` if no record since has named another owner or fallback: the monitor trips
    /// that owner again. One without a fallback may have been started again, unless the fallback has only left because a
    /// window is over.
    fn carried(&self, epoch: u64, record: &Record) -> u64 {
        let since = || self.accepted.iter().filter(|r| (epoch..=record.epoch).contains(&r.epoch));
        let is_there = |seat: Seat| {
            let process = &self.processes[seat.index()];
            let is_given_up = self.given_up[seat.index()];
            matches!(process, Process::Flying { mute: None, .. }) && !is_given_up
        };
        let fallback = since().find(|r| r.epoch == epoch).and_then(|r| r.fallback);
        let is_followed = record.fallback.is_some_and(|seat| record.is_taken(seat));
        let is_same = since().all(|between| between.same_hands(record));
        let is_closed = since().all(|between| between.owner == record.owner)
            && !record.watched
            && fallback.is_some_and(is_there);
        if epoch > 0 && (epoch == record.epoch || is_same && is_followed || is_closed) {
            record.epoch
        } else {
            0
        }
    }

    /// True if the process that `record` seats there has a valid command under it.
    fn spoke(&self, record: &Record, seat: Seat) -> bool {
        let Process::Flying { instance, from, mute: None, .. } = self.processes[seat.index()]
        else {
            return false;
        };
        let since = record.effective_ns.max(from + LATENCY);
        record.is_taken(seat) && instance.effective_at_or_after(since) <= self.t
    }
}
