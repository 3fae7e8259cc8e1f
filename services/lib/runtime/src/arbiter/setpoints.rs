//! The position slot's consumer, and what its owner reads back from the attitude slot.

use super::{ArbiterMemory, CommandArbiter, Selection};
use crate::backup;
use crate::input::Input;
use core::slice::Iter;
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, Flag, OwnerRecord, Reference, Role,
    StateEstimate, Trip,
};
use slot::{Authority, Command};

pub use crate::backup::TILT_BOUND_RAD;

/// Share of a bound by which a change of kind may step at once.
const STEP_SHARE: f64 = 0.1;

shared_types::memory! {
    /// A [`SetpointSlot`] as plain numbers.
    #[derive(PartialEq)]
    pub struct SetpointMemory {
        /// The seat whose set point counts.
        pub arbiter: ArbiterMemory,
        /// Set points refused because they are not finite.
        pub refused: u64,
        /// Until when the last set point has faded \[ns\].
        pub faded_ns: u64,
        /// What is left of it beside what stands in for it: T \[N\], φ, θ \[rad\].
        pub excess: [f64; 3],
    }
}

/// Decides which attitude set point counts, in the loop that tracks it.
#[derive(Debug, Clone, PartialEq)]
pub struct SetpointSlot {
    arbiter: CommandArbiter,
    refused: u64,
    faded_ns: u64,
    excess: [f64; 3],
    limit: [f64; 4],
    vehicle: backup::Vehicle,
}

impl SetpointSlot {
    /// Follows no seat yet; the weight is the vehicle's, and gravity what makes it.
    #[must_use]
    pub fn new(weight_n: f64, gravity_m_s2: f64) -> Self {
        let tilt = STEP_SHARE * TILT_BOUND_RAD;
        // The heading comes from the reference whichever process owns the slot, and it wraps: never limited.
        let limit = [STEP_SHARE * weight_n, tilt, tilt, f64::INFINITY];
        Self {
            arbiter: CommandArbiter::new(u64::MAX),
            refused: 0,
            faded_ns: 0,
            excess: [0.0; 3],
            limit,
            vehicle: backup::Vehicle { weight_n, gravity_m_s2 },
        }
    }

    /// The set point to track at `now_ns`, its value T \[N\], φ, θ, ψ \[rad\]; `None` if none is valid, and the last one
    /// stays; one is for two control periods of its writer. After two more without another, the last one fades, and a
    /// backup law follows the reference, or brakes without one; if the owner has tripped and no fallback has taken over
    /// yet, it does so at once. Both have the sequence 0 of no set point.
    pub fn take(
        &mut self,
        now_ns: u64,
        records: &Input<OwnerRecord>,
        setpoints: &Input<AttitudeSetpoint>,
        trips: &Input<Trip>,
        (estimates, references): (&Input<StateEstimate>, &Input<Reference>),
    ) -> Option<Command> {
        let joins = self.arbiter.consumer.record().is_none();
        self.arbiter.take_records(records);
        if joins && let Some(known) = setpoints.before_fresh() {
            // In effect since before this controller began.
            self.arbiter.advance(known.header.valid_ns);
            if let Some((value, validity_ns)) = self.judge(known) {
                self.arbiter.carry(&known.header, value, validity_ns);
            }
        }
        if let Some(known) = trips.before_fresh().filter(|_| joins) {
            let _taken = self.arbiter.trip(Role::Position, known);
        }
        let mut trips = trips.fresh().iter();
        let at_once =
            |a: &AttitudeSetpoint, b: &AttitudeSetpoint| a.header.valid_ns == b.header.valid_ns;
        for samples in setpoints.fresh().chunk_by(at_once) {
            let Some(first) = samples.first() else { continue };
            // A late one counts from the last decision on, which stays as it was.
            let at_ns = first.header.valid_ns.max(self.arbiter.consumer.open_ns());
            self.take_trips(at_ns, &mut trips);
            self.arbiter.advance(at_ns);
            for sample in samples {
                self.offer(sample);
            }
            if at_ns < now_ns {
                self.decide(at_ns);
            }
        }
        self.take_trips(now_ns, &mut trips);
        self.arbiter.advance(now_ns);
        let order = self.decide(now_ns);
        order
            .map(|order| order.command)
            .or_else(|| self.replace_tripped(now_ns, estimates.latest(), references.latest()))
            .or_else(|| self.fade(now_ns, estimates.latest(), references.latest()))
    }

    /// Decides which set point counts at an instant. After a trip none counts until the fallback has had two periods to
    /// see what the backup law does, or a record names another owner: it would begin with what its predecessor has
    /// tripped for.
    fn decide(&mut self, at_ns: u64) -> Option<Selection> {
        let record = self.arbiter.consumer.record().filter(|_| self.arbiter.is_revoked());
        let backup_ns = record.map_or(0, |record| {
            let period_ns = record.fallback.map_or(0, |seat| record.period_ns[seat.index()]);
            self.arbiter.counters().trip_ns.saturating_add(period_ns.saturating_mul(2))
        });
        if at_ns < backup_ns {
            self.arbiter.reject(at_ns);
            return None;
        }
        self.arbiter.decide(at_ns, &self.limit)
    }

    /// What is tracked in place of a set point of an owner that has tripped, until there is another's, also by another
    /// record. A loop that has tracked none keeps its first one.
    fn replace_tripped(
        &mut self,
        now_ns: u64,
        estimate: Option<&StateEstimate>,
        reference: Option<&Reference>,
    ) -> Option<Command> {
        let Command { value: [.., yaw_rad], sequence, .. } = self.arbiter.given;
        let has_none = self.arbiter.is_revoked() || self.arbiter.given_by.is_none();
        (has_none && sequence > 0).then(|| {
            self.arbiter.forget_order();
            let value = backup::setpoint(now_ns, self.vehicle, yaw_rad, estimate, reference);
            Command { value, ..Command::default() }
        })
    }

    /// What is tracked in place of the last set point when its end is two periods past.
    fn fade(
        &mut self,
        now_ns: u64,
        estimate: Option<&StateEstimate>,
        reference: Option<&Reference>,
    ) -> Option<Command> {
        let last = *self.arbiter.lapsed(now_ns)?;
        let [thrust_n, roll_rad, pitch_rad, yaw_rad] = last.value;
        let two_periods_ns = last.valid_until_ns.saturating_sub(last.effective_ns);
        let from_ns = last.valid_until_ns.saturating_add(two_periods_ns);
        let since_ns = now_ns.checked_sub(from_ns.max(self.faded_ns))?;
        let [thrust, roll, pitch, yaw] =
            backup::setpoint(now_ns, self.vehicle, yaw_rad, estimate, reference);
        if self.faded_ns < from_ns {
            self.excess = [thrust_n - thrust, roll_rad - roll, pitch_rad - pitch];
        }
        let left = backup::share_left(since_ns);
        self.excess = self.excess.map(|excess| left * excess);
        let [more_n, roll_more, pitch_more] = self.excess;
        let sum = [thrust + more_n, roll + roll_more, pitch + pitch_more];
        let [thrust_n, roll_rad, pitch_rad] =
            backup::bounded(sum, [thrust_n, roll_rad, pitch_rad], self.vehicle);
        let value = [thrust_n, roll_rad, pitch_rad, yaw];
        self.faded_ns = now_ns;
        self.arbiter.replace_lapsed(value);
        Some(Command { value, ..Command::default() })
    }

    /// Takes the trips in effect until `until_ns`, each at its own instant, ahead of the set points then.
    fn take_trips(&mut self, until_ns: u64, trips: &mut Iter<'_, Trip>) {
        while let Some(trip) = trips.as_slice().first().filter(|t| t.header.valid_ns <= until_ns) {
            let _this = trips.next();
            let at_ns = trip.header.valid_ns.max(self.arbiter.consumer.open_ns());
            self.arbiter.advance(at_ns);
            let _taken = self.arbiter.trip(Role::Position, trip);
            if at_ns < until_ns {
                self.decide(at_ns);
            }
        }
    }

    fn offer(&mut self, sample: &AttitudeSetpoint) {
        if let Some((value, validity_ns)) = self.judge(sample) {
            self.arbiter.offer(&sample.header, value, validity_ns);
        }
    }

    /// What a sample asks for and for how long it is good \[ns\], if it is fit to be followed.
    fn judge(&mut self, sample: &AttitudeSetpoint) -> Option<([f64; 4], u64)> {
        let authority = self.arbiter.authority_of(&sample.header);
        if !matches!(authority, Authority::Owner | Authority::Fallback) {
            return None;
        }
        let value = [sample.thrust_n, sample.roll_rad, sample.pitch_rad, sample.yaw_rad];
        if value.iter().all(|v| v.is_finite()) {
            Some((value, self.arbiter.two_periods_ns(&sample.header)))
        } else {
            self.refused += 1;
            None
        }
    }

    /// A sample that names the commanding seat; the set point itself is the caller's to fill in.
    #[must_use]
    pub fn applied(&self) -> AppliedSetpoint {
        AppliedSetpoint {
            epoch: self.arbiter.epoch(),
            refused_epoch: self.arbiter.counters().refused_epoch,
            seat: self.arbiter.seat(),
            failed_over: Flag::from(self.arbiter.failed_over()),
            tripped: Flag::from(self.arbiter.tripped()),
            ..AppliedSetpoint::default()
        }
    }

    /// Set points refused because they are not finite.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> SetpointMemory {
        let Self { refused, faded_ns, excess, .. } = *self;
        SetpointMemory { arbiter: self.arbiter.memory(), refused, faded_ns, excess }
    }

    /// Continues from a memory, bit for bit.
    pub fn restore(&mut self, memory: &SetpointMemory) {
        self.arbiter.restore(&memory.arbiter);
        (self.refused, self.faded_ns) = (memory.refused, memory.faded_ns);
        self.excess = memory.excess;
    }
}

impl Input<AppliedSetpoint> {
    /// The newest report of the attitude slot's owner in this step; the fallback's, if there is one, if the owner
    /// reports nothing any more, or the plant does not follow it any more, as `plant` shows: what it reports is not what
    /// flies then, although it may report on. Shadows report what they track too.
    #[must_use]
    pub fn in_command(
        &self,
        records: &Input<OwnerRecord>,
        plant: Option<&AppliedCommand>,
    ) -> Option<&AppliedSetpoint> {
        let newest = |authority| {
            self.fresh().iter().rev().find(|s| records.authority_of(&s.header) == authority)
        };
        let has_failed = |report: &&AppliedSetpoint| {
            let epoch = records.in_effect_at(report.header.valid_ns).map(|record| record.epoch);
            plant.is_some_and(|plant| {
                // Without a fallback the gate flies after a trip, until the owner is followed again.
                let is_held = plant.tripped.is_set() && plant.command_sequence == 0;
                (plant.failed_over.is_set() || is_held) && Some(plant.epoch) == epoch
            })
        };
        let owners = newest(Authority::Owner).filter(|report| !has_failed(report));
        owners.or_else(|| newest(Authority::Fallback))
    }
}

#[cfg(test)]
mod tests;
